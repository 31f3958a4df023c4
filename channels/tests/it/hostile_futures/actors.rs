//! Wakers, values and closures with code that panics, and calls operations.

use crate::common::Random;
use crate::hostile_futures::world::World;
use luna_core::current;
use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::sync::{Arc, Weak};
use std::task::{RawWaker, RawWakerVTable, Waker};

/// What all panics of these tests carry.
struct Hostility;

/// Panics, without the hook's message. Not while a panic unwinds, which would end the program. Not
/// on an executor's thread outside of any process: a waker that panics there ends the executor, as
/// `luna-core` tests.
pub(crate) fn strike() {
    let ends_executor =
        current::timers().is_some() && current::process(|process| process.is_none());
    if !std::thread::panicking() && !ends_executor {
        resume_unwind(Box::new(Hostility));
    }
}

/// Messages of an operation that is polled after a panic in it, or after its closure panicked.
const EXPECTED: [&str; 4] = [
    "after it was over",
    "the closure of a `send_with` panicked",
    "resumed after panicking",
    "resumed after completion",
];

fn is_expected(payload: &(dyn Any + Send)) -> bool {
    let text = payload.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| payload.downcast_ref::<&str>().copied());
    payload.is::<Hostility>()
        || text.is_some_and(|text| EXPECTED.iter().any(|expected| text.contains(expected)))
}

/// Runs a piece of the test; `None` if it has panicked as it may. Any other panic ends the program:
/// its message was printed.
pub(crate) fn endure<R>(piece: impl FnOnce() -> R) -> Option<R> {
    match catch_unwind(AssertUnwindSafe(piece)) {
        Ok(result) => Some(result),
        Err(payload) if is_expected(&*payload) => None,
        Err(_) => {
            eprintln!("a panic that is not the test's own; see the message and the seed above");
            std::process::abort();
        }
    }
}

/// Lets the panics be silent that the tests expect.
pub(crate) fn silence_expected_panics() {
    let report = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if !is_expected(info.payload()) {
            report(info);
        }
    }));
}

/// Where a waker's code runs.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Call {
    Clone,
    Wake,
    Drop,
}

/// How a waker behaves, in parts of 256 of its calls.
#[derive(Clone, Copy, Default)]
pub(crate) struct Temper {
    pub(crate) panics: [u8; 3],
    /// How often it calls operations on the world first.
    pub(crate) touches: u8,
}

impl Temper {
    /// One that panics in each call of this kind, and calls operations in all.
    pub(crate) fn always(call: Call) -> Self {
        let mut temper = Self {
            touches: 255,
            ..Self::default()
        };
        temper.panics[call as usize] = 255;
        temper
    }
}

struct Plan {
    temper: Temper,
    random: AtomicU64,
    world: Weak<World>,
}

/// How many wakers there are.
pub(crate) static WAKERS: AtomicI64 = AtomicI64::new(0);

thread_local! {
    /// Operations that a waker calls may call wakers.
    static DEPTH: Cell<u32> = const { Cell::new(0) };
}

/// A waker that behaves as `temper` says.
pub(crate) fn waker(temper: Temper, world: &Arc<World>, seed: u64) -> Waker {
    let plan = Arc::new(Plan {
        temper,
        random: AtomicU64::new(seed),
        world: Arc::downgrade(world),
    });
    WAKERS.fetch_add(1, Ordering::Relaxed);
    // SAFETY: the table's functions keep to the contract of wakers: each counts its plan.
    unsafe { Waker::new(Arc::into_raw(plan).cast(), &TABLE) }
}

static TABLE: RawWakerVTable = RawWakerVTable::new(clone, wake, wake_by_ref, discard);

impl Plan {
    fn act(&self, call: Call) {
        let mut random = Random::new(self.random.fetch_add(1, Ordering::Relaxed));
        if random.chance(self.temper.touches) && DEPTH.get() < 2 {
            struct Leave;
            impl Drop for Leave {
                fn drop(&mut self) {
                    DEPTH.set(DEPTH.get() - 1);
                }
            }
            DEPTH.set(DEPTH.get() + 1);
            let _leave = Leave;
            // While a panic unwinds, one that comes of the operations must not leave this.
            if let Some(world) = self.world.upgrade() {
                match std::thread::panicking() {
                    true => drop(endure(|| world.touch(&mut random))),
                    false => world.touch(&mut random),
                }
            }
        }
        if random.chance(self.temper.panics[call as usize]) {
            strike();
        }
    }
}

unsafe fn clone(plan: *const ()) -> RawWaker {
    // SAFETY: the waker that is cloned counts the plan.
    unsafe {
        (*plan.cast::<Plan>()).act(Call::Clone);
        Arc::increment_strong_count(plan.cast::<Plan>());
    }
    WAKERS.fetch_add(1, Ordering::Relaxed);
    RawWaker::new(plan, &TABLE)
}

unsafe fn wake(plan: *const ()) {
    WAKERS.fetch_sub(1, Ordering::Relaxed);
    // SAFETY: the waker that is consumed counted the plan.
    unsafe { Arc::from_raw(plan.cast::<Plan>()) }.act(Call::Wake);
}

unsafe fn wake_by_ref(plan: *const ()) {
    // SAFETY: the waker counts the plan.
    unsafe { &*plan.cast::<Plan>() }.act(Call::Wake);
}

unsafe fn discard(plan: *const ()) {
    WAKERS.fetch_sub(1, Ordering::Relaxed);
    // SAFETY: the waker that is dropped counted the plan.
    unsafe { Arc::from_raw(plan.cast::<Plan>()) }.act(Call::Drop);
}

/// How many values there are.
pub(crate) static VALUES: AtomicI64 = AtomicI64::new(0);

/// A value that may panic in its drop. On the heap too, so that a memory checker sees a second
/// drop.
pub(crate) struct Value {
    state: Box<u64>,
    panics: bool,
}

const ALIVE: u64 = 0x5eed_0f11_fe00_0001;

impl Value {
    pub(crate) fn new(panics: bool) -> Self {
        VALUES.fetch_add(1, Ordering::Relaxed);
        Self {
            state: Box::new(ALIVE),
            panics,
        }
    }
}

impl Drop for Value {
    fn drop(&mut self) {
        assert_eq!(*self.state, ALIVE, "a value that is none any more");
        *self.state = 0;
        VALUES.fetch_sub(1, Ordering::Relaxed);
        if self.panics {
            strike();
        }
    }
}
