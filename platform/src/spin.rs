//! Spinning on a condition for a bounded time before sleeping.
//!
//! A thread must not spin on another thread's progress without a bound: under a real-time policy,
//! on one core, the other thread could never make progress. A thread with a core to itself may spin
//! for a while before it sleeps: waking a sleeping thread takes microseconds, and seeing another
//! core's write some tens of nanoseconds. The kernel's terms for it are busy polling, of sockets,
//! and halt polling, of virtual machines.

use crate::clock::Instant;
use crate::on_drop::OnDrop;
use core::sync::atomic::{AtomicU32, Ordering};
use core::time::Duration;

/// The longest time that may be asked for: 1 ms.
///
/// A wait that is longer on average gains nothing from it: asleep, a thread is woken within some
/// tens of microseconds.
pub const LONGEST: Duration = Duration::from_millis(1);

/// The time from one look to the next.
///
/// Each look takes the cache line away from the thread that is about to change it, possibly between
/// two of its steps; that thread then waits for the line as long as a look takes. So looking less
/// often sees more: on the reference machine a rendezvous takes 2.7 round trips of a line with
/// looks 13 ns apart, and 1.2 with 100 ns.
const BETWEEN_LOOKS: Duration = Duration::from_nanos(100);

/// That time as a number of the processor's pauses: on some a pause takes 3 ns, on others 50.
static PAUSES: AtomicU32 = AtomicU32::new(1);

const MAX_PAUSES: u128 = 64;

/// Measures a pause. Some 20 µs.
fn measure_pause() {
    const PAUSES_AT_ONCE: u32 = 64;
    let time = || {
        let start = Instant::now();
        (0..PAUSES_AT_ONCE).for_each(|_| core::hint::spin_loop());
        Instant::now() - start
    };
    // The shortest: the others were interrupted.
    let shortest = (0..8).map(|_| time()).min().unwrap_or_default();
    // A clock that stands still measures nothing.
    if !shortest.is_zero() {
        let fitting = BETWEEN_LOOKS.as_nanos() * u128::from(PAUSES_AT_ONCE) / shortest.as_nanos();
        PAUSES.store(fitting.clamp(1, MAX_PAUSES) as u32, Ordering::Relaxed);
    }
}

/// Waits until the next look.
#[inline]
fn pause() {
    (0..PAUSES.load(Ordering::Relaxed)).for_each(|_| core::hint::spin_loop());
}

/// The number of looks for each clock read, which takes 25 ns: about half a microsecond together.
const LOOKS_PER_CLOCK_READ: u32 = 8;

/// Spins until `is_over`, for `time`, counted from the first looks on, but not beyond `deadline`.
/// Returns whether the wait is over, which it also is at the `deadline`. `false`: sleep.
///
/// Real-time path: yes, on a thread that has a core to itself; at most `time` and a microsecond. No
/// system call but those of `is_over`.
///
/// ```
/// use luna_platform::clock::Instant;
/// use luna_platform::spin;
/// use std::time::Duration;
///
/// let mut looks = 0;
/// let third = || { looks += 1; looks == 3 };
/// assert!(spin::until(third, Duration::from_micros(1), Instant::NEVER));
/// assert!(!spin::until(|| false, Duration::from_micros(1), Instant::NEVER)); // the time is up
/// assert!(spin::until(|| false, Duration::from_micros(1), Instant::now())); // the deadline came
/// ```
#[inline]
pub fn until(mut is_over: impl FnMut() -> bool, time: Duration, deadline: Instant) -> bool {
    let mut end = None;
    loop {
        for _ in 0..LOOKS_PER_CLOCK_READ {
            if is_over() {
                return true;
            }
            core::hint::spin_loop();
        }
        let now = Instant::now();
        if now >= deadline {
            return true;
        }
        if now >= *end.get_or_insert(now + time) {
            return false;
        }
    }
}

/// The number of looks of a process' own operation for its partner before the process waits: about
/// 2 µs.
///
/// It sees its partner's step directly, without a wake by way of the executor, which saves some 150
/// ns for a message each way. The executor spins for longer, since it has other processes to run.
const LOOKS_OF_OPERATION: u32 = 20;

/// The state of a thread that runs processes, and may spin before it sleeps. Example: [`enter`].
pub trait Outside {
    /// Whether there is a request to the thread, or it may not spin any more. From that thread; a
    /// load or two.
    fn is_called(&self) -> bool;

    /// How long it may spin before it sleeps: zero when it may not any more. From that thread; a
    /// load.
    fn time(&self) -> Duration;
}

crate::local! {
    static OUTSIDE: core::cell::RefCell<Option<alloc::sync::Arc<dyn Outside>>> = const { core::cell::RefCell::new(None) };
    /// Whether there is an [`Outside`]: read by each operation that has to wait.
    static HAS_OUTSIDE: core::cell::Cell<bool> = const { core::cell::Cell::new(false) };
}

