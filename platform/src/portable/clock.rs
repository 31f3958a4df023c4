use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// Nanoseconds since the first call, from `std::time::Instant`.
#[inline]
pub(crate) fn monotonic_nanos() -> u64 {
    static ORIGIN: OnceLock<Instant> = OnceLock::new();
    // The origin lies a second back, so that 0 stays free for "before everything".
    let elapsed = ORIGIN.get_or_init(Instant::now).elapsed().as_nanos();
    u64::try_from(elapsed)
        .unwrap_or(u64::MAX)
        .saturating_add(1_000_000_000)
}

/// The standard library does not report it.
pub(crate) fn processor_time() -> Option<Duration> {
    None
}
