//! The kernel's TAI and the state of its synchronization.

use crate::tai::Synchronization;
use luna_platform::path::{self, Call};
use nix::libc;
use nix::time::{ClockId, clock_gettime};
use std::io::{Error, Result};
use std::time::Duration;

/// `CLOCK_TAI` in nanoseconds.
pub fn tai_nanos() -> Result<u64> {
    let now = clock_gettime(ClockId::CLOCK_TAI)?;
    Ok(now.tv_sec() as u64 * 1_000_000_000 + now.tv_nsec() as u64)
}

/// Reads the kernel's state of synchronization, and changes nothing.
pub(crate) fn synchronization() -> Result<Synchronization> {
    // SAFETY: all zeros are a valid value of this structure of numbers; as modes they ask for no
    // change.
    let mut state: libc::timex = unsafe { std::mem::zeroed() };
    // SAFETY: it is a valid structure to read and write.
    let outcome = path::expected(Call::Account, || unsafe { libc::adjtimex(&mut state) });
    if outcome < 0 {
        return Err(Error::last_os_error());
    }
    Ok(Synchronization {
        tai_offset: state.tai,
        is_synchronized: outcome != libc::TIME_ERROR && state.status & libc::STA_UNSYNC == 0,
        greatest_error: micros(state.maxerror),
        estimated_error: micros(state.esterror),
    })
}

/// As the kernel counts its errors.
fn micros(count: impl TryInto<u64>) -> Duration {
    Duration::from_micros(count.try_into().unwrap_or(0))
}
