//! A port has no other thread that could ring.

use crate::clock::Instant;
use core::convert::Infallible;

/// The alarm of a thread. There is none: [`new`](Self::new) gives nothing.
#[derive(Debug)]
pub struct Alarm {
    never: Infallible,
}

impl Alarm {
    /// Gives nothing.
    pub fn new(_ring: impl Fn() + Send + Sync + 'static) -> Option<Alarm> {
        None
    }

    /// There is none to be armed.
    pub fn arm(&self, _deadline: Instant) {
        match self.never {}
    }

    /// There is none to be disarmed.
    pub fn disarm(&self) {
        match self.never {}
    }

    /// There is none to be asked.
    pub fn take_rung(&self) -> Option<Instant> {
        match self.never {}
    }
}
