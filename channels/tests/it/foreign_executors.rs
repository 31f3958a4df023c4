//! The same network under every executor, and one network across all of them.

#![cfg(not(loom))]

use crate::common;
use common::Watchdog;
use futures_lite::StreamExt;
use futures_lite::future::zip;
use luna_channels::{Buffer, Receiver, RecvError, Sender, buffered, channel};
use luna_core::{Executor, Exit, OsThread, ProcessSpec};
use luna_platform::thread::Attributes;
use std::thread;

/// A pipeline of a producer, a filter and a consumer, the end of it all, and poison: within one
/// future.
async fn network() {
    for buffer in [None, Some(Buffer::fifo(1)), Some(Buffer::fifo(8))] {
        let make = || buffer.map_or_else(channel::<u64>, buffered);
        let ((numbers, to_double), (doubled, results)) = (make(), make());
        let produce = async move {
            for n in 0..200 {
                numbers.send(n).await.unwrap();
            }
        };
        let double = async move {
            while let Ok(n) = to_double.recv().await {
                doubled.send(2 * n).await.unwrap();
            }
        };
        let consume = async move {
            let sum: u64 = results.stream().fold(0, |sum, n| sum + n).await;
            assert_eq!(results.recv().await, Err(RecvError::Closed));
            sum
        };
        assert_eq!(zip(zip(produce, double), consume).await.1, 199 * 200);
    }
    let (sender, receiver) = channel::<u8>();
    let poisoned = zip(receiver.recv(), async { sender.poison() }).await.0;
    assert_eq!(poisoned, Err(RecvError::Poisoned));
}

/// The same with each part a task of its own, made by `spawn`; gives what its consumer is to
/// report.
fn tasks(
    spawn: &mut dyn FnMut(std::pin::Pin<Box<dyn Future<Output = ()> + Send>>),
) -> Receiver<u64> {
    let (numbers, to_add) = channel::<u64>();
    let (report, result) = buffered(Buffer::fifo(1));
    for part in 0..4 {
        let numbers = numbers.clone();
        spawn(Box::pin(async move {
            for n in 0..100 {
                numbers.send(part * 100 + n).await.unwrap();
            }
        }));
    }
    for _ in 0..3 {
        let (to_add, report) = (to_add.clone(), report.clone());
        spawn(Box::pin(async move {
            let mut sum = 0;
            while let Ok(n) = to_add.recv().await {
                sum += n;
            }
            report.send(sum).await.unwrap();
        }));
    }
    result
}

const SUM: u64 = 399 * 400 / 2;

fn total(result: &Receiver<u64>) -> u64 {
    std::iter::from_fn(|| result.blocking_recv().ok()).sum()
}

#[test]
fn on_a_plain_thread() {
    let _watchdog = Watchdog::new();
    futures_lite::future::block_on(network());
    let mut threads = Vec::new();
    let result = tasks(&mut |task| {
        threads.push(thread::spawn(move || futures_lite::future::block_on(task)))
    });
    assert_eq!(total(&result), SUM);
    threads
        .into_iter()
        .for_each(|thread| thread.join().unwrap());
}

#[test]
fn under_tokio() {
    let _watchdog = Watchdog::new();
    for mut builder in [
        tokio::runtime::Builder::new_current_thread(),
        tokio::runtime::Builder::new_multi_thread(),
    ] {
        let runtime = builder.worker_threads(2).build().unwrap();
        runtime.block_on(network());
        let sum = runtime.block_on(async {
            let result = tasks(&mut |task| drop(tokio::spawn(task)));
            result.stream().fold(0, |sum, part| sum + part).await
        });
        assert_eq!(sum, SUM);
    }
}

#[test]
fn a_timeout_of_tokio_withdraws() {
    let _watchdog = Watchdog::new();
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_time()
        .build()
        .unwrap();
    runtime.block_on(async {
        let (sender, receiver) = channel();
        let soon = std::time::Duration::from_millis(1);
        assert!(tokio::time::timeout(soon, sender.send(1)).await.is_err());
        assert!(tokio::time::timeout(soon, receiver.recv()).await.is_err());
        assert!(receiver.try_recv().unwrap_err().is_empty());
        assert!(sender.try_send(2).unwrap_err().is_full());
    });
}

#[test]
fn under_tokios_select_a_loser_is_withdrawn() {
    let _watchdog = Watchdog::new();
    let runtime = tokio::runtime::Builder::new_current_thread()
        .build()
        .unwrap();
    runtime.block_on(async {
        let ((left, from_left), (right, from_right)) = (channel(), buffered(Buffer::fifo(1)));
        right.try_send(7).unwrap();
        let received = tokio::select! {
            value = from_left.recv() => value,
            value = from_right.recv() => value,
        };
        assert_eq!(received, Ok(7));
        assert!(left.try_send(8).unwrap_err().is_full());
    });
}

