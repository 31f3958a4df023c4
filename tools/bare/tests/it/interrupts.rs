//! Interrupts that communicate with processes.

use luna_bare::cpu;
use luna_channels::{Buffer, Receiver, Sender, alt, buffered, channel};
use luna_core::biased_lock::bias_after;
use luna_core::timer_queue::Sleep;
use luna_core::{Executor, ProcessSpec};
use luna_platform::clock::Instant;
use luna_platform::lock::PiLock;
use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Poll, Waker};
use std::time::Duration;

/// An interrupt that sends the numbers below `count`, and tries again those that do not fit.
fn source(priority: u8, sender: Sender<u64>, count: u64) {
    let next = Cell::new(0);
    cpu::add_interrupt(priority, move || {
        if sender.try_send(next.get()).is_ok() {
            next.set(next.get() + 1);
        }
        next.get() < count
    });
}

/// Fails unless the numbers come in their order, each once.
async fn expect(receiver: &Receiver<u64>, next: &mut u64) {
    assert_eq!(receiver.recv().await, Ok(*next), "lost or doubled");
    *next += 1;
}

#[test]
fn what_an_interrupt_sends_is_received() {
    cpu::begin(1, 0);
    let executor = Executor::new();
    let (sender, receiver) = buffered(Buffer::fifo(2));
    source(1, sender, 100);
    executor.spawn(ProcessSpec::new("process"), move || async move {
        let mut next = 0;
        while next < 100 {
            expect(&receiver, &mut next).await;
        }
    });
    executor.run();
    let (served, _, idled) = cpu::counts();
    assert!(served >= 100 && idled > 0, "{served} {idled}");
}

#[test]
fn an_interrupt_meets_a_process_that_waits_without_a_buffer() {
    cpu::begin(1, 0);
    let executor = Executor::new();
    let ((sender, receiver), (answers, answered)) = (channel(), channel());
    source(1, sender, 20);
    let seen = Cell::new(0);
    cpu::add_interrupt(2, move || {
        if let Ok(value) = answered.try_recv() {
            assert_eq!(value, seen.replace(value + 1));
        }
        seen.get() < 20_u64
    });
    executor.spawn(ProcessSpec::new("process"), move || async move {
        for next in 0..20 {
            assert_eq!(receiver.recv().await, Ok(next));
            answers.send(next).await.unwrap();
        }
    });
    executor.run();
}

#[test]
fn an_interrupt_wakes_by_a_waker() {
    cpu::begin(1, 0);
    let executor = Executor::new();
    let flag = Arc::new((PiLock::new(None::<Waker>), AtomicU64::new(0)));
    let raises = flag.clone();
    cpu::add_interrupt(1, move || {
        raises.1.fetch_add(1, Ordering::Release);
        // Not taken: an interrupt frees nothing.
        if let Some(waker) = &*raises.0.lock() {
            waker.wake_by_ref();
        }
        raises.1.load(Ordering::Relaxed) < 50
    });
    executor.spawn(ProcessSpec::new("process"), move || async move {
        for count in 1..=50 {
            std::future::poll_fn(|cx| {
                *flag.0.lock() = Some(cx.waker().clone());
                match flag.1.load(Ordering::Acquire) >= count {
                    true => Poll::Ready(()),
                    false => Poll::Pending,
                }
            })
            .await;
        }
    });
    executor.run();
}

#[test]
fn an_interrupt_asks_for_the_stop() {
    cpu::begin(1, 0);
    let executor = Executor::new();
    let handle = executor.handle().clone();
    cpu::add_interrupt(1, move || {
        handle.request_stop();
        false
    });
    let process = executor.spawn(ProcessSpec::new("process"), std::future::pending::<()>);
    executor.run();
    assert_eq!(process.exit(), Some(luna_core::Exit::Cancelled));
}

/// Two interrupts, of which one comes in the middle of the other, feed two buffers. A process takes
/// from both by alternatives, and passes what it gets to a more urgent one and by a buffer to a
/// less urgent one. A loop ticks. Returns the interrupts that came, and those in the middle of
/// another.
fn schedule(seed: u64) -> (u64, u64) {
    const COUNT: u64 = 4;
    // Every second time interrupts revoke the bias of locks.
    bias_after(if seed.is_multiple_of(2) { 1 } else { 16 });
    cpu::begin(seed, 3 + seed % 14);
    let executor = Executor::new();
    let (one, from_one) = buffered(Buffer::fifo(1 + (seed % 3) as usize));
    let (two, from_two) = buffered(Buffer::fifo(1));
    let ((urgent, from_urgent), (lazy, from_lazy)) = (channel(), buffered(Buffer::fifo(2)));
    source(1, one, COUNT);
    source(2, two, COUNT);
    executor.spawn(ProcessSpec::new("both").level(10), move || async move {
        let (mut first, mut second) = (0, 0);
        while first < COUNT || second < COUNT {
            alt! {
                value = from_one.recv(), if first < COUNT => {
                    assert_eq!(value, Ok(first), "seed {seed}");
                    first += 1;
                    urgent.send(value.unwrap()).await.unwrap();
                },
                value = from_two.recv(), if second < COUNT => {
                    assert_eq!(value, Ok(second), "seed {seed}");
                    second += 1;
                    lazy.send(value.unwrap()).await.unwrap();
                },
            }
        }
    });
    for (level, receiver) in [(20, from_urgent), (5, from_lazy)] {
        executor.spawn(ProcessSpec::new("end").level(level), move || async move {
            let mut next = 0;
            while next < COUNT {
                expect(&receiver, &mut next).await;
            }
            assert!(receiver.recv().await.is_err(), "seed {seed}: one too many");
        });
    }
    executor.spawn(ProcessSpec::new("loop").level(30), move || async move {
        let start = Instant::now();
        for tick in 1..4 {
            let deadline = start + Duration::from_micros(20 * tick);
            Sleep::until(deadline).await;
            assert!(Instant::now() >= deadline, "seed {seed}: too early");
        }
    });
    executor.run();
    let (served, nested, _) = cpu::counts();
    (served, nested)
}

#[test]
fn nothing_is_lost_or_doubled_whenever_interrupts_come() {
    let schedules = std::env::var("LUNA_SCHEDULES").ok();
    let schedules = schedules.map_or(10_000, |number| number.parse().expect("a number"));
    let (mut served, mut nested) = (0, 0);
    for seed in 0..schedules {
        let (more, in_others) = schedule(seed);
        served += more;
        nested += in_others;
    }
    println!(
        "{schedules} schedules, {served} interrupts, {nested} of them in the middle of another"
    );
    assert!(served > schedules * 8 && nested > schedules / 2);
}
