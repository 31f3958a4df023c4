//! The standard library knows how many threads can run at once, and nothing else of the machine.

use crate::facts::SystemFacts;

pub(crate) fn gather() -> SystemFacts {
    SystemFacts {
        allowed_cores: Some(super::thread::available_cores()),
        ..SystemFacts::default()
    }
}
