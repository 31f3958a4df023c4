//! What can still be woken is no deadlock.

use super::*;
use crate::common::{SpawnOk, is_long};

/// Runs a strict system with a process that waits for a value that another sends late. The run must
/// end well.
fn must_end_well(name: &str, describe: impl FnOnce(&mut System, Sender<u32>)) {
    let mut system = strict(name);
    let (sender, receiver) = luna::channel();
    let waiter = system.executor("waiter").build().unwrap();
    waiter.process("waiter").spawn_ok(async move {
        assert_eq!(receiver.recv().await?, 7);
        Ok(())
    });
    describe(&mut system, sender);
    let report = system
        .run()
        .unwrap_or_else(|error| panic!("{name}: {error}"));
    assert_eq!(report.deadlock, None, "{name}");
}

#[test]
fn a_deadline_a_blocking_call_and_a_computation_are_no_deadlock() {
    let _watchdog = watchdog();
    for place in PLACEMENTS {
        must_end_well("deadline", |system, sender| {
            let process = place.process(system, "other", "other");
            process.spawn_ok(async move {
                luna::after(LONG).await;
                sender.send(7).await?;
                Ok(())
            });
        });
        must_end_well("blocking", |system, sender| {
            let process = place.process(system, "other", "other");
            process.spawn_ok(async move {
                luna::blocking(|| std::thread::sleep(LONG)).await;
                sender.send(7).await?;
                Ok(())
            });
        });
    }
    must_end_well("forgotten call", |system, sender| {
        let process = Placement::Executor.process(system, "other", "other");
        process.spawn_ok(async move {
            let call = luna::blocking(move || {
                std::thread::sleep(LONG);
                sender.blocking_send(7).unwrap();
            });
            // The call is started, and then no process waits for it.
            let mut call = std::pin::pin!(call);
            std::future::poll_fn(|cx| {
                assert!(call.as_mut().poll(cx).is_pending());
                std::task::Poll::Ready(())
            })
            .await;
            Ok(())
        });
    });
    must_end_well("blocked", |system, sender| {
        let process = Placement::Thread.process(system, "other", "other");
        process.spawn_ok(async move {
            std::thread::sleep(LONG);
            sender.send(7).await?;
            Ok(())
        });
    });
    must_end_well("blocking receive", |system, sender| {
        let (early, late) = luna::channel::<()>();
        let early = early.external();
        let process = Placement::Thread.process(system, "other", "other");
        process.spawn_ok(async move {
            late.blocking_recv()?;
            sender.send(7).await?;
            Ok(())
        });
        std::thread::spawn(move || {
            std::thread::sleep(LONG);
            early.blocking_send(()).unwrap();
        });
    });
}

#[cfg(unix)]
#[test]
fn a_file_is_no_deadlock() {
    use std::io::{Read, Write};
    let _watchdog = watchdog();
    if !common::COMPLETE {
        return common::skip("the portable layer cannot wait for files");
    }
    for place in PLACEMENTS {
        let (mut near, mut far) = std::os::unix::net::UnixStream::pair().unwrap();
        must_end_well("file", move |system, sender| {
            let process = place.process(system, "other", "other");
            process.spawn_ok(async move {
                luna::external::readable(&near).await?;
                let mut byte = [0];
                near.read_exact(&mut byte)?;
                sender.send(u32::from(byte[0])).await?;
                Ok(())
            });
            std::thread::spawn(move || {
                std::thread::sleep(LONG);
                far.write_all(&[7]).unwrap();
            });
        });
    }
}

