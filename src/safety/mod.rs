//! What happens when something goes wrong: the emergency functions, run once, before anything else.

mod emergency;

pub(crate) use emergency::{Emergency, EmergencyThread, Function};
