//! Waiters are served by priority, then by arrival; and a communication lets the more urgent run.
//! Golden orders on one executor, where new channels take the slow path, and those that were used
//! for long the fast path.

#![cfg(not(loom))]

use crate::common;
use common::Watchdog;
use luna_channels::{Barrier, Buffer, Receiver, Sender, buffered, channel, lock_sync};
use luna_core::current::OPERATIONS_PER_POLL;
use luna_core::{Executor, Exit, ProcessHandle, ProcessSpec};
use luna_platform::thread::Attributes;
use std::sync::{Arc, Mutex};

/// So many uses by one executor that a lock is biased to it from some point on.
const WARM: usize = 100;

/// Whether a channel is new, or its lock biased to the executor.
const IS_BIASED: [bool; 2] = [false, true];

/// What happened, in order.
#[derive(Clone, Default)]
struct Log(Arc<Mutex<Vec<String>>>);

impl Log {
    fn add(&self, what: impl Into<String>) {
        self.0.lock().unwrap().push(what.into());
    }

    fn entries(&self) -> Vec<String> {
        self.0.lock().unwrap().clone()
    }
}

/// One executor. Its processes start together.
struct Stage {
    executor: Executor,
    processes: Vec<ProcessHandle>,
    log: Log,
    _watchdog: Watchdog,
}

impl Stage {
    fn new() -> Stage {
        Stage {
            executor: Executor::start(Attributes::new("stage")).unwrap(),
            processes: Vec::new(),
            log: Log::default(),
            _watchdog: Watchdog::new(),
        }
    }

    fn process<F: Future<Output = ()> + 'static>(
        &mut self,
        level: u8,
        body: impl FnOnce(Log) -> F + Send + 'static,
    ) {
        let log = self.log.clone();
        let spec = ProcessSpec::new(format!("{} at {level}", self.processes.len())).level(level);
        self.processes
            .push(self.executor.spawn(spec, move || body(log)));
    }

    /// Before other processes run, lets the lock of a channel be biased to the executor.
    fn bias<T: Send + 'static>(&mut self, receiver: &Receiver<T>) {
        let receiver = receiver.clone();
        self.process(31, move |_| async move {
            for _ in 0..WARM {
                assert!(receiver.try_recv().is_err());
            }
        });
    }

    /// Lets them run to their ends.
    #[track_caller]
    fn run(self) -> Vec<String> {
        self.executor.settle();
        self.executor.release();
        for process in &self.processes {
            assert_eq!(process.wait(), Exit::Completed, "{}", process.name());
        }
        self.log.entries()
    }
}

/// Processes at these levels, one after the other, come to wait on one channel; then each is
/// served. Gives the order of service.
///
/// The director is at the lowest level: each gate that it opens lets a process run until it waits
/// on the channel.
fn order_of_service(
    levels: &'static [u8],
    they_send: bool,
    buffer: Option<Buffer>,
    is_biased: bool,
) -> Vec<String> {
    let mut stage = Stage::new();
    let (sender, receiver) = buffer.map_or_else(channel::<String>, buffered);
    if is_biased {
        stage.bias(&receiver);
    }
    let mut gates = Vec::new();
    for (number, &level) in levels.iter().enumerate() {
        let (open, gate) = channel::<()>();
        gates.push(open);
        let (sender, receiver) = (sender.clone(), receiver.clone());
        stage.process(level, move |log| async move {
            gate.recv().await.unwrap();
            if they_send {
                sender.send(format!("{number} at {level}")).await.unwrap();
            } else {
                receiver.recv().await.unwrap();
                log.add(format!("{number} at {level}"));
            }
        });
    }
    stage.process(0, move |log| async move {
        if they_send && buffer.is_some() {
            sender.send("buffered".to_owned()).await.unwrap();
        }
        for gate in &gates {
            gate.send(()).await.unwrap();
        }
        for _ in &gates {
            if they_send {
                log.add(receiver.recv().await.unwrap());
            } else {
                sender.send(String::new()).await.unwrap();
            }
        }
        if they_send && buffer.is_some() {
            log.add(receiver.recv().await.unwrap());
        }
    });
    stage.run()
}

#[test]
fn receivers_are_served_by_level_then_by_arrival() {
    for is_biased in IS_BIASED {
        let order = order_of_service(&[5, 20, 10, 5, 31, 10, 20, 1], false, None, is_biased);
        assert_eq!(
            order,
            [
                "4 at 31", "1 at 20", "6 at 20", "2 at 10", "5 at 10", "0 at 5", "3 at 5", "7 at 1"
            ]
        );
    }
}

