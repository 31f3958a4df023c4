//! No other system has the device.

use crate::shortfall::LatencyRefusal;

/// Nothing is ever held.
pub(crate) type Held = std::convert::Infallible;

pub(crate) fn hold() -> Result<Held, LatencyRefusal> {
    Err(LatencyRefusal::Unsupported)
}
