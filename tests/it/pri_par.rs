//! `pri_par!`: on an executor each branch runs a level below the one before it; everywhere the
//! order is kept.

use crate::common;
use crate::levels::on_one_executor;
use common::{Log, SpawnOk, watchdog};
use futures_lite::future;
use luna::Error;
use luna::prelude::*;
use std::future::poll_fn;
use std::sync::Arc;
use std::task::Poll;

#[test]
fn values_and_errors_are_those_of_par() {
    let _watch = watchdog();
    let (sender, receiver) = luna::channel();
    let values = luna::run(async {
        pri_par!(
            async { Ok::<_, std::io::Error>("first") },
            sender.send(7),
            receiver.recv(),
        )
        .await
    });
    assert_eq!(values, Ok(("first", (), 7)));
    let error =
        luna::run(async { pri_par!(sender.send(1), async { Err::<(), _>(Error::Timeout) }).await });
    assert!(
        error
            .unwrap_err()
            .errors()
            .eq(&[Error::Poisoned, Error::Timeout])
    );
}

#[test]
fn a_process_between_two_branches_runs_between_them() {
    let _watch = watchdog();
    for place in ["at the start", "after a wake"] {
        let log = Log::default();
        on_one_executor(|process| {
            let (wake_first, first) = luna::channel::<()>();
            let (wake_last, last) = luna::channel::<()>();
            let (wake_between, between) = luna::channel::<()>();
            let starts_at_once = place == "at the start";
            let own = log.clone();
            let of_between = async move {
                if !starts_at_once {
                    between.recv().await?;
                }
                own.add("between");
                Ok(())
            };
            let own = log.clone();
            let parent = async move {
                let step = |name: &'static str, from: luna::Receiver<()>| {
                    let own = own.clone();
                    async move {
                        if !starts_at_once {
                            from.recv().await?;
                        }
                        own.add(name);
                        Ok::<_, Error>(())
                    }
                };
                // Levels 10, 9, 8; `between` has 9 and came first.
                pri_par!(
                    step("first", first),
                    async { Ok::<_, Error>(()) },
                    step("last", last)
                )
                .await?;
                Ok(())
            };
            // Wakes from below, the least urgent first.
            let waker = async move {
                if !starts_at_once {
                    wake_last.try_send(())?;
                    wake_between.try_send(())?;
                    wake_first.try_send(())?;
                }
                Ok(())
            };
            process("between", 9).spawn_ok(of_between);
            process("parent", 10).spawn_ok(parent);
            process("waker", 1).spawn_ok(waker);
        });
        assert_eq!(log.all().join(" "), "first between last", "{place}");
    }
}

#[test]
fn a_wake_queues_the_parent_at_the_branch_s_level() {
    let _watch = watchdog();
    // Which branch is woken, beside a process at level 9 that is readied after it.
    for (branch, expected) in [
        (0, "branch other"),
        (1, "branch other"),
        (2, "other branch"),
    ] {
        let log = Log::default();
        on_one_executor(|process| {
            let (wake, woken) = luna::channel::<()>();
            let (wake_other, other) = luna::channel::<()>();
            let own = log.clone();
            let parent = async move {
                let waits = |at: usize| {
                    let (woken, own) = (woken.clone(), own.clone());
                    async move {
                        if at == branch {
                            woken.recv().await?;
                            own.add("branch");
                        }
                        Ok::<_, Error>(())
                    }
                };
                pri_par!(waits(0), waits(1), waits(2)).await?;
                Ok(())
            };
            let own = log.clone();
            let of_other = async move {
                other.recv().await?;
                own.add("other");
                Ok(())
            };
            let waker = async move {
                wake.try_send(())?;
                wake_other.try_send(())?;
                Ok(())
            };
            process("parent", 10).spawn_ok(parent);
            process("other", 9).spawn_ok(of_other);
            process("waker", 1).spawn_ok(waker);
        });
        assert_eq!(log.all().join(" "), expected, "branch {branch}");
    }
}

