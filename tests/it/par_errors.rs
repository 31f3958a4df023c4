//! The error that a network ends with does not depend on timing: it is the same in each run, on one
//! executor and on two.

use crate::common;
use common::{SpawnOk, is_long, watchdog};
use luna::prelude::*;
use luna::{Error, Receiver, Result, Sender, par_for};

/// Ends when its partner does; what it says then is what its channel says.
async fn feed(to: &Sender<u32>) -> Result<()> {
    for n in 0.. {
        to.send(n).await?;
    }
    Ok(())
}

async fn drain(from: &Receiver<u32>) -> Result<()> {
    loop {
        from.recv().await?;
    }
}

/// A network of branches and of processes. Its `guard` refuses the fifth number by poisoning its
/// channel.
fn run(executors: usize) -> String {
    let mut system = System::new("failing");
    let places: Vec<_> = ["left", "right"][..executors]
        .iter()
        .map(|name| system.executor(name).build().unwrap())
        .collect();
    let (left, right) = (&places[0], &places[executors - 1]);
    let (numbers, of_feeder) = luna::channel();
    let (checked, of_guard) = luna::channel();
    let (copies, of_copies) = luna::channel();

    let branches = async move {
        par!(
            feed(&numbers),
            async {
                // Passes all that it receives on, to a branch of its own.
                par!(
                    async {
                        loop {
                            copies.send(of_guard.recv().await?).await?;
                        }
                        #[expect(unreachable_code, reason = "says the type")]
                        Ok::<(), Error>(())
                    },
                    drain(&of_copies)
                )
                .await
            },
            par_for(0..100, async |n| {
                if n == 50 {
                    drain(&of_copies).await
                } else {
                    Ok(())
                }
            }),
        )
        .await?;
        Ok(())
    };
    let guard = async move {
        let refuse = |n| {
            if n == 4 {
                checked.poison();
                of_feeder.poison();
                return Err(Error::other(format!("refuses {n}")));
            }
            Ok(n)
        };
        loop {
            let n = refuse(of_feeder.recv().await?)?;
            checked.send(n).await?;
        }
    };
    left.process("branches").spawn_ok(branches);
    right.process("guard").spawn_ok(guard);
    system.run().unwrap_err().to_string()
}

#[test]
fn a_failing_network_ends_with_the_same_error_each_time() {
    let _watch = watchdog();
    let poisoned = Error::Poisoned;
    let expected = format!(
        "process `branches`: 4 errors in a parallel construct: \
         branch 1: {poisoned}; branches 2.1 to 2.2: {poisoned}; branch 3: {poisoned}"
    );
    let runs = if is_long() { 200 } else { 60 };
    for executors in [1, 2] {
        for _ in 0..runs {
            assert_eq!(run(executors), expected, "on {executors}");
        }
    }
}

#[test]
fn the_order_of_the_failures_does_not_matter() {
    let _watch = watchdog();
    let error_of = |delays: [usize; 3]| {
        luna::run(async {
            par_for(delays.into_iter().enumerate(), async |(n, delay)| {
                for _ in 0..delay {
                    luna::yield_now().await;
                }
                Err::<(), _>(Error::Panicked(n.to_string()))
            })
            .await
        })
        .unwrap_err()
    };
    let first = error_of([0, 1, 2]);
    for delays in [[2, 1, 0], [1, 2, 0], [0, 0, 0], [5, 0, 5]] {
        assert_eq!(error_of(delays), first);
    }
}
