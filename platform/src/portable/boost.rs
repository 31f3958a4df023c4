//! Threads have no priorities here, so that none is ever lent.

use crate::shortfall::PolicyRefusal;

#[derive(Debug)]
pub(crate) struct Scheduling;

pub(crate) fn scheduling() -> Scheduling {
    Scheduling
}

pub(crate) fn scheduling_again(_: &Scheduling) -> Scheduling {
    Scheduling
}

impl Scheduling {
    pub(crate) fn rank(&self) -> u8 {
        0
    }
}

pub(crate) fn boost(_: &Scheduling, _: u8) -> Result<(), i32> {
    Err(0)
}

pub(crate) fn restore(_: &Scheduling) {}

pub(crate) fn why_refused(_: u8, _: i32) -> PolicyRefusal {
    PolicyRefusal::Unsupported
}
