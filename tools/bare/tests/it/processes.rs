//! Processes on the CPU: their order, and how they communicate.

use luna_bare::cpu;
use luna_channels::{Buffer, RecvTimeoutError, after, alt, buffered, channel, pri_alt};
use luna_core::timer_queue::Sleep;
use luna_core::{Executor, Exit, ProcessSpec, yield_now};
use luna_platform::clock::Instant;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

/// What happened, in order.
#[derive(Clone, Default)]
struct Log(Arc<Mutex<Vec<u32>>>);

impl Log {
    fn add(&self, entry: u32) {
        self.0.lock().unwrap().push(entry);
    }

    fn take(&self) -> Vec<u32> {
        std::mem::take(&mut self.0.lock().unwrap())
    }
}

fn at(level: u8) -> ProcessSpec {
    ProcessSpec::new("process").level(level)
}

#[test]
fn higher_levels_come_first_and_equals_in_the_order_of_their_arrival() {
    cpu::begin(1, 0);
    let (executor, log) = (Executor::new(), Log::default());
    for (number, level) in [(1, 5), (2, 20), (3, 5), (4, 31)] {
        let log = log.clone();
        executor.spawn(at(level), move || async move {
            log.add(number);
            yield_now().await;
            log.add(number + 10);
        });
    }
    executor.run();
    assert_eq!(log.take(), [4, 14, 2, 12, 1, 3, 11, 13]);
}

#[test]
fn a_communication_is_a_scheduling_point() {
    cpu::begin(1, 0);
    let (executor, log) = (Executor::new(), Log::default());
    let (sender, receiver) = channel();
    let (low, high) = (log.clone(), log.clone());
    executor.spawn(at(30), move || async move {
        while let Ok(value) = receiver.recv().await {
            high.add(value);
        }
    });
    executor.spawn(at(3), move || async move {
        for value in 1..4 {
            sender.send(value).await.unwrap();
            low.add(value + 10);
        }
    });
    executor.run();
    assert_eq!(log.take(), [1, 11, 2, 12, 3, 13]);
}

#[test]
fn a_buffer_holds_what_is_sent_until_it_is_received() {
    cpu::begin(1, 0);
    let (executor, log) = (Executor::new(), Log::default());
    let (sender, receiver) = buffered(Buffer::fifo(2));
    let sends = log.clone();
    executor.spawn(at(9), move || async move {
        for value in 0..5 {
            sender.send(value).await.unwrap();
            sends.add(value + 10);
        }
    });
    let receives = log.clone();
    executor.spawn(at(8), move || async move {
        while let Ok(value) = receiver.recv().await {
            receives.add(value);
        }
    });
    executor.run();
    let order = log.take();
    assert_eq!(order[..2], [10, 11], "two fit");
    let received: Vec<_> = order.into_iter().filter(|&entry| entry < 10).collect();
    assert_eq!(received, [0, 1, 2, 3, 4]);
}

#[test]
fn alternatives_choose_fairly_or_by_priority() {
    cpu::begin(1, 0);
    for is_fair in [true, false] {
        let (executor, log) = (Executor::new(), Log::default());
        let ((one, from_one), (two, from_two)) = (channel(), channel());
        for (sender, base) in [(one, 0), (two, 10)] {
            executor.spawn(at(5), move || async move {
                for value in 0..3 {
                    sender.send(base + value).await.unwrap();
                }
                std::future::pending::<()>().await;
            });
        }
        let (chosen, handle) = (log.clone(), executor.handle().clone());
        executor.spawn(at(4), move || async move {
            for _ in 0..6 {
                let value = match is_fair {
                    true => alt! { one = from_one.recv() => one, two = from_two.recv() => two },
                    false => {
                        pri_alt! { one = from_one.recv() => one, two = from_two.recv() => two }
                    }
                };
                chosen.add(value.unwrap());
            }
            handle.request_stop();
        });
        executor.run();
        let expected = match is_fair {
            true => [0, 10, 1, 11, 2, 12],
            false => [0, 1, 2, 10, 11, 12],
        };
        assert_eq!(log.take(), expected);
    }
}

