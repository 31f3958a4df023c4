//! The standard library knows no signals.

use crate::signals::{Signal, SignalError};

/// No signal was ever handled.
pub(crate) enum Before {}

impl Before {
    pub(crate) fn signal(&self) -> Signal {
        match *self {}
    }
}

/// The numbers that most systems use, and the names.
const SIGNALS: [(Signal, i32, &str); 5] = [
    (Signal::Interrupt, 2, "SIGINT"),
    (Signal::Terminate, 15, "SIGTERM"),
    (Signal::Hangup, 1, "SIGHUP"),
    (Signal::User1, 10, "SIGUSR1"),
    (Signal::User2, 12, "SIGUSR2"),
];

pub(crate) fn number(signal: Signal) -> i32 {
    let known = SIGNALS.iter().find(|(known, ..)| *known == signal);
    known.map_or(0, |(_, number, _)| *number)
}

pub(crate) fn name(number: i32) -> Option<&'static str> {
    let known = SIGNALS.iter().find(|(_, known, _)| *known == number);
    known.map(|(.., name)| *name)
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

pub(crate) fn accept_here() {}

pub(crate) fn hold_back() -> Mask {}

pub(crate) fn find_requests() {}

pub(crate) fn refuse_write_signals() -> Mask {}

pub(crate) fn forget_write_signals(_before: &Mask) {}

pub(crate) fn set_mask(_mask: &Mask) {}

/// There are no handlers that would ask.
pub(crate) fn current_thread() -> usize {
    0
}

pub(crate) fn has_handler(_number: i32) -> bool {
    false
}

pub(crate) fn send_to_this_process(_number: i32) {}