#[test]
fn under_smols_local_executor() {
    let _watchdog = Watchdog::new();
    let executor = async_executor::LocalExecutor::new();
    futures_lite::future::block_on(executor.run(network()));
    let sum = futures_lite::future::block_on(executor.run(async {
        let result = tasks(&mut |task| executor.spawn(task).detach());
        result.stream().fold(0, |sum, part| sum + part).await
    }));
    assert_eq!(sum, SUM);
}

#[test]
fn under_lunas_executors() {
    let _watchdog = Watchdog::new();
    luna_core::block_on(network()).unwrap();
    let executors = ["one", "two"].map(|name| Executor::start(Attributes::new(name)).unwrap());
    executors.iter().for_each(Executor::release);
    assert_eq!(
        executors[0]
            .spawn(ProcessSpec::new("network"), network)
            .wait(),
        Exit::Completed
    );
    for executors in [&executors[..1], &executors[..]] {
        let mut level = 0;
        let result = tasks(&mut |task| {
            level += 1;
            executors[level % executors.len()]
                .spawn(ProcessSpec::new("part").level(level as u8), || task);
        });
        assert_eq!(total(&result), SUM);
    }
}

#[test]
fn in_processes_on_threads_of_their_own_which_may_block() {
    let _watchdog = Watchdog::new();
    let (sender, receiver) = channel::<u64>();
    let produce = OsThread::start(
        Attributes::new("produce"),
        ProcessSpec::new("produce"),
        move || async move {
            for n in 0..500 {
                // Both forms: more of them in one poll than are counted without letting others run.
                if n % 2 == 0 {
                    sender.blocking_send(n).unwrap();
                } else {
                    sender.send(n).await.unwrap();
                }
            }
        },
    );
    let produce = produce.unwrap();
    produce.release();
    assert_eq!(total(&receiver), 499 * 500 / 2);
    assert_eq!(produce.process().wait(), Exit::Completed);
}

#[test]
fn a_blocking_form_in_a_process_of_an_executor_is_refused_with_a_reason() {
    let _watchdog = Watchdog::new();
    let executor = Executor::start(Attributes::new("blocked")).unwrap();
    executor.release();
    let (sender, receiver) = channel::<u8>();
    let refused = |process: luna_core::ProcessHandle| match process.wait() {
        Exit::Panicked(message) => {
            assert!(message.contains("await the operation instead"), "{message}")
        }
        exit => panic!("{exit}"),
    };
    let end = sender.clone();
    refused(
        executor.spawn(ProcessSpec::new("send"), move || async move {
            end.blocking_send(1).unwrap()
        }),
    );
    refused(
        executor.spawn(ProcessSpec::new("recv"), move || async move {
            receiver.blocking_recv().map(drop).unwrap()
        }),
    );
    // And the process that was ended by it took its end with it.
    assert!(sender.try_send(1).unwrap_err().is_closed());
}

/// Adds one to each value on its way.
async fn stage(input: Receiver<u64>, output: Sender<u64>) {
    while let Ok(n) = input.recv().await {
        output.send(n + 1).await.unwrap();
    }
}

#[test]
fn one_network_across_all_of_them() {
    let _watchdog = Watchdog::new();
    let (sender, mut last) = channel::<u64>();
    let mut next = || {
        let (output, input) = channel();
        (std::mem::replace(&mut last, input), output)
    };
    let executor = Executor::start(Attributes::new("one of many")).unwrap();
    executor.release();
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .build()
        .unwrap();

    let (input, output) = next();
    executor.spawn(ProcessSpec::new("high").level(20), || stage(input, output));
    let (input, output) = next();
    runtime.spawn(stage(input, output));
    let (input, output) = next();
    executor.spawn(ProcessSpec::new("low").level(5), || stage(input, output));
    let (input, output) = next();
    let smol = thread::spawn(|| {
        let executor = async_executor::LocalExecutor::new();
        futures_lite::future::block_on(executor.run(stage(input, output)));
    });
    let (input, output) = next();
    let luna = thread::spawn(|| luna_core::block_on(stage(input, output)).unwrap());
    let (input, output) = next();
    let plain = thread::spawn(move || {
        while let Ok(n) = input.blocking_recv() {
            output.blocking_send(n + 1).unwrap();
        }
    });

    let feed = thread::spawn(move || (0..500).for_each(|n| sender.blocking_send(n).unwrap()));
    for n in 0..500 {
        assert_eq!(last.blocking_recv(), Ok(n + 6));
    }
    assert_eq!(
        last.blocking_recv(),
        Err(RecvError::Closed),
        "the end of the first passes through all"
    );
    for thread in [smol, luna, plain, feed] {
        thread.join().unwrap();
    }
}
