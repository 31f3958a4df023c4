//! Alternatives, and meeting at a barrier.

use super::{Ends, Outcome, Test, ensure, on_one_executor, run_both, same};
use luna::{Alternative, Barrier, Receiver, System};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

pub(super) const TESTS: &[Test] = &[
    Test {
        name: "alternative",
        component: "alternatives",
        shows: "input and output guards in one choice, both sides choosing, across executors",
        run: alternative,
    },
    Test {
        name: "prioritized-alternative",
        component: "alternatives",
        shows: "of two ready guards the first one written is taken, and a delay when none is",
        run: prioritized,
    },
    Test {
        name: "registered-alternative",
        component: "alternatives",
        shows: "one receiver of many channels gets all, and knows of which",
        run: registered,
    },
    Test {
        name: "barrier",
        component: "barriers",
        shows: "nobody leaves a round before all have come: two executors and a thread",
        run: barrier,
    },
];

const MESSAGES: u32 = 300;

/// Both sides offer both directions: each communication is decided between two choices.
fn alternative() -> Outcome {
    let (to_right, from_left) = luna::channel();
    let (to_left, from_right) = luna::channel();
    let side = |output: luna::Sender<u32>, input: Receiver<u32>| async move {
        let (mut sent, mut received) = (0, 0);
        while sent < MESSAGES || received < MESSAGES {
            luna::alt! {
                value = input.recv(), if received < MESSAGES => {
                    same("a message", value?, received)?;
                    received += 1;
                }
                gone = output.send(sent), if sent < MESSAGES => {
                    gone?;
                    sent += 1;
                }
            }
        }
        Ok(())
    };
    run_both(
        Ends::TwoExecutors,
        side(to_right, from_right),
        side(to_left, from_left),
    )?;
    Ok(format!("{} choices", 2 * MESSAGES))
}

fn prioritized() -> Outcome {
    let (first, firsts) = luna::buffered(luna::Buffer::fifo(1));
    let (second, seconds) = luna::buffered(luna::Buffer::fifo(1));
    on_one_executor(|executor| {
        executor.process("chooses").spawn(async move {
            second.try_send(())?;
            first.try_send(())?;
            let mut taken = [0; 3];
            for place in &mut taken {
                *place = luna::pri_alt! {
                    _ = firsts.recv() => 1,
                    _ = seconds.recv() => 2,
                    _ = luna::after(Duration::from_millis(1)) => 3,
                };
            }
            same("the order", taken, [1, 2, 3])
        })
    })?;
    Ok("3 choices".to_owned())
}

fn registered() -> Outcome {
    const INPUTS: usize = 20;
    let (senders, receivers): (Vec<_>, Vec<_>) =
        (0..INPUTS).map(|_| luna::channel::<usize>()).unzip();
    let left = async move {
        for round in 0..10 {
            for (number, sender) in senders.iter().enumerate() {
                sender.send(number + round * INPUTS).await?;
            }
        }
        Ok(())
    };
    let right = async move {
        let mut alternative = Alternative::fair(&receivers);
        for message in 0..10 * INPUTS {
            let (index, value) = alternative.recv().await;
            same("a message", (index, value?), (message % INPUTS, message))?;
        }
        Ok(())
    };
    run_both(Ends::TwoExecutors, left, right)?;
    Ok(format!("{} messages over {INPUTS} channels", 10 * INPUTS))
}

fn barrier() -> Outcome {
    const ROUNDS: u32 = 100;
    let barrier = Barrier::new(3);
    let come = Arc::new(AtomicU32::new(0));
    let mut system = System::new("self-test");
    let one = system.executor("one").build()?;
    let two = system.executor("two").build()?;
    let own = system.thread("own");
    let party = || {
        let (barrier, come) = (barrier.clone(), come.clone());
        async move {
            for round in 1..=ROUNDS {
                come.fetch_add(1, Ordering::Relaxed);
                barrier.sync().await;
                ensure(come.load(Ordering::Relaxed) >= 3 * round, "all have come")?;
                barrier.sync().await;
            }
            Ok(())
        }
    };
    one.process("a").spawn(party())?;
    two.process("b").spawn(party())?;
    own.process("c").spawn(party())?;
    system.run()?;
    Ok(format!("{} rounds", 2 * ROUNDS))
}
