//! Blocking a thread until it is woken, and until a future is done.

use crate::current;
use crate::deferred_free::Shared;
use core::cell::Cell;
use core::future::Future;
use core::mem::ManuallyDrop;
use core::pin::{Pin, pin};
use core::task::{Context, Poll, RawWaker, RawWakerVTable, Waker};
use luna_platform::bell::Bell;
use luna_platform::clock::{Clock, Instant};
use luna_platform::futex::Waited;
use luna_platform::sync::atomic::{AtomicU32, Ordering};

const EMPTY: u32 = 0;
/// The thread sleeps or is about to. The thread itself clears this when it is awake.
const PARKED: u32 = 1;
/// The thread was woken.
const NOTIFIED: u32 = 2;

/// Lets one thread sleep until others wake it. An earlier wake is kept. Real-time path: yes; a
/// system call only to sleep, and to wake a sleeping thread.
///
/// ```
/// use luna_platform::clock::Instant;
/// use luna_core::park::Parker;
///
/// let parker = Parker::new();
/// parker.unpark();
/// assert!(parker.park(Instant::NEVER)); // at once: the wake came first
/// assert!(!parker.park(Instant::now())); // the deadline came
/// ```
#[derive(Debug)]
pub struct Parker {
    /// The word of the [`Bell`]'s protocol.
    state: AtomicU32,
    bell: Bell,
}

impl Default for Parker {
    fn default() -> Self {
        Self::new()
    }
}

impl Parker {
    /// A parker without a wake.
    pub fn new() -> Self {
        Self {
            state: AtomicU32::new(EMPTY),
            bell: Bell::new(),
        }
    }

    /// The bell that the thread sleeps in.
    pub fn bell(&self) -> &Bell {
        &self.bell
    }

    /// Sleeps until a wake, which it takes, or until `deadline`; returns whether it was woken.
    /// Called by one thread alone. A thread with a virtual clock sleeps for as long on the
    /// machine's.
    pub fn park(&self, deadline: Instant) -> bool {
        self.park_between(deadline, || (), || ())
    }

    /// As [`park`](Self::park). For each sleep it calls `before` once wakers see the thread as
    /// parked, and `after` when it is awake and the wake is not taken yet.
    ///
    /// ```
    /// use luna_platform::clock::Instant;
    /// use luna_core::park::Parker;
    /// use std::cell::Cell;
    ///
    /// let (parker, asleep) = (Parker::new(), Cell::new(0));
    /// let before = || asleep.set(asleep.get() + 1);
    /// assert!(!parker.park_between(Instant::now(), before, || ())); // the deadline came
    /// assert!(asleep.get() > 0);
    /// ```
    #[inline]
    pub fn park_between(
        &self,
        deadline: Instant,
        before: impl FnMut(),
        after: impl FnMut(),
    ) -> bool {
        self.park_on_machine(Clock::deadline_of_machine(deadline), before, after)
    }

    /// As [`park_between`](Self::park_between), with a deadline on the machine's clock.
    #[inline]
    fn park_on_machine(
        &self,
        deadline: Instant,
        mut before: impl FnMut(),
        mut after: impl FnMut(),
    ) -> bool {
        loop {
            self.bell.quiet();
            let mut waited = Waited::Woken;
            if self
                .state
                .compare_exchange(EMPTY, PARKED, Ordering::AcqRel, Ordering::Relaxed)
                .is_ok()
            {
                before();
                waited = self.bell.wait(deadline);
                after();
            }
            // Acquire: the woken thread sees what happened before the wake.
            if self.state.swap(EMPTY, Ordering::Acquire) & NOTIFIED != 0 {
                return true;
            }
            if waited == Waited::TimedOut {
                return false;
            }
        }
    }

    /// Wakes the thread, or lets its next `park` return at once. From any thread. Returns whether
    /// it was parked: then it sees, when it returns from this `park`, what was done before this
    /// call.
    ///
    /// Every thread that finds it parked rings, not the first alone: the first may be preempted
    /// before it does, and a more urgent one must not have to wait for it.
    #[inline]
    pub fn unpark(&self) -> bool {
        let was_parked = self.state.fetch_or(NOTIFIED, Ordering::AcqRel) & PARKED != 0;
        if was_parked {
            self.bell.ring();
        }
        was_parked
    }
}

