//! The standard library knows no signals.

use crate::signals::{Signal, SignalError};

/// No signal was ever handled.
pub(crate) enum Before {}

impl Before {
    pub(crate) fn signal(&self) -> Signal {
        match *self {}
    }
}

/// The numbers that most systems use.
pub(crate) fn number(signal: Signal) -> i32 {
    match signal {
        Signal::Interrupt => 2,
        Signal::Terminate => 15,
        Signal::Hangup => 1,
        Signal::User1 => 10,
        Signal::User2 => 12,
    }
}

/// Those of the numbers above.
pub(crate) fn name(number: i32) -> Option<&'static str> {
    Some(match number {
        1 => "SIGHUP",
        2 => "SIGINT",
        10 => "SIGUSR1",
        12 => "SIGUSR2",
        15 => "SIGTERM",
        _ => return None,
    })
}

pub(crate) fn real_time_number(_number: i32) -> Option<i32> {
    None
}

pub(crate) fn install(_signal: Signal) -> Result<Option<Before>, SignalError> {
    Err(SignalError::Unsupported)
}

pub(crate) fn restore(before: Before) {
    match before {}
}

/// Nothing is blocked.
pub(crate) type Mask = ();

pub(crate) fn accept_here(_takes_quit: bool) {}

pub(crate) fn hold_back() -> Mask {}

pub(crate) fn find_requests() {}

pub(crate) fn set_mask(_mask: &Mask) {}

/// There are no handlers that would ask.
pub(crate) fn current_thread() -> usize {
    0
}

pub(crate) fn send_to_this_process(_number: i32) {}