#[test]
fn senders_are_served_by_level_then_by_arrival() {
    for is_biased in IS_BIASED {
        let order = order_of_service(&[5, 20, 10, 5, 31, 10, 20, 1], true, None, is_biased);
        assert_eq!(
            order,
            [
                "4 at 31", "1 at 20", "6 at 20", "2 at 10", "5 at 10", "0 at 5", "3 at 5", "7 at 1"
            ]
        );
    }
}

#[test]
fn those_that_wait_for_room_move_up_by_level_too() {
    for is_biased in IS_BIASED {
        let order = order_of_service(&[5, 20, 10, 5], true, Some(Buffer::fifo(1)), is_biased);
        assert_eq!(
            order,
            ["buffered", "1 at 20", "2 at 10", "0 at 5", "3 at 5"]
        );
    }
}

/// A process at `level` waits in a receive; then one at level 10 sends to it, when all others wait.
fn send_to_a_receiver_at(level: u8, is_biased: bool) -> Vec<String> {
    let mut stage = Stage::new();
    let ((sender, receiver), (open, gate)) = (channel(), channel());
    if is_biased {
        stage.bias(&receiver);
    }
    stage.process(level, move |log| async move {
        let value: u32 = receiver.recv().await.unwrap();
        log.add(format!("receiver has {value}"));
    });
    stage.process(10, move |log| async move {
        gate.recv().await.unwrap();
        log.add("before");
        sender.send(7).await.unwrap();
        log.add("after");
    });
    stage.process(0, move |_| async move { open.send(()).await.unwrap() });
    stage.run()
}

#[test]
fn a_receiver_of_higher_level_runs_before_its_sender_goes_on() {
    for (level, is_biased) in [(11, false), (31, false), (11, true), (31, true)] {
        assert_eq!(
            send_to_a_receiver_at(level, is_biased),
            ["before", "receiver has 7", "after"]
        );
    }
}

#[test]
fn a_receiver_of_equal_or_lower_level_does_not() {
    for level in [10, 9, 0] {
        for is_biased in IS_BIASED {
            assert_eq!(
                send_to_a_receiver_at(level, is_biased),
                ["before", "after", "receiver has 7"]
            );
        }
    }
}

/// A process at `level` waits in a send; then one at level 10 receives from it.
fn receive_from_a_sender_at(level: u8, buffer: Option<Buffer>, is_biased: bool) -> Vec<String> {
    let mut stage = Stage::new();
    let (sender, receiver) = buffer.map_or_else(channel::<u32>, buffered);
    if is_biased {
        stage.bias(&receiver);
    }
    stage.process(level, move |log| async move {
        if buffer.is_some() {
            sender.send(0).await.unwrap();
        }
        sender.send(7).await.unwrap();
        log.add("sender goes on");
    });
    stage.process(if level < 10 { level } else { 10 }, move |log| async move {
        log.add("before");
        receiver.recv().await.unwrap();
        log.add("after");
        if buffer.is_some() {
            receiver.recv().await.unwrap();
        }
    });
    stage.run()
}

#[test]
fn a_sender_of_higher_level_runs_before_its_receiver_goes_on() {
    for buffer in [None, Some(Buffer::fifo(1))] {
        for is_biased in IS_BIASED {
            assert_eq!(
                receive_from_a_sender_at(11, buffer, is_biased),
                ["before", "sender goes on", "after"]
            );
            assert_eq!(
                receive_from_a_sender_at(10, buffer, is_biased),
                ["before", "after", "sender goes on"]
            );
        }
    }
}

#[test]
fn one_that_gave_way_comes_before_the_others_of_its_level() {
    for is_biased in IS_BIASED {
        let mut stage = Stage::new();
        let (sender, receiver) = channel();
        if is_biased {
            stage.bias(&receiver);
        }
        stage.process(20, move |log| async move {
            receiver.recv().await.unwrap();
            log.add("high");
        });
        stage.process(10, move |log| async move {
            sender.send(()).await.unwrap();
            log.add("sender");
        });
        stage.process(10, |log| async move { log.add("another") });
        assert_eq!(stage.run(), ["high", "sender", "another"]);
    }
}

/// In each round both have come when the less urgent one comes.
#[test]
fn a_more_urgent_party_goes_on_before_the_one_that_completes_the_round() {
    let mut stage = Stage::new();
    let barrier = Barrier::new(2);
    for (level, name) in [(20, "high"), (10, "low")] {
        let barrier = barrier.clone();
        stage.process(level, move |log| async move {
            for _ in 0..WARM {
                barrier.sync().await;
                log.add(name);
            }
        });
    }
    assert_eq!(stage.run(), ["high", "low"].repeat(WARM));
}