/// The process is queued already, at the level of a lower branch, when its first branch yields.
#[test]
fn a_branch_that_yields_after_it_has_woken_a_lower_one_comes_again_at_its_own_level() {
    let _watch = watchdog();
    let log = Log::default();
    on_one_executor(|process| {
        let (wake_last, last) = luna::channel::<()>();
        let (wake_between, between) = luna::channel::<()>();
        let (go, gone) = luna::channel::<()>();
        let own = log.clone();
        process("between", 9).spawn_ok(async move {
            between.recv().await?;
            own.add("between");
            Ok(())
        });
        let own = log.clone();
        process("parent", 10).spawn_ok(async move {
            pri_par!(
                async {
                    gone.recv().await?; // the others wait too by then
                    wake_last.try_send(())?;
                    wake_between.try_send(())?;
                    luna::yield_now().await;
                    own.add("first");
                    Ok::<_, Error>(())
                },
                async { Ok::<_, Error>(()) },
                async {
                    last.recv().await?;
                    own.add("last");
                    Ok::<_, Error>(())
                },
            )
            .await?;
            Ok(())
        });
        process("low", 1).spawn_ok(async move {
            go.send(()).await?;
            Ok(())
        });
    });
    assert_eq!(log.all().join(" "), "first between last");
}

#[test]
fn channels_serve_branches_by_their_levels() {
    let _watch = watchdog();
    let log = Log::default();
    on_one_executor(|process| {
        let (sender, receiver) = luna::channel::<u32>();
        let offer = |n| {
            let sender = sender.clone();
            async move { sender.send(n).await }
        };
        // Offered first, by a process as urgent as the second branch: it comes after the first
        // branch and before the third.
        let process_s = offer(20);
        process("process", 11).spawn_ok(async move {
            luna::yield_now().await;
            process_s.await?;
            Ok(())
        });
        let (first, second, third) = (offer(1), offer(2), offer(3));
        let (go, gone) = luna::channel::<()>();
        process("parent", 12).spawn_ok(async move {
            // Their order of arrival is not that of their levels.
            let late = async {
                gone.recv().await?;
                first.await?;
                Ok::<_, Error>(())
            };
            pri_par!(late, second, third).await?;
            Ok(())
        });
        let own = log.clone();
        process("receiver", 1).spawn_ok(async move {
            // Below all others, so they wait by now.
            go.send(()).await?;
            for _ in 0..4 {
                own.add(receiver.recv().await?.to_string());
            }
            Ok(())
        });
    });
    assert_eq!(log.all().join(" "), "1 2 20 3");
}

#[test]
fn a_branch_that_readies_one_above_lets_it_run_first() {
    let _watch = watchdog();
    let log = Log::default();
    on_one_executor(|process| {
        let own = log.clone();
        process("parent", 10).spawn_ok(async move {
            let (sender, receiver) = luna::channel();
            pri_par!(
                async {
                    for _ in 0..2 {
                        let n: u32 = receiver.recv().await?;
                        own.add(format!("received {n}"));
                    }
                    Ok::<_, Error>(())
                },
                async {
                    for n in 0..2 {
                        sender.send(n).await?;
                        own.add(format!("sent {n}"));
                    }
                    Ok::<_, Error>(())
                },
            )
            .await?;
            Ok(())
        });
    });
    assert_eq!(log.all().join(" "), "received 0 sent 0 received 1 sent 1");
}

#[test]
fn levels_fall_on_in_nested_constructs_and_stop_at_the_lowest() {
    let _watch = watchdog();
    let log = Log::default();
    on_one_executor(|process| {
        let step = |name: &'static str| {
            let own = log.clone();
            async move {
                own.add(name);
                Ok::<_, Error>(())
            }
        };
        let (a, b, c, d, e) = (step("2"), step("1"), step("0 nested"), step("0"), step("0"));
        process("parent", 2).spawn_ok(async move {
            pri_par!(a, async { pri_par!(b, par!(c), d, e).await }).await?;
            Ok(())
        });
        // As urgent as the inner construct: its first branch came first, and the others are below.
        let own = log.clone();
        process("one", 1).spawn_ok(async move {
            own.add("process 1");
            luna::yield_now().await;
            own.add("process 1");
            Ok(())
        });
        let own = log.clone();
        process("zero", 0).spawn_ok(async move {
            own.add("process 0");
            Ok(())
        });
    });
    // The inner branches are at levels 1, 0, 0, 0: when their turn comes, nothing more urgent is
    // ready, and the parent comes before its equals.
    assert_eq!(
        log.all().join(" "),
        "2 1 process 1 process 1 0 nested 0 0 process 0"
    );
}

