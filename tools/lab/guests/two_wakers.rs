//! Whether a futex wake relies on another thread that wakes the same one. No part of LUNA is used.
//!
//! On processor 0: a thread of SCHED_FIFO 80 waits in a futex. One of 20 wakes it again and again.
//! One of 70 comes in between at random instants and wakes it too: then the waiting thread should
//! have run before the call returns. With PREEMPT_RT it has not if the lower waker has lost the
//! processor inside of its call, where it has taken the waiting thread off the futex and has not
//! readied it yet: the kernel readies it when the lower waker runs again.
//!
//! Then with one waker alone, of SCHED_FIFO 20 and of SCHED_OTHER, and a thread of 50 that comes in
//! between and computes: how often the woken thread of 80 runs only when that one is done, so that
//! a thread of lower priority has held it up. Among
//! them are those in which the waker lost the processor between its look at the clock and its call:
//! the same on a kernel that is not PREEMPT_RT shows how many.

use luna_machine::memory::lock_memory;
use luna_platform::clock::Instant;
use luna_platform::futex::Futex;
use luna_platform::thread::{Attributes, Mode, Policy, Thread, spawn};
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

const WAKES: u64 = 2000;

struct Shared {
    futex: Futex,
    asked: AtomicU64,
    seen: AtomicU64,
    over: AtomicBool,
}

fn thread<T: Send + 'static>(
    name: &str,
    priority: u8,
    body: impl FnOnce() -> T + Send + 'static,
) -> Thread<T> {
    let attributes = Attributes::new(name).core(0).policy(Policy::fifo(priority));
    let set_up = |_: &_| Ok::<_, Infallible>(());
    spawn(attributes.mode(Mode::Strict), set_up, |()| body()).expect("SCHED_FIFO is allowed")
}

fn main() {
    let _locked = lock_memory();
    two_wakers();
    for policy in [Policy::fifo(20), Policy::Other] {
        one_waker(policy);
    }
}

/// How long the thread in between computes.
const BURST: Duration = Duration::from_micros(300);

/// What one waker and the thread that it wakes share.
struct Call {
    futex: Futex,
    /// When it was made, in nanoseconds.
    asked: AtomicU64,
    seen: AtomicU64,
    late: AtomicU64,
    over: AtomicBool,
}

fn one_waker(policy: Policy) {
    let call = Arc::new(Call {
        futex: Futex::new(0),
        asked: AtomicU64::new(0),
        seen: AtomicU64::new(0),
        late: AtomicU64::new(0),
        over: AtomicBool::new(false),
    });
    let (woken, between, low) = (call.clone(), call.clone(), call.clone());
    let woken = thread("woken", 80, move || {
        loop {
            woken.futex.wait(0, Instant::NEVER);
            if woken.over.load(Ordering::SeqCst) {
                return;
            }
            if woken.futex.word().swap(0, Ordering::SeqCst) == 0 {
                continue;
            }
            let asked = woken.asked.load(Ordering::SeqCst);
            let took = Instant::now().nanos_since(Instant::from_nanos(asked));
            let is_late = Duration::from_nanos(took) > BURST * 2 / 3;
            woken.late.fetch_add(u64::from(is_late), Ordering::SeqCst);
            woken.seen.fetch_add(1, Ordering::SeqCst);
        }
    });
    let between = thread("between", 50, move || {
        let (mut random, never_woken) = (7_u64, Futex::new(0));
        while !between.over.load(Ordering::SeqCst) {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            let until = Instant::now() + Duration::from_nanos(20_000 + random % 80_000);
            while Instant::now() < until {
                never_woken.wait(0, until);
            }
            let until = Instant::now() + BURST;
            while Instant::now() < until {
                std::hint::spin_loop();
            }
        }
    });
    let attributes = Attributes::new("low").core(0).policy(policy);
    let set_up = |_: &_| Ok::<_, Infallible>(());
    let lower = spawn(attributes.mode(Mode::Strict), set_up, move |()| {
        for number in 1..=WAKES {
            low.futex.word().store(1, Ordering::SeqCst);
            low.asked.store(Instant::now().as_nanos(), Ordering::SeqCst);
            low.futex.wake_one();
            while low.seen.load(Ordering::SeqCst) != number {
                std::hint::spin_loop();
            }
        }
    });
    lower.expect("it starts").join().expect("it does not panic");
    call.over.store(true, Ordering::SeqCst);
    call.futex.word().store(1, Ordering::SeqCst);
    call.futex.wake_one();
    woken.join().expect("it does not panic");
    between.join().expect("it does not panic");
    let late = call.late.load(Ordering::SeqCst);
    println!(
        "one waker of {policy}: {late} of {WAKES} wakes came when a thread in between was done"
    );
}

fn two_wakers() {
    let shared = Arc::new(Shared {
        futex: Futex::new(0),
        asked: AtomicU64::new(0),
        seen: AtomicU64::new(0),
        over: AtomicBool::new(false),
    });
    let wake = |shared: &Shared| {
        shared.futex.word().store(1, Ordering::SeqCst);
        shared.futex.wake_one();
    };
    let (own, low, high) = (shared.clone(), shared.clone(), shared);
    let woken = thread("woken", 80, move || {
        while !own.over.load(Ordering::SeqCst) {
            own.futex.word().store(0, Ordering::SeqCst);
            let asked = own.asked.load(Ordering::SeqCst);
            own.seen.store(asked, Ordering::SeqCst);
            if own.asked.load(Ordering::SeqCst) == asked {
                own.futex.wait(0, Instant::NEVER);
            }
        }
    });
    let high = thread("high", 70, move || {
        let (mut late, mut random) = (0, 1_u64);
        let never_woken = Futex::new(0);
        for number in 1..=WAKES {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            let until = Instant::now() + Duration::from_nanos(10_000 + random % 60_000);
            while Instant::now() < until {
                never_woken.wait(0, until);
            }
            high.asked.store(number, Ordering::SeqCst);
            wake(&high);
            late += u64::from(high.seen.load(Ordering::SeqCst) != number);
        }
        high.over.store(true, Ordering::SeqCst);
        wake(&high);
        late
    });
    let low = thread("low", 20, move || {
        while !low.over.load(Ordering::SeqCst) {
            wake(&low);
        }
    });
    let late = high.join().expect("it does not panic");
    println!("two wakers: {late} of {WAKES} wakes had not come when they returned");
    low.join().expect("it does not panic");
    woken.join().expect("it does not panic");
}
