//! Facts from `/sys` and `/proc`.

use crate::facts::ClockResolution;
use nix::time::{ClockId, clock_getres};

/// Below which the kernel's files lie.
pub(crate) const ROOT: Option<&str> = Some("/");

/// The coarse clock advances with the tick.
pub(crate) fn clock_resolution() -> Option<ClockResolution> {
    let nanos = |clock| {
        let resolution = clock_getres(clock).ok()?;
        u64::try_from(resolution.tv_sec() * 1_000_000_000 + resolution.tv_nsec()).ok()
    };
    Some(ClockResolution {
        timer_ns: nanos(ClockId::CLOCK_MONOTONIC)?,
        tick_ns: nanos(ClockId::CLOCK_MONOTONIC_COARSE)?,
    })
}
