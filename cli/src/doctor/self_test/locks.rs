//! Locks: mutex, condition variable, semaphore.

use super::{Outcome, Test, ensure, on_one_executor, same};
use luna::sync::{Condvar, LockError, Mutex, Semaphore};
use luna::{Barrier, System};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

pub(super) const TESTS: &[Test] = &[
    Test {
        name: "mutex",
        component: "locks",
        shows: "an executor's process and one on a thread of its own exclude each other, also across an await",
        run: mutex,
    },
    Test {
        name: "mutex-of-the-dead",
        component: "locks",
        shows: "the next locker after a holder that ended gets an error, and can go on",
        run: mutex_of_the_dead,
    },
    Test {
        name: "condition",
        component: "locks",
        shows: "two take turns by a condition variable",
        run: condition,
    },
    Test {
        name: "semaphore",
        component: "locks",
        shows: "no more than its permits are out at once",
        run: semaphore,
    },
];

const ROUNDS: u32 = 100;

fn mutex() -> Outcome {
    let sum = Mutex::new(0);
    let mut system = System::new("self-test");
    let executor = system.executor("main").build()?;
    let other = system.thread("other");
    for process in [executor.process("adds"), other.process("adds too")] {
        let sum = sum.clone();
        process.spawn(async move {
            for _ in 0..ROUNDS {
                let mut sum = sum.lock().await?;
                let before = *sum;
                luna::yield_now().await;
                *sum = before + 1;
            }
            Ok(())
        })?;
    }
    system.run()?;
    let total = sum.try_lock().map_or(0, |sum| *sum);
    same("the sum", total, 2 * ROUNDS)?;
    Ok(format!("{total} holds"))
}

fn mutex_of_the_dead() -> Outcome {
    let reported = Arc::new(AtomicBool::new(false));
    let report = reported.clone();
    on_one_executor(|executor| {
        let state = Mutex::new(());
        let own = state.clone();
        let (say, said) = luna::channel();
        let (fail, is_to_fail) = luna::channel();
        // The branch that holds the mutex is ended where it waits, since the other one fails. A
        // cancelled process would be an error of the system, which is reported on standard error.
        let never = Barrier::new(2);
        executor.process("parent").spawn(async move {
            let dies = luna::par!(
                async {
                    let _guard = own.lock().await?;
                    say.send(()).await?;
                    never.sync().await;
                    Ok(())
                },
                async {
                    is_to_fail.recv().await?;
                    Err::<(), _>(luna::Error::other("as the test wants"))
                },
            );
            ensure(dies.await.is_err(), "a branch fails")
        })?;
        executor.process("next locker").spawn(async move {
            said.recv().await?;
            fail.send(()).await?;
            match state.lock().await {
                Err(LockError::OwnerDied(died)) => drop(died.recover()),
                _ => ensure(false, "the lock reports the death")?,
            }
            ensure(state.try_lock().is_ok(), "it goes on after that")?;
            report.store(true, Ordering::Relaxed);
            Ok(())
        })
    })?;
    ensure(
        reported.load(Ordering::Relaxed),
        "the next locker completes",
    )?;
    Ok("1 death".to_owned())
}

fn condition() -> Outcome {
    let (turns, changed) = (Mutex::new(0), Condvar::new());
    let last = turns.clone();
    on_one_executor(|executor| {
        for own in 0..2_u32 {
            let (turns, changed) = (turns.clone(), changed.clone());
            let name = format!("takes turns {own}");
            executor.process(&name).spawn(async move {
                for _ in 0..ROUNDS {
                    let turns = turns.lock().await?;
                    let mut turns = changed.wait_while(turns, |turns| *turns % 2 != own).await?;
                    *turns += 1;
                    changed.notify_one();
                }
                Ok(())
            })?;
        }
        Ok(())
    })?;
    let total = last.try_lock().map_or(0, |turns| *turns);
    same("the turns", total, 2 * ROUNDS)?;
    Ok(format!("{total} turns"))
}

fn semaphore() -> Outcome {
    let (two, out) = (Semaphore::new(2), Mutex::new((0, 0)));
    let last = out.clone();
    on_one_executor(|executor| {
        for number in 0..4 {
            let (two, out) = (two.clone(), out.clone());
            let name = format!("takes a permit {number}");
            executor.process(&name).spawn(async move {
                for _ in 0..ROUNDS {
                    let permit = two.acquire().await?;
                    {
                        let (now, most) = &mut *out.lock().await?;
                        *now += 1;
                        *most = (*most).max(*now);
                    }
                    luna::yield_now().await;
                    out.lock().await?.0 -= 1;
                    drop(permit);
                }
                Ok(())
            })?;
        }
        Ok(())
    })?;
    let most = last.try_lock().map_or(0, |out| out.1);
    same("the most at once", most, 2)?;
    Ok("2 at once".to_owned())
}
