//! Executors: levels, bands, parallel constructs, spawning, blocking calls.

use super::{Outcome, Test, ensure, on_one_executor, platform, same};
use luna::{Policy, System, par};
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

pub(super) const TESTS: &[Test] = &[
    Test {
        name: "priority-order",
        component: "executors",
        shows: "of the processes that are ready, the one of the highest level runs",
        run: priority_order,
    },
    Test {
        name: "bands",
        component: "executors",
        shows: "an executor of higher policy interrupts a lower one that computes, on the same core",
        run: bands,
    },
    Test {
        name: "parallel",
        component: "csp",
        shows: "branches of par! run beside each other, and what one returns is there",
        run: parallel,
    },
    Test {
        name: "spawn",
        component: "csp",
        shows: "a process made while the system runs is part of it",
        run: spawn,
    },
    Test {
        name: "blocking-call",
        component: "executors",
        shows: "a blocking call waits on a thread of its own, and its executor goes on",
        run: blocking,
    },
    Test {
        name: "composition",
        component: "csp",
        shows: "the system can be looked at while it runs",
        run: composition,
    },
];

fn priority_order() -> Outcome {
    let order = Arc::new(Mutex::new(Vec::new()));
    let levels = [3, 31, 0, 12];
    on_one_executor(|executor| {
        for level in levels {
            let order = order.clone();
            let process = executor.process(format!("level {level}")).priority(level);
            process.spawn(async move {
                for _ in 0..3 {
                    if let Ok(mut order) = order.lock() {
                        order.push(level);
                    }
                    luna::yield_now().await;
                }
                Ok(())
            })?;
        }
        Ok(())
    })?;
    let order = order.lock().map(|order| order.clone()).unwrap_or_default();
    same(
        "the order",
        order,
        vec![31, 31, 31, 12, 12, 12, 3, 3, 3, 0, 0, 0],
    )?;
    Ok(format!("{} levels", levels.len()))
}

fn bands() -> Outcome {
    platform::need_real_time()?;
    let core = luna_platform::thread::available_cores()
        .last()
        .copied()
        .unwrap_or(0);
    let mut system = System::new("self-test");
    let low = system
        .executor("low")
        .core(core)
        .policy(Policy::fifo(20))
        .build()?;
    let high = system
        .executor("high")
        .core(core)
        .policy(Policy::fifo(30))
        .build()?;
    let came = Arc::new(AtomicBool::new(false));
    let (burns, burning) = luna::channel();
    let flag = came.clone();
    low.process("burns").spawn(async move {
        burns.send(()).await?;
        // Bounded, in case the other process never comes.
        let end = luna::now() + Duration::from_secs(2);
        while !flag.load(Ordering::Relaxed) && luna::now() < end {
            std::hint::spin_loop();
        }
        ensure(flag.load(Ordering::Relaxed), "the high one came between")
    })?;
    high.process("comes").spawn(async move {
        burning.recv().await?;
        luna::after(Duration::from_millis(2)).await;
        came.store(true, Ordering::Relaxed);
        Ok(())
    })?;
    let report = system.run()?;
    let policy = |name: &str| {
        let thread = report.threads.iter().find(|thread| thread.name == name);
        thread.map(|thread| thread.policy)
    };
    same("the low policy", policy("low"), Some(Policy::fifo(20)))?;
    same("the high policy", policy("high"), Some(Policy::fifo(30)))?;
    Ok("a burning process interrupted".to_owned())
}

fn parallel() -> Outcome {
    on_one_executor(|executor| {
        executor.process("parent").spawn(async {
            let (sender, receiver) = luna::channel();
            let (_, sum) = par!(
                async move {
                    for number in 1..=100_u32 {
                        sender.send(number).await?;
                    }
                    Ok::<(), luna::Error>(())
                },
                async move {
                    let mut sum = 0;
                    while let Ok(number) = receiver.recv().await {
                        sum += number;
                    }
                    Ok(sum)
                },
            )
            .await?;
            same("the sum", sum, 5050)
        })
    })?;
    Ok("2 branches".to_owned())
}

fn spawn() -> Outcome {
    let report = on_one_executor(|executor| {
        let also_here = executor.clone();
        executor.process("parent").spawn(async move {
            let (sender, receiver) = luna::channel();
            also_here.process("child").spawn(async move {
                sender.send(42).await?;
                Ok(())
            })?;
            same("the child's word", receiver.recv().await?, 42)
        })
    })?;
    same("processes in the report", report.processes.len(), 2)?;
    Ok("1 child".to_owned())
}

fn blocking() -> Outcome {
    on_one_executor(|executor| {
        // The call ends only when the other process has run meanwhile.
        let (release, released) = std::sync::mpsc::channel();
        let (begins, begun) = luna::channel();
        executor.process("caller").priority(20).spawn(async move {
            let call = luna::blocking(move || {
                // It runs: the executor may go on.
                begins.blocking_send(()).is_ok()
                    && released.recv_timeout(Duration::from_secs(10)).is_ok()
            });
            ensure(call.await, "the executor went on")
        })?;
        executor.process("other").priority(10).spawn(async move {
            begun.recv().await?;
            release.send(()).map_err(luna::Error::other)
        })
    })?;
    Ok("1 call".to_owned())
}

fn composition() -> Outcome {
    let mut system = System::new("self-test");
    let executor = system.executor("main").build()?;
    let observer = system.observer();
    executor.process("seen").spawn(async move {
        let composition = luna::blocking(move || observer.composition()).await;
        ensure(composition.find("seen").is_some(), "the process is seen")
    })?;
    system.run()?;
    Ok("1 process found".to_owned())
}