#[test]
fn a_more_urgent_process_runs_before_a_free_mutex_is_locked() {
    let mut stage = Stage::new();
    let mutex = lock_sync::Mutex::new(());
    let (sender, receiver) = channel();
    let wanted = mutex.clone();
    stage.process(20, move |log| async move {
        while receiver.recv().await.is_ok() {
            assert!(wanted.try_lock().is_ok());
            log.add("high");
        }
    });
    stage.process(10, move |log| async move {
        for _ in 0..WARM {
            sender.try_send(()).unwrap(); // readies the other one, and goes on
            let _guard = mutex.lock().await.unwrap();
            log.add("low holds it");
        }
    });
    assert_eq!(stage.run(), ["high", "low holds it"].repeat(WARM));
}

#[test]
fn what_a_process_communicates_before_it_gives_way_stays_communicated_if_it_is_cancelled_there() {
    let mut stage = Stage::new();
    let (sender, receiver) = channel();
    let (notify, notified) = channel::<ProcessHandle>();
    stage.process(20, move |log| async move {
        let sending = notified.recv().await.unwrap();
        log.add(format!("received {}", receiver.recv().await.unwrap()));
        sending.cancel(); // while it lets this one run
        log.add(format!("{}", sending.join().await));
        assert!(receiver.recv().await.unwrap_err().is_closed());
    });
    let sending = stage
        .executor
        .spawn(ProcessSpec::new("sending").level(5), move || async move {
            sender.send(7).await.unwrap();
            unreachable!("it is cancelled before it goes on");
        });
    stage.process(
        10,
        move |_| async move { notify.send(sending).await.unwrap() },
    );
    assert_eq!(stage.run(), ["received 7", "cancelled"]);
}

#[test]
fn what_a_process_received_before_it_gave_way_goes_back_if_it_is_cancelled_there() {
    let mut stage = Stage::new();
    let (sender, receiver) = channel();
    let (notify, notified) = channel::<ProcessHandle>();
    let again = receiver.clone();
    stage.process(20, move |log| async move {
        let receiving = notified.recv().await.unwrap();
        // Waits, is taken, and this process continues before its receiver.
        sender.send(7).await.unwrap();
        receiving.cancel();
        log.add(format!("{}", receiving.join().await));
        log.add(format!("again {}", again.recv().await.unwrap()));
    });
    let receiving =
        stage
            .executor
            .spawn(ProcessSpec::new("receiving").level(5), move || async move {
                receiver.recv().await.unwrap();
                unreachable!("it is cancelled before it goes on");
            });
    stage.process(
        10,
        move |_| async move { notify.send(receiving).await.unwrap() },
    );
    assert_eq!(stage.run(), ["cancelled", "again 7"]);
}

/// A process with operations that always complete at once, beside others. Returns how many it had
/// completed when the others ran.
fn hog(body: impl AsyncFn(&Sender<u32>, &Receiver<u32>) + Send + 'static) -> Vec<String> {
    let mut stage = Stage::new();
    let (sender, receiver) = buffered(Buffer::fifo(OPERATIONS_PER_POLL as usize * 4));
    for n in 0..OPERATIONS_PER_POLL * 3 {
        sender.try_send(n).unwrap();
    }
    let completed = Arc::new(Mutex::new(0_u32));
    let count = completed.clone();
    stage.process(10, move |_| async move {
        for _ in 0..OPERATIONS_PER_POLL * 3 / 2 {
            body(&sender, &receiver).await;
            *count.lock().unwrap() += 1;
        }
    });
    for _ in 0..2 {
        let completed = completed.clone();
        stage.process(10, move |log| async move {
            log.add(completed.lock().unwrap().to_string())
        });
    }
    stage.run()
}

#[test]
fn operations_that_complete_at_once_let_others_run_after_a_bounded_number() {
    let most = OPERATIONS_PER_POLL.to_string();
    assert_eq!(
        hog(async |_, receiver| assert!(receiver.recv().await.is_ok())),
        [&*most, &*most]
    );
    assert_eq!(
        hog(async |sender, receiver| {
            receiver.try_recv().unwrap(); // does not wait, and does not count
            sender.send(1).await.unwrap();
        }),
        [&*most, &*most]
    );
    let mutex = lock_sync::Mutex::new(());
    assert_eq!(
        hog(async move |_, _| assert!(mutex.lock().await.is_ok())),
        [&*most, &*most]
    );
    let alone = Barrier::new(1);
    assert_eq!(hog(async move |_, _| alone.sync().await), [&*most, &*most]);
}