#[test]
fn deadlines_come_in_their_order_on_the_ports_clock() {
    cpu::begin(1, 0);
    let (executor, log) = (Executor::new(), Log::default());
    let start = Instant::now();
    for number in [3, 1, 2] {
        let log = log.clone();
        executor.spawn(at(5), move || async move {
            Sleep::until(start + MS * number).await;
            log.add(number);
            assert!(Instant::now() >= start + MS * number);
            assert!(
                Instant::now() < start + MS * number + MS / 10,
                "it idled until then"
            );
        });
    }
    executor.run();
    assert_eq!(log.take(), [1, 2, 3]);
    let (.., idled) = cpu::counts();
    assert!(idled >= 3);
}

#[test]
fn a_busy_executor_sees_its_deadlines() {
    cpu::begin(1, 0);
    let (executor, log) = (Executor::new(), Log::default());
    let (start, handle) = (Instant::now(), executor.handle().clone());
    let slept = log.clone();
    executor.spawn(at(20), move || async move {
        Sleep::until(start + MS).await;
        slept.add(1);
        handle.request_stop();
    });
    executor.spawn(at(5), || async {
        loop {
            cpu::advance(1_000);
            assert!(
                Instant::now() < Instant::from_nanos(1_100_000_000),
                "it starves"
            );
            yield_now().await;
        }
    });
    executor.run();
    assert_eq!(log.take(), [1]);
    assert!(Instant::now() - start < MS + MS / 2);
}

#[test]
fn timeouts_and_delays_end_waits() {
    cpu::begin(1, 0);
    let executor = Executor::new();
    let (sender, receiver) = channel::<u32>();
    let (start, log) = (Instant::now(), Log::default());
    let chosen = log.clone();
    executor.spawn(at(5), move || async move {
        let late = receiver.recv_timeout(MS).await;
        assert_eq!(late, Err(RecvTimeoutError::Timeout));
        assert!(Instant::now() - start >= MS);
        let chose = alt! {
            value = receiver.recv() => value.unwrap(),
            _ = after(MS) => 99,
        };
        chosen.add(chose);
        assert_eq!(receiver.recv_timeout(MS).await, Ok(4));
    });
    executor.spawn(at(5), move || async move {
        Sleep::until(start + MS * 2 + MS / 2).await;
        sender.send(4).await.unwrap();
    });
    executor.run();
    assert_eq!(log.take(), [99]);
}

#[test]
fn a_stop_cancels_what_is_left_and_handles_know_the_ends() {
    cpu::begin(1, 0);
    let executor = Executor::new();
    let handle = executor.handle().clone();
    let done = executor.spawn(at(9), || async {});
    let left = executor.spawn(at(9), std::future::pending::<()>);
    executor.spawn(at(1), move || async move { handle.request_stop() });
    executor.run();
    assert_eq!(done.exit(), Some(Exit::Completed));
    assert_eq!(left.exit(), Some(Exit::Cancelled));
}

#[test]
fn processes_spawn_and_join_others() {
    cpu::begin(1, 0);
    let (executor, log) = (Executor::new(), Log::default());
    let (handle, results) = (executor.handle().clone(), log.clone());
    executor.spawn(at(9), move || async move {
        for number in 0..20 {
            let child = results.clone();
            let process = handle.spawn(at(8), move || async move { child.add(number) });
            assert_eq!(process.join().await, Exit::Completed);
            results.add(number + 100);
        }
    });
    executor.run();
    let expected: Vec<u32> = (0..20).flat_map(|number| [number, number + 100]).collect();
    assert_eq!(log.take(), expected);
}

#[test]
fn one_that_never_runs_ends_its_processes() {
    cpu::begin(1, 0);
    let executor = Executor::new();
    let process = executor.spawn(at(9), || async {});
    drop(executor);
    assert_eq!(process.exit(), Some(Exit::Cancelled));
}
