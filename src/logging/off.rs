//! Without the logger: the same names for processes, and nothing behind them.

use crate::error::{Error, SetupError};
use std::convert::Infallible;
use std::fmt;
use std::marker::PhantomData;
use std::time::Duration;

/// A number, a boolean or a small vector over time. This build has no logger (feature `logger`), so it is nothing: it has no size, and recording is no code.
pub struct Signal<T>(PhantomData<fn(T)>);

impl<T: Sample> Signal<T> {
    /// Never fails, since nothing is registered.
    ///
    /// # Errors
    ///
    /// None in this build.
    pub fn register(_: &str) -> Result<Signal<T>, RegisterError> {
        Ok(Signal(PhantomData))
    }

    /// A signal to be.
    pub fn with_unit(_: &str, _: &str) -> SignalBuilder<T> {
        SignalBuilder(PhantomData)
    }

    /// Does nothing.
    #[inline(always)]
    pub fn record(&self, _: T) {}
}

impl<T> Clone for Signal<T> {
    fn clone(&self) -> Self {
        Signal(PhantomData)
    }
}

impl<T> fmt::Debug for Signal<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Signal")
    }
}

/// A signal to be.
#[must_use = "a signal is made by `register`"]
#[derive(Debug, Clone)]
pub struct SignalBuilder<T>(PhantomData<fn(T)>);

impl<T: Sample> SignalBuilder<T> {
    /// Does nothing.
    pub fn description(self, _: &str) -> Self {
        self
    }

    /// Never fails, since nothing is registered.
    ///
    /// # Errors
    ///
    /// None in this build.
    pub fn register(self) -> Result<Signal<T>, RegisterError> {
        Ok(Signal(PhantomData))
    }
}

/// Why a signal cannot be registered: in this build it always can.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RegisterError {}

impl fmt::Display for RegisterError {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}

impl std::error::Error for RegisterError {}

impl From<RegisterError> for Error {
    fn from(error: RegisterError) -> Error {
        match error {}
    }
}

/// What a signal carries: a number, a boolean, or an array of them.
pub trait Sample: Copy + Send + 'static {}

macro_rules! samples {
    ($($of:ty)*) => {$(
        impl Sample for $of {}
        impl<const N: usize> Sample for [$of; N] {}
    )*};
}

samples!(bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64);

/// How much a message matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Level {
    /// Something has failed.
    Error = 1,
    /// Something may fail soon.
    Warn = 2,
    /// What a user wants to know.
    Info = 3,
    /// What a developer wants to know.
    Debug = 4,
    /// What a developer wants to know of every step.
    Trace = 5,
}

/// Does nothing in this build.
#[inline(always)]
pub fn message(_: Level, _: &str, _: fmt::Arguments<'_>) {}

#[derive(Debug, Clone)]
pub(crate) struct Log;

/// Nothing can be asked for.
pub(crate) type Asked = Option<Infallible>;

pub(crate) struct Entered;

impl Log {
    pub(crate) fn new(_: &str, _: bool) -> Self {
        Self
    }

    pub(crate) fn enter(&self) -> Entered {
        Entered
    }

    pub(crate) fn is_recording(&self) -> bool {
        false
    }

    #[inline(always)]
    pub(crate) fn enter_thread(&self) {}

    #[inline(always)]
    pub(crate) fn enter_home(&self) {}

    pub(crate) fn tell_stolen(&self, _: usize, _: Duration, _: Duration) {}

    pub(crate) fn tell_safety(&self, _: u32, _: u8) {}

    pub(crate) fn start(&self, _: Asked) -> Result<Session, SetupError> {
        Ok(Session)
    }
}

pub(crate) struct Session;

impl Session {
    pub(crate) fn finish(self) -> Option<Infallible> {
        None
    }
}