/// A waker that unparks. The last one may be dropped on the real-time path after the thread has
/// ended: the memory is then freed by [`deferred_free`](crate::deferred_free).
///
/// ```
/// use luna_platform::clock::Instant;
/// use luna_core::park::{self, Parker};
/// use luna_core::deferred_free::Shared;
///
/// let parker = Shared::new(Parker::new());
/// park::waker(&parker).wake();
/// assert!(parker.park(Instant::NEVER));
/// ```
pub fn waker(parker: &Shared<Parker>) -> Waker {
    // SAFETY: the functions fulfil the contract of a waker: each waker is one owner, turned into a
    // pointer and back into an owner by its drop or its wake; the parker can be unparked from any
    // thread.
    unsafe { Waker::new(parker.clone().into_raw(), &VTABLE) }
}

/// Whether `waker` is that of a parker: its functions are not user code.
pub(crate) fn is_own(waker: &Waker) -> bool {
    core::ptr::eq(waker.vtable(), &VTABLE)
}

static VTABLE: RawWakerVTable = RawWakerVTable::new(clone_waker, wake, wake_by_ref, drop_waker);

/// # Safety
///
/// `owner` is the data of a live waker of this table.
unsafe fn clone_waker(owner: *const ()) -> RawWaker {
    // SAFETY: the caller promises that the waker is live; the waker keeps its owner, so this one is
    // not dropped.
    let parker = ManuallyDrop::new(unsafe { Shared::<Parker>::from_raw(owner) });
    RawWaker::new((*parker).clone().into_raw(), &VTABLE)
}

/// # Safety
///
/// As `clone_waker`, `owner` is the data of a live waker of this table; that is not used again.
unsafe fn wake(owner: *const ()) {
    // SAFETY: the caller promises that the waker is not used again, so its owner is taken once.
    unsafe { Shared::<Parker>::from_raw(owner) }.unpark();
}

/// # Safety
///
/// As `clone_waker`: `owner` is the data of a live waker of this table.
unsafe fn wake_by_ref(owner: *const ()) {
    // SAFETY: the caller promises that the waker is live; the waker keeps its owner, so this one is
    // not dropped.
    ManuallyDrop::new(unsafe { Shared::<Parker>::from_raw(owner) }).unpark();
}

/// # Safety
///
/// As `wake`: `owner` is the data of a live waker of this table, which is not used again.
unsafe fn drop_waker(owner: *const ()) {
    // SAFETY: the caller promises that the waker is not used again, so its owner is taken once.
    drop(unsafe { Shared::<Parker>::from_raw(owner) });
}

luna_platform::local! {
    /// A thread blocks in one call at a time; nested calls (a poll that blocks) create a parker of
    /// their own.
    static PARKER: Cell<Option<Shared<Parker>>> = const { Cell::new(None) };
}

/// Allocates the parker of this thread's blocking calls, so that the first call does not allocate
/// on the real-time path.
///
/// ```
/// luna_core::park::prepare();
/// assert_eq!(luna_core::park::block_on(async { 7 }), 7); // allocates nothing
/// ```
pub fn prepare() {
    let parker = PARKER.take();
    PARKER.set(Some(parker.unwrap_or_else(|| Shared::new(Parker::new()))));
}

/// Blocks this thread until `future` is done.
///
/// # Panics
///
/// Panics on the thread of an executor, where it would stop all processes: await there.
///
/// ```
/// assert_eq!(luna_core::park::block_on(async { 1 + 1 }), 2);
/// ```
#[track_caller]
pub fn block_on<F: Future>(future: F) -> F::Output {
    match block_on_until(pin!(future), Instant::NEVER) {
        Some(output) => output,
        None => unreachable!("a wait without a deadline does not time out"),
    }
}

