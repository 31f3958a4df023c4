//! The blocks that judge one value, alone or beside another one.

mod blocked;
mod end_stop;
mod limit;
mod noise;
mod plausible;
mod rate;

pub use blocked::Blocked;
pub use end_stop::EndStop;
pub use limit::Limit;
pub use noise::Noise;
pub use plausible::{Disagreement, Frozen, MaxRate, Range};
pub use rate::RateLimit;
