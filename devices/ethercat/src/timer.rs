//! The clock by which the library counts its timeouts.
//!
//! In a process it is the process' clock, so that timeouts are in a system's virtual time too; while
//! a bus is set up it is that of the port. Nothing is woken: the futures of the library are polled
//! after each frame and at their deadline.

use embassy_time_driver::{Driver, TICK_HZ, time_driver_impl};
use luna_platform::on_drop::OnDrop;
use std::cell::Cell;
use std::task::Waker;
use std::time::{SystemTime, UNIX_EPOCH};

#[derive(Debug)]
struct ThreadClock;

impl Driver for ThreadClock {
    fn now(&self) -> u64 {
        let now = SET_UP_TIME.get().unwrap_or_else(|| luna::now().as_nanos());
        let ticks = u128::from(now) * u128::from(TICK_HZ) / 1_000_000_000;
        u64::try_from(ticks).unwrap_or(u64::MAX)
    }

    fn schedule_wake(&self, _: u64, _: &Waker) {}
}

#[allow(
    unsafe_code,
    reason = "the macro defines symbols that the library calls"
)]
mod driver {
    use super::{ThreadClock, time_driver_impl};

    time_driver_impl!(static DRIVER: ThreadClock = ThreadClock);
}

thread_local! {
    /// Where a bus is set up, its time (ns).
    static SET_UP_TIME: Cell<Option<u64>> = const { Cell::new(None) };
}

/// Polls by another clock than the thread's, at the time `now` (ns).
pub(crate) fn at<T>(now: u64, poll: impl FnOnce() -> T) -> T {
    let before = SET_UP_TIME.replace(Some(now));
    // Also if it panics.
    let _restore = OnDrop::new(|| SET_UP_TIME.set(before));
    poll()
}

/// 2000-01-01, when distributed clocks begin, after 1970-01-01 (ns).
const EPOCH: u64 = 946_684_800_000_000_000;

/// The time of day for distributed clocks (ns).
pub(crate) fn time_of_day() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    let nanos = since.map_or(0, |since| since.as_nanos());
    u64::try_from(nanos)
        .unwrap_or(u64::MAX)
        .saturating_sub(EPOCH)
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_platform::panics;

    #[test]
    fn a_panic_leaves_no_time_behind() {
        panics::catch(|| at(5, || panic!("on purpose"))).unwrap_err();
        assert_eq!(SET_UP_TIME.get(), None);
        assert_eq!(at(5, || SET_UP_TIME.get()), Some(5));
    }
}
