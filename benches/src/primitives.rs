//! The costs of the machine itself: bare loops and system calls, in the same rounds as the cases
//! built on them.
//!
//! The goals are figures of a reference machine; a multiple of this machine's primitives is more
//! meaningful than nanoseconds.

use std::{
    collections::VecDeque,
    fs::{File, OpenOptions},
    future::{Future, poll_fn},
    hint,
    io::Write,
    pin::Pin,
    sync::atomic::{AtomicU32, AtomicU64, Ordering},
    task::{Context, Poll, Waker},
    time::{Duration, Instant},
};

use core_affinity::CoreId;

use crate::{
    cores::{on_core, on_cores, one_core},
    harness::Case,
};

/// The scenario of primitives for comparison with figures of one core.
pub const PRIMITIVES: &str = "primitives, one core";

/// The peer name of [`spin`].
pub const SPIN: &str = "bare: spin";
/// The peer name of [`futex`].
pub const FUTEX: &str = "bare: futex";

/// The cases of [`PRIMITIVES`].
pub fn one_core_cases() -> Vec<Case> {
    let case = |peer, block: fn(u64) -> Duration| Case::new(PRIMITIVES, peer, "ns", block);
    vec![
        case("bare: poll through a queue", poll_through_queue),
        case("bare: compare-and-swap", compare_and_swap),
    ]
}

/// Two futures that only count, polled in turn through a queue: the lower limit for an executor of
/// boxed futures.
fn poll_through_queue(polls: u64) -> Duration {
    fn counting(count: &AtomicU64) -> Pin<Box<dyn Future<Output = ()> + '_>> {
        Box::pin(poll_fn(|_| {
            count.store(count.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
            Poll::Pending
        }))
    }

    on_core(one_core(), || {
        let count = AtomicU64::new(0);
        let mut queue = VecDeque::from([counting(&count), counting(&count)]);
        let mut context = Context::from_waker(Waker::noop());
        let start = Instant::now();
        for _ in 0..polls {
            let mut future = queue.pop_front().expect("there are two");
            let polled = future.as_mut().poll(&mut context);
            assert!(polled.is_pending(), "it never ends");
            queue.push_back(future);
        }
        let elapsed = start.elapsed();
        assert_eq!(count.load(Ordering::Relaxed), polls);
        elapsed
    })
}

/// A locked read-modify-write instruction without contention.
fn compare_and_swap(operations: u64) -> Duration {
    on_core(one_core(), || {
        let word = AtomicU64::new(0);
        let start = Instant::now();
        for number in 0..operations {
            let swapped =
                word.compare_exchange(number, number + 1, Ordering::AcqRel, Ordering::Acquire);
            assert!(swapped.is_ok(), "another thread wrote it");
        }
        start.elapsed()
    })
}

/// Two threads that pass a word back and forth, and never sleep. Returns how long `round_trips`
/// took.
///
/// # Panics
///
/// As [`on_cores`].
pub fn spin(cores: [CoreId; 2], round_trips: u64) -> Duration {
    let word = Word::default();
    let pass = |me: u32| {
        while word.turn.load(Ordering::Acquire) != me {
            hint::spin_loop();
        }
        word.turn.store(1 - me, Ordering::Release);
    };
    back_and_forth(cores, round_trips, pass)
}

/// Two threads that pass a word back and forth, and sleep in the kernel until it comes. Returns how
/// long `round_trips` took. The cores may be one.
///
/// # Panics
///
/// As [`on_cores`].
pub fn futex(cores: [CoreId; 2], round_trips: u64) -> Duration {
    let word = Word::default();
    let pass = |me: u32| {
        while word.turn.load(Ordering::Acquire) != me {
            futex_call(&word.turn, libc::FUTEX_WAIT, 1 - me);
        }
        word.turn.store(1 - me, Ordering::Release);
        futex_call(&word.turn, libc::FUTEX_WAKE, 1);
    };
    back_and_forth(cores, round_trips, pass)
}

/// The side with the next turn, on a cache line of its own.
#[derive(Default)]
#[repr(align(128))]
struct Word {
    turn: AtomicU32,
}

/// `pass(me)` waits for the turn of `me`, and passes it to the other.
fn back_and_forth(cores: [CoreId; 2], round_trips: u64, pass: impl Fn(u32) + Sync) -> Duration {
    let warm_up = round_trips / 16 + 1;
    on_cores(
        cores,
        || (0..warm_up + round_trips).for_each(|_| pass(1)),
        || {
            (0..warm_up).for_each(|_| pass(0));
            let start = Instant::now();
            (0..round_trips).for_each(|_| pass(0));
            start.elapsed()
        },
    )
}

fn futex_call(word: &AtomicU32, operation: libc::c_int, value: u32) {
    // SAFETY: the word is alive, and both operations read only the first four arguments: a null
    // pointer means no timeout. A wait that fails (the word has changed, a signal) returns, and its
    // caller checks again.
    unsafe {
        libc::syscall(
            libc::SYS_futex,
            word.as_ptr(),
            operation | libc::FUTEX_PRIVATE_FLAG,
            value,
            std::ptr::null::<libc::timespec>(),
        );
    }
}

/// Keeps idle cores awake (`/dev/cpu_dma_latency` at 0) while it lives.
#[derive(Debug)]
pub struct ShortWakeUps {
    _held: File,
}

impl ShortWakeUps {
    /// Nothing where the system does not allow it.
    pub fn hold() -> Option<Self> {
        let mut held = OpenOptions::new()
            .write(true)
            .open("/dev/cpu_dma_latency")
            .ok()?;
        held.write_all(&0_i32.to_ne_bytes()).ok()?;
        Some(ShortWakeUps { _held: held })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_does_what_it_counts() {
        let core = one_core();
        for block in [poll_through_queue, compare_and_swap] {
            assert!(block(10) > Duration::ZERO);
        }
        assert!(futex([core, core], 10) > Duration::ZERO);
    }
}