/// Blocks this thread until `future` is done or `deadline` has come, however often it is woken. At
/// the deadline the future is polled once more, so that its result is exact. With a virtual clock,
/// the deadline comes once the machine's clock has advanced by the same time. Panics as
/// [`block_on`] does.
#[track_caller]
pub fn block_on_until<F: Future>(mut future: Pin<&mut F>, deadline: Instant) -> Option<F::Output> {
    assert!(
        current::may_block(),
        "a blocking call inside a process of an executor would stop the whole executor: await the operation instead, or run the \
         process on an OS thread of its own"
    );
    // A replay has one thread, so it could not wait.
    current::replay_log(|log| log.outside("a blocking operation"));
    let parker = PARKER.take().unwrap_or_else(|| Shared::new(Parker::new()));
    let waker = waker(&parker);
    let mut cx = Context::from_waker(&waker);
    let mut on_machine = None;
    let output = loop {
        if let Poll::Ready(output) = future.as_mut().poll(&mut cx) {
            break Some(output);
        }
        // Computed once: a virtual clock does not advance meanwhile, and each wake would restart
        // the full time.
        let deadline = *on_machine.get_or_insert_with(|| Clock::deadline_of_machine(deadline));
        let was_woken = parker.park_on_machine(deadline, || (), || ());
        // A wake that is pending every time must not hide the deadline.
        if !was_woken || (deadline != Instant::NEVER && Instant::now_real() >= deadline) {
            break match future.as_mut().poll(&mut cx) {
                Poll::Ready(output) => Some(output),
                Poll::Pending => None,
            };
        }
    };
    PARKER.set(Some(parker));
    output
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use alloc::sync::Arc;
    use core::time::Duration;

    #[test]
    fn a_wake_from_another_thread_ends_the_wait() {
        let parker = Arc::new(Parker::new());
        let other = parker.clone();
        let thread = std::thread::spawn(move || other.unpark());
        assert!(parker.park(Instant::NEVER));
        thread.join().unwrap();
    }

    #[test]
    fn block_on_until_gives_up_at_the_deadline() {
        assert_eq!(
            block_on_until(pin!(core::future::pending::<()>()), Instant::now()),
            None
        );
        assert_eq!(
            block_on_until(pin!(core::future::ready(7)), Instant::now()),
            Some(7)
        );
    }

    #[test]
    fn wakes_do_not_hide_the_deadline() {
        let mut polls = 0;
        let busy = core::future::poll_fn(|cx| {
            polls += 1;
            assert!(polls < 10, "the deadline came before the first wake");
            cx.waker().wake_by_ref();
            Poll::<()>::Pending
        });
        assert_eq!(block_on_until(pin!(busy), Instant::now()), None);
        assert_eq!(polls, 2);
    }

    #[test]
    fn wakes_give_no_time_anew_where_the_clock_stands() {
        const TIME: Duration = Duration::from_micros(100);
        let clock = Clock::from(alloc::sync::Arc::new(
            luna_platform::clock::VirtualClock::new(),
        ));
        let _inside = clock.enter();
        let mut polls = 0;
        let busy = core::future::poll_fn(|cx| {
            polls += 1;
            assert!(polls < 10, "the time is up at the first wakes");
            let end = Instant::now_real() + TIME;
            while Instant::now_real() < end {}
            cx.waker().wake_by_ref();
            Poll::<()>::Pending
        });
        assert_eq!(block_on_until(pin!(busy), Instant::now() + TIME), None);
        assert!(polls <= 3, "{polls}");
    }
}

#[cfg(all(test, loom))]
mod loom_tests {
    //! On every interleaving: no wake is missed, and the woken thread sees what came before.

    use super::*;
    use alloc::sync::Arc;
    use loom::thread;
    use luna_platform::sync::UnsafeCell;

    struct Exchange {
        parker: Parker,
        value: UnsafeCell<u32>,
    }

    // SAFETY: the tests access the cell before an unpark, or after the park that it ended; loom
    // checks that they do.
    unsafe impl Sync for Exchange {}

