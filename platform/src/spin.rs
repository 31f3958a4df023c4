//! Looking at something for a bounded time before sleeping.
//!
//! Nobody may spin on another's progress without a bound: under a real-time policy, on one core, the other could never make it. A thread that has a core
//! to itself may look for a while before it sleeps, since waking a sleeping thread takes microseconds, and seeing what another core has written some
//! tens of nanoseconds. The kernel's words for it are busy polling, of sockets, and halt polling, of virtual machines.

use crate::clock::Instant;
use std::time::Duration;

/// The longest time that may be asked for: 1 ms.
///
/// A wait that is longer on average gains nothing from it: asleep, a thread is woken within some tens of microseconds.
pub const LONGEST: Duration = Duration::from_millis(1);

/// How often one looks for each look at the clock, which takes 25 ns: about half a microsecond together.
#[cfg(not(loom))]
const LOOKS: u32 = 8;

/// Looks whether `is_over` until it is, for `time`, counted from the first looks on, but not beyond `deadline`. Says whether the wait is over: also if
/// `deadline` came. `false`: sleep.
///
/// Real-time path: yes, on a thread that has a core to itself; at most `time` and a microsecond. No system call but those of `is_over`.
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
#[cfg(not(loom))]
#[inline]
pub fn until(mut is_over: impl FnMut() -> bool, time: Duration, deadline: Instant) -> bool {
    let mut end = None;
    loop {
        for _ in 0..LOOKS {
            if is_over() {
                return true;
            }
            std::hint::spin_loop();
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

/// In a model, whose clock stands still, it looks twice: what follows a look does not depend on how many came before.
#[cfg(loom)]
pub fn until(mut is_over: impl FnMut() -> bool, _: Duration, _: Instant) -> bool {
    is_over() || is_over()
}
