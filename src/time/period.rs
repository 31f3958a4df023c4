//! Which periods and phases a clock can count.

use crate::error::SetupError;
use luna_platform::clock::nanos;
use std::time::Duration;

/// The period of `of`, in nanoseconds.
pub(super) fn period_nanos(of: &str, period: Duration) -> Result<u64, SetupError> {
    // Only for an error: on the path nothing is allocated.
    let name = || of.to_owned();
    match nanos(period) {
        0 => Err(SetupError::ZeroPeriod { name: name() }),
        long if long > i64::MAX as u64 => Err(SetupError::PeriodTooLong {
            name: name(),
            period,
        }),
        nanos => Ok(nanos),
    }
}

/// The phase of `of`, in nanoseconds.
pub(super) fn phase_nanos(of: &str, phase: Duration, period: Duration) -> Result<u64, SetupError> {
    if nanos(phase) < nanos(period) {
        return Ok(nanos(phase));
    }
    Err(SetupError::PhaseTooLong {
        name: of.to_owned(),
        phase,
        period,
    })
}