    #[test]
    fn a_wake_is_never_slept_through() {
        loom::model(|| {
            let shared = Arc::new(Exchange {
                parker: Parker::new(),
                value: UnsafeCell::new(0),
            });
            let other = shared.clone();
            let waker = thread::spawn(move || {
                // SAFETY: the other thread reads it after its park alone.
                other.value.with_mut(|value| unsafe { *value = 7 });
                other.parker.unpark();
            });
            assert!(shared.parker.park(Instant::NEVER));
            // SAFETY: the park has seen the unpark, which came after the write.
            assert_eq!(shared.value.with(|value| unsafe { *value }), 7);
            waker.join().unwrap();
        });
    }

    /// The ring of a waker that was late at an earlier park: it ends one sleep, not the park.
    #[test]
    fn a_ring_without_a_wake_ends_no_park() {
        loom::model(|| {
            let shared = Arc::new(Exchange {
                parker: Parker::new(),
                value: UnsafeCell::new(0),
            });
            let other = shared.clone();
            let wakers = thread::spawn(move || {
                other.parker.bell().ring();
                // SAFETY: the other thread reads it after its park alone.
                other.value.with_mut(|value| unsafe { *value = 7 });
                other.parker.unpark();
            });
            assert!(shared.parker.park(Instant::NEVER));
            // SAFETY: the park has seen the unpark, which came after the write.
            assert_eq!(shared.value.with(|value| unsafe { *value }), 7);
            wakers.join().unwrap();
        });
    }

    /// The first waker is preempted before it rings, for as long as the thread sleeps.
    #[test]
    fn a_second_wake_ends_the_park_without_the_first_ones_ring() {
        loom::model(|| {
            let parker = Arc::new(Parker::new());
            let other = parker.clone();
            let wakers = thread::spawn(move || {
                other.state.fetch_or(NOTIFIED, Ordering::AcqRel);
                other.unpark();
            });
            assert!(parker.park(Instant::NEVER));
            wakers.join().unwrap();
        });
    }

    /// Of three threads: without a bound a model takes up to four minutes.
    fn check_within(preemptions: usize, model: impl Fn() + Send + Sync + 'static) {
        let mut builder = loom::model::Builder::new();
        builder.preemption_bound.get_or_insert(preemptions);
        builder.check(model);
    }

    #[test]
    fn two_wakes_end_one_park_or_two() {
        check_within(4, || {
            let parker = Arc::new(Parker::new());
            let wakers = [parker.clone(), parker.clone()]
                .map(|parker| thread::spawn(move || parker.unpark()));
            assert!(parker.park(Instant::NEVER));
            for waker in wakers {
                waker.join().unwrap();
            }
            // The second wake was taken together with the first, or it is kept.
            if parker.state.load(Ordering::Relaxed) == NOTIFIED {
                assert!(parker.park(Instant::NEVER));
            }
            assert_eq!(parker.state.load(Ordering::Relaxed), EMPTY);
        });
    }

    /// Of two wakers, each is seen by the thread, or knows that it is not.
    #[test]
    fn a_waker_that_finds_the_thread_parked_is_seen() {
        check_within(3, || {
            let shared = Arc::new((Parker::new(), AtomicU32::new(0)));
            let wakers = [1, 2].map(|work| {
                let shared = shared.clone();
                thread::spawn(move || {
                    shared.1.fetch_or(work, Ordering::Relaxed);
                    if shared.0.unpark() { work } else { 0 }
                })
            });
            if shared.1.load(Ordering::Relaxed) != 3 {
                assert!(shared.0.park(Instant::NEVER));
            }
            let seen = shared.1.load(Ordering::Relaxed);
            for waker in wakers {
                let promised = waker.join().unwrap();
                assert_eq!(seen & promised, promised);
            }
        });
    }

    #[test]
    fn a_late_ring_of_one_park_does_not_hide_that_of_the_next() {
        check_within(4, || {
            let parker = Arc::new(Parker::new());
            let (one, two) = (parker.clone(), parker.clone());
            let first = thread::spawn(move || one.unpark());
            assert!(parker.park(Instant::NEVER));
            // The first may have changed the word and be about to ring.
            let second = thread::spawn(move || two.unpark());
            assert!(parker.park(Instant::NEVER));
            first.join().unwrap();
            second.join().unwrap();
        });
    }
}
