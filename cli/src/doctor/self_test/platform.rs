//! What the library relies on: policies that are read back, and the lock with priority inheritance.

use super::{Outcome, Test, Trouble, ensure, same};
use crate::doctor::facts::task;
use luna::Policy;
use luna_machine::facts::Source;
use luna_machine::shortfall::Shortfall;
use luna_platform::clock::Instant;
use luna_platform::futex::Futex;
use luna_platform::lock::PiLock;
use luna_platform::thread::{Attributes, Mode, SpawnError, current_policy, spawn};
use std::convert::Infallible;
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, mpsc::SyncSender};
use std::time::Duration;

pub(super) const TESTS: &[Test] = &[
    Test {
        name: "policy",
        component: "platform",
        shows: "a thread that asks for SCHED_FIFO gets it, as the kernel says",
        run: policy,
    },
    Test {
        name: "lock-excludes",
        component: "platform",
        shows: "the priority-inheriting lock lets one thread in at a time",
        run: excludes,
    },
    Test {
        name: "lock-boost",
        component: "platform",
        shows: "the lock's holder runs at the priority of its waiter while that waits, as the kernel reports",
        run: boost,
    },
];

/// The time after which a boost is given up.
const PATIENCE: Duration = Duration::from_secs(5);

/// A thread under SCHED_FIFO, or why there is none.
fn real_time<T: Send + 'static>(
    priority: u8,
    body: impl FnOnce() -> T + Send + 'static,
) -> Result<luna_platform::thread::Thread<T>, Trouble> {
    let attributes = Attributes::new("self-test")
        .policy(Policy::fifo(priority))
        .mode(Mode::Strict);
    spawn(attributes, |_| Ok::<_, Infallible>(()), |()| body()).map_err(|error| match error {
        SpawnError::Refused(refusal) => {
            let shortfall = Shortfall::of(&refusal);
            Trouble::CannotRun {
                why: format!("it needs SCHED_FIFO, and {}", shortfall.why()),
                how: shortfall.remedy(),
            }
        }
        error => Trouble::Failed(error.to_string()),
    })
}

/// Prints it if this program gets no SCHED_FIFO.
pub(super) fn need_real_time() -> Result<(), Trouble> {
    end(real_time(1, || ())?)
}

fn end<T>(thread: luna_platform::thread::Thread<T>) -> Result<T, Trouble> {
    thread
        .join()
        .map_err(|_| Trouble::Failed("a thread panicked".to_owned()))
}

fn policy() -> Outcome {
    let obtained = end(real_time(10, current_policy)?)?;
    same("the policy", obtained, Policy::fifo(10))?;
    Ok(obtained.to_string())
}

fn excludes() -> Outcome {
    const THREADS: u64 = 4;
    const ROUNDS: u64 = 2000;
    // Two numbers that differ only while the lock is held.
    let lock = Arc::new(PiLock::new((0, 0)));
    let threads: Vec<_> = (0..THREADS)
        .map(|_| {
            let lock = lock.clone();
            std::thread::spawn(move || {
                (0..ROUNDS).all(|_| {
                    let mut pair = lock.lock();
                    let alone = pair.0 == pair.1;
                    pair.0 += 1;
                    pair.1 = std::hint::black_box(pair.0);
                    alone
                })
            })
        })
        .collect();
    for thread in threads {
        let alone = thread.join().unwrap_or(false);
        ensure(alone, "one at a time")?;
    }
    same("the count", lock.lock().0, THREADS * ROUNDS)?;
    Ok(format!("{} sections", THREADS * ROUNDS))
}

/// The priority in effect of the calling thread, as the kernel reports it.
fn priority() -> Option<u8> {
    let stat = Source::machine().parse("/proc/thread-self/stat", task::scheduling);
    Some(stat.ok()?.real_time_priority)
}

/// Waits until the calling thread has `expected` in effect. Returns what it has.
fn priority_becomes(expected: u8) -> Option<u8> {
    let end = Instant::now() + PATIENCE;
    // Asleep in between: a real-time thread that spins would keep the one to come from being made.
    let never = Futex::new(0);
    loop {
        let current = priority();
        if current == Some(expected) || Instant::now() >= end {
            return current;
        }
        never.wait(0, Instant::now() + Duration::from_micros(200));
    }
}

fn boost() -> Outcome {
    let lock = Arc::new(PiLock::new(()));
    let (is_held, held) = sync_channel(1);
    let low = real_time(10, hold(lock.clone(), is_held))?;
    if held.recv().is_err() {
        end(low)?;
        return Err(Trouble::Failed("the holder ended early".to_owned()));
    }
    let high = real_time(30, move || drop(lock.lock()));
    let (during, after) = end(low)?;
    end(high?)?;
    if during.is_none() {
        return Err(Trouble::CannotRun {
            why: "/proc/thread-self/stat cannot be read".to_owned(),
            how: "mount /proc".to_owned(),
        });
    }
    same("the priority while another waits", during, Some(30))?;
    same("the priority after that", after, Some(10))?;
    Ok("10 boosted to 30, and back".to_owned())
}

/// Holds the lock until it inherits a priority. Returns the inherited one, and the one after.
fn hold(
    lock: Arc<PiLock<()>>,
    is_held: SyncSender<()>,
) -> impl FnOnce() -> (Option<u8>, Option<u8>) + Send {
    move || {
        let guard = lock.lock();
        // Its receiver waits for it.
        let _ = is_held.send(());
        let during = priority_becomes(30);
        drop(guard);
        (during, priority_becomes(10))
    }
}