/// Lets operations of this thread's processes spin for their partners until the guard is dropped.
/// Not for the real-time path.
///
/// ```
/// use luna_platform::spin::{self, Outside};
/// use std::sync::Arc;
/// use std::time::Duration;
///
/// struct Quiet;
/// impl Outside for Quiet {
///     fn is_called(&self) -> bool {
///         false
///     }
///
///     fn time(&self) -> Duration {
///         Duration::from_micros(50)
///     }
/// }
///
/// assert!(!spin::is_allowed());
/// let looking = spin::enter(Arc::new(Quiet));
/// assert!(spin::is_allowed());
/// assert!(spin::look(|| true));
/// assert!(!spin::look(|| false)); // after about 2 µs
/// drop(looking);
/// assert!(!spin::is_allowed());
/// ```
pub fn enter(outside: alloc::sync::Arc<dyn Outside>) -> OnDrop<impl FnMut()> {
    measure_pause();
    OUTSIDE.set(Some(outside));
    HAS_OUTSIDE.set(true);
    OnDrop::new(|| {
        HAS_OUTSIDE.set(false);
        OUTSIDE.set(None);
    })
}

/// Whether this thread may spin before it sleeps, and has no request. Real-time path: yes; a load
/// where it may not, else a few.
#[inline]
pub fn is_allowed() -> bool {
    HAS_OUTSIDE.get()
        && !OUTSIDE.with_borrow(|outside| outside.as_ref().is_none_or(|one| one.is_called()))
}

/// Spins on `is_over` for about 2 µs, or until the thread gets a request; returns whether it is
/// over. Call it only where [`is_allowed`] returned true. Real-time path: yes. Example: [`enter`].
pub fn look(mut is_over: impl FnMut() -> bool) -> bool {
    OUTSIDE.with_borrow(|outside| {
        for _ in 0..LOOKS_OF_OPERATION {
            if is_over() {
                return true;
            }
            if outside.as_ref().is_none_or(|one| one.is_called()) {
                break;
            }
            pause();
        }
        false
    })
}

/// The longest time that a thread which may spin before it sleeps spins on a lock that another
/// thread holds: 10 µs.
///
/// A thread that asks the kernel for a lock sleeps, and gets the lock while it still sleeps. If the
/// other thread wants the lock again meanwhile, it finds a sleeping owner, and asks the kernel too:
/// from then on each critical section costs both a sleep. If the two do nothing but use the lock (a
/// stream between two cores), that does not end by itself. A thread that spins for longer than the
/// other takes to wake ends it.
#[cfg(all(feature = "std", target_os = "linux", not(luna_portable)))]
const LONGEST_AT_LOCK: Duration = Duration::from_micros(10);

/// The time between two looks of such a thread at a lock, in units of [`BETWEEN_LOOKS`]: 400 ns.
///
/// It is longer than for a partner. An undisturbed holder finishes and takes the lock again, with
/// the guarded data still in its cache: the data then moves from core to core once for many
/// critical sections. The first look comes after half of that time: where two threads meet, the
/// holder leaves, and waits for the other.
#[cfg(all(feature = "std", target_os = "linux", not(luna_portable)))]
const BETWEEN_LOOKS_AT_LOCK: u32 = 4;

/// How a thread that may spin before it sleeps spins on a lock that another thread holds: the
/// number of looks, and the pauses between them. `None`: as any other thread.
#[cfg(all(feature = "std", target_os = "linux", not(luna_portable)))]
pub(crate) fn at_lock() -> Option<(u32, u32)> {
    if !HAS_OUTSIDE.get() {
        return None;
    }
    // The thread may be ending, with its locals being torn down.
    let time = OUTSIDE.try_with(|outside| Some(outside.try_borrow().ok()?.as_ref()?.time()));
    let time = time.ok()??.min(LONGEST_AT_LOCK);
    let looks = time.as_nanos() / (BETWEEN_LOOKS * BETWEEN_LOOKS_AT_LOCK).as_nanos();
    let pauses = BETWEEN_LOOKS_AT_LOCK * PAUSES.load(Ordering::Relaxed);
    (looks > 0).then_some((looks as u32, pauses))
}

#[cfg(all(test, feature = "std", target_os = "linux", not(luna_portable)))]
mod tests {
    use super::*;
    use alloc::sync::Arc;
    use core::sync::atomic::AtomicU64;

    /// May spin for this number of nanoseconds.
    struct For(AtomicU64);

    impl Outside for For {
        fn is_called(&self) -> bool {
            false
        }

        fn time(&self) -> Duration {
            Duration::from_nanos(self.0.load(Ordering::Relaxed))
        }
    }

    #[test]
    fn a_lock_is_looked_at_for_as_long_as_the_thread_may_look_and_not_for_longer_than_the_longest()
    {
        let looks = || at_lock().map(|(looks, _)| looks);
        assert_eq!(looks(), None);
        let outside = Arc::new(For(AtomicU64::new(2_000)));
        let looking = enter(outside.clone());
        assert_eq!(looks(), Some(5));
        outside.0.store(1_000_000, Ordering::Relaxed);
        assert_eq!(looks(), Some(25));
        // Another thread was pinned to its core.
        outside.0.store(0, Ordering::Relaxed);
        assert_eq!(looks(), None);
        drop(looking);
        assert_eq!(looks(), None);
    }
}
