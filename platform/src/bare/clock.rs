//! The port's clock.

use super::port::port;

/// Nanoseconds on the port's clock.
#[inline]
pub(crate) fn monotonic_nanos() -> u64 {
    port().now()
}