#[test]
fn a_plain_thread_is_no_deadlock_where_it_is_known() {
    let _watchdog = watchdog();
    // By the mark.
    must_end_well("marked", |_, sender| {
        let sender = sender.external();
        std::thread::spawn(move || {
            std::thread::sleep(LONG);
            sender.blocking_send(7).unwrap();
        });
    });
    // By what it has done before.
    let mut system = strict("used before");
    let (sender, receiver) = luna::buffered::<u32>(Buffer::fifo(1));
    let main = system.executor("main").build().unwrap();
    let process = main.process("sum");
    process.spawn_ok(async move {
        let mut sum = 0;
        for _ in 0..4 {
            sum += receiver.recv().await?;
        }
        assert_eq!(sum, 4);
        Ok(())
    });
    // Once before the start; then it is known.
    sender.try_send(1).unwrap();
    std::thread::spawn(move || {
        for _ in 0..3 {
            std::thread::sleep(LONG / 3);
            sender.blocking_send(1).unwrap();
        }
    });
    assert_eq!(system.run().unwrap().deadlock, None);
}

#[test]
fn at_a_barrier_a_thread_that_has_come_before_is_no_deadlock() {
    let _watchdog = watchdog();
    for place in PLACEMENTS {
        let mut system = strict("barrier");
        let barrier = Barrier::new(2);
        let party = barrier.clone();
        let (come, has_come) = std::sync::mpsc::channel();
        place
            .process(&mut system, "e", "party")
            .spawn_ok(async move {
                for _ in 0..3 {
                    party.sync().await;
                }
                Ok(())
            });
        let thread = std::thread::spawn(move || {
            for round in 0..3 {
                if round > 0 {
                    // So long that the others would have been found deadlocked.
                    std::thread::sleep(LONG / 3);
                }
                luna::run(async {
                    let mut came = std::pin::pin!(barrier.sync());
                    std::future::poll_fn(|cx| {
                        let polled = came.as_mut().poll(cx);
                        let _ = come.send(());
                        polled
                    })
                    .await;
                    Ok(())
                })
                .unwrap();
            }
        });
        has_come.recv().unwrap();
        assert_eq!(system.run().unwrap().deadlock, None);
        thread.join().unwrap();
    }
}

#[test]
fn what_is_none_of_lunas_may_wake_somebody() {
    let _watchdog = watchdog();
    let mut system = strict("foreign");
    let main = system.executor("main").build().unwrap();
    let (wake, woken) = mpsc::channel::<std::task::Waker>();
    main.process("foreign").spawn_ok(async move {
        let mut is_first = true;
        std::future::poll_fn(|cx| {
            if std::mem::take(&mut is_first) {
                wake.send(cx.waker().clone()).unwrap();
                return std::task::Poll::Pending;
            }
            std::task::Poll::Ready(())
        })
        .await;
        Ok(())
    });
    std::thread::spawn(move || {
        let waker = woken.recv().unwrap();
        std::thread::sleep(LONG);
        waker.wake();
    });
    assert_eq!(system.run().unwrap().deadlock, None);
}

/// Ends when the one before has, and holds what the next one waits for until it is reaped.
struct Link {
    before: luna::Receiver<()>,
    _next: luna::Sender<()>,
}

impl Process for Link {
    async fn run(&mut self) -> luna::Result<()> {
        assert!(self.before.recv().await.is_err());
        Ok(())
    }
}

#[test]
fn what_those_hold_that_are_not_reaped_yet_is_no_deadlock() {
    let _watchdog = watchdog();
    let rounds = if is_long() { 300 } else { 120 };
    for _ in 0..rounds {
        let mut system = strict("chain");
        let (first, mut before) = luna::channel();
        let executors = ["one", "other"].map(|name| system.executor(name).build().unwrap());
        for number in 0..4 {
            let (next, after) = luna::channel();
            let link = Link {
                before: std::mem::replace(&mut before, after),
                _next: next,
            };
            executors[number % 2]
                .process(format!("link {number}"))
                .spawn_ok(link);
        }
        executors[0].process("first").spawn_ok(async move {
            luna::after(Duration::from_millis(1)).await;
            drop(first);
            Ok(())
        });
        system.run().unwrap();
    }
}