#[test]
fn a_failure_reaches_those_above_and_those_that_gave_way() {
    let _watch = watchdog();
    let log = Log::default();
    on_one_executor(|process| {
        let (open, never) = luna::channel::<()>();
        let own = log.clone();
        process("parent", 10).spawn_ok(async move {
            let _open = open;
            let waits = async || {
                let outcome = never.recv().await;
                own.add("ended");
                outcome
            };
            let error = pri_par!(
                waits(),
                async {
                    luna::yield_now().await;
                    Err::<(), _>(Error::Full)
                },
                waits()
            )
            .await
            .unwrap_err();
            let all = [Error::Poisoned, Error::Full, Error::Poisoned];
            assert!(error.errors().eq(&all), "{error}");
            own.add("over");
            Ok(())
        });
        let own = log.clone();
        process("between", 9).spawn_ok(async move {
            own.add("between");
            Ok(())
        });
    });
    assert_eq!(log.all().join(" "), "between ended ended over");
}

#[test]
fn within_a_foreign_combinator_nobody_is_starved() {
    let _watch = watchdog();
    let log = Log::default();
    on_one_executor(|process| {
        let (sender, receiver) = luna::channel::<()>();
        process("parent", 10).spawn_ok(async move {
            // Polls with a waker of its own, so the branch cannot be readied below the parent's
            // level.
            let mut inner =
                Box::pin(async { pri_par!(async { Ok::<_, Error>(()) }, receiver.recv()).await });
            let foreign = future::poll_fn(|cx| {
                let waker = std::task::Waker::from(Arc::new(Passes(cx.waker().clone())));
                inner
                    .as_mut()
                    .poll(&mut std::task::Context::from_waker(&waker))
            });
            foreign.await?;
            Ok(())
        });
        let own = log.clone();
        process("between", 10).spawn_ok(async move {
            own.add("between");
            sender.send(()).await?;
            Ok(())
        });
    });
    assert_eq!(log.all().join(" "), "between");
}

struct Passes(std::task::Waker);

impl std::task::Wake for Passes {
    fn wake(self: Arc<Self>) {
        self.0.wake_by_ref();
    }
}

#[test]
fn a_branch_that_yields_comes_again_before_those_below_where_there_are_levels() {
    let _watch = watchdog();
    async fn three_steps(log: Log) -> luna::Result<()> {
        let step = async |name: &str| {
            for _ in 0..2 {
                log.add(name);
                luna::yield_now().await;
            }
            Ok::<_, Error>(())
        };
        pri_par!(step("a"), step("b"), step("c")).await?;
        Ok(())
    }
    let log = Log::default();
    let mut system = System::new("thread");
    let body = three_steps(log.clone());
    system.thread("alone").process("parent").spawn_ok(body);
    system.run().unwrap();
    assert_eq!(log.all().join(" "), "a a b b c c");
    let log = Log::default();
    luna::run(three_steps(log.clone())).unwrap();
    assert_eq!(log.all().join(" "), "a b c a b c");
}

/// Lets others run once, by the waker of the process or by `yield_now`.
async fn give_way(by_waker: bool) {
    if !by_waker {
        return luna::yield_now().await;
    }
    let mut is_over = false;
    poll_fn(|cx| {
        if is_over {
            return Poll::Ready(());
        }
        is_over = true;
        cx.waker().wake_by_ref();
        Poll::Pending
    })
    .await;
}

/// A lower branch does not go on while its process is ready at a higher level.
#[test]
fn a_lower_branch_gives_way_to_one_that_lets_others_run() {
    let _watch = watchdog();
    for (by_waker, is_a_branch) in [(true, true), (true, false), (false, true), (false, false)] {
        let log = Log::default();
        on_one_executor(|process| {
            let own = log.clone();
            process("parent", 10).spawn_ok(async move {
                let (sender, _receiver) = luna::buffered(Buffer::fifo(2));
                let higher = async {
                    own.add("higher");
                    give_way(by_waker).await;
                    own.add("higher again");
                    Ok::<_, Error>(())
                };
                let lower = async {
                    sender.send(1).await?;
                    own.add("lower");
                    sender.send(2).await?;
                    own.add("lower again");
                    Ok::<_, Error>(())
                };
                if is_a_branch {
                    pri_par!(higher, lower).await?;
                } else {
                    // The first branch of the construct is at the level of the process.
                    let beside = async { pri_par!(async { Ok::<_, Error>(()) }, lower).await };
                    let (higher, beside) = future::zip(higher, beside).await;
                    higher.and(beside.map(drop))?;
                }
                Ok(())
            });
        });
        let expected = ["higher", "higher again", "lower", "lower again"];
        assert_eq!(log.all(), expected, "{by_waker} {is_a_branch}");
    }
}
