//! Without the logger: the same names for processes, and nothing behind them.

pub use luna_error::RegisterError;

use super::Shown;
use crate::error::Result;
use crate::system::Opening;
use luna_config::parameters::Parameters;
use std::cell::Cell;
use std::convert::Infallible;
use std::fmt;
use std::marker::PhantomData;

/// A number, a boolean or a small vector over time. This build has no logger (feature `logger`), so
/// it is nothing: it has no size, and recording is no code.
pub struct Signal<T>(PhantomData<fn(T)>);

// Written out: the derived one demands `T: Clone`, and that of the logger does not.
impl<T> Clone for Signal<T> {
    fn clone(&self) -> Self {
        Self(PhantomData)
    }
}

luna_platform::debug_fields!(impl[T] Signal<T>);

impl<T: Sample> Signal<T> {
    /// Registers nothing, where a build with the logger registers a signal.
    ///
    /// # Errors
    ///
    /// The call is outside of `pre_run`, as in a build with the logger.
    pub fn register(name: &str) -> Result<Signal<T>, RegisterError> {
        Self::with_unit(name, "").register()
    }

    /// A signal to be.
    pub fn with_unit(name: &str, _: &str) -> SignalBuilder<T> {
        SignalBuilder {
            name: name.to_owned(),
            is_of_system: false,
            carries: PhantomData,
        }
    }

    /// Does nothing.
    #[inline(always)]
    pub fn record(&self, _: T) {}
}

/// A signal to be.
#[must_use = "a signal is made by `register`"]
#[derive(Debug, Clone)]
pub struct SignalBuilder<T> {
    name: String,
    /// Declared where its process is spawned.
    is_of_system: bool,
    carries: PhantomData<fn(T)>,
}

impl<T: Sample> SignalBuilder<T> {
    /// Does nothing.
    pub fn unit(self, _: &str) -> Self {
        self
    }

    /// Does nothing.
    pub fn description(self, _: &str) -> Self {
        self
    }

    /// Registers nothing, where a build with the logger registers a signal.
    ///
    /// # Errors
    ///
    /// As in a build with the logger, if the call is outside of `pre_run` and the signal was not
    /// declared where its process is spawned.
    pub fn register(self) -> Result<Signal<T>, RegisterError> {
        if self.is_of_system || ENTERED.get() > 0 {
            Ok(Signal(PhantomData))
        } else {
            Err(RegisterError::NotInPreRun { signal: self.name })
        }
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

thread_local! {
    /// How many guards of [`Log::enter`] this thread has: signals may be registered below one.
    static ENTERED: Cell<u32> = const { Cell::new(0) };
}

pub(crate) struct Entered;

impl Drop for Entered {
    fn drop(&mut self) {
        ENTERED.set(ENTERED.get() - 1);
    }
}

impl Log {
    pub(crate) fn new(_: &str) -> Self {
        Self
    }

    pub(crate) fn signal<T: Sample>(&self, name: &str) -> SignalBuilder<T> {
        SignalBuilder {
            name: name.to_owned(),
            is_of_system: true,
            carries: PhantomData,
        }
    }

    pub(crate) fn enter(&self) -> Entered {
        ENTERED.set(ENTERED.get() + 1);
        Entered
    }

    pub(crate) fn is_recording(&self) -> bool {
        false
    }

    #[inline(always)]
    pub(crate) fn enter_thread(&self) {}

    #[inline(always)]
    pub(crate) fn enter_executor(&self) {}

    pub(crate) fn report(&self, _: u16, _: u32, _: [u64; 2]) {}

    pub(crate) fn start(
        &self,
        _: bool,
        _: Asked,
        _: bool,
        _: &Opening,
        _: Parameters,
    ) -> Result<Session> {
        Ok(Session)
    }
}

pub(crate) struct Session;

impl Session {
    pub(crate) fn finish(self, _: impl Fn() -> bool) -> (Option<Infallible>, Shown) {
        (None, Shown)
    }
}
