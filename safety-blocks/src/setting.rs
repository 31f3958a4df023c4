//! Parameters are checked when a block is created, so that none can be wrong while it works.

use std::fmt;
use std::time::Duration;

/// A parameter that a block cannot work with.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{block}: {parameter} is {given}, allowed is {allowed}")]
pub struct SettingError {
    /// The kind of block.
    pub block: &'static str,
    /// The parameter.
    pub parameter: &'static str,
    /// What was given.
    pub given: Given,
    /// The allowed values, as text.
    pub allowed: &'static str,
}

/// What was given for a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Given {
    /// A number.
    Number(f64),
    /// A time.
    Time(Duration),
    /// A count.
    Count(u32),
}

impl fmt::Display for Given {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => number.fmt(f),
            Self::Time(time) => fmt::Debug::fmt(time, f),
            Self::Count(count) => count.fmt(f),
        }
    }
}

impl From<SettingError> for luna::Error {
    fn from(error: SettingError) -> luna::Error {
        luna::Error::other(error)
    }
}

/// The parameters of one kind of block.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Of(pub(crate) &'static str);

impl Of {
    pub(crate) fn number(
        self,
        parameter: &'static str,
        value: f64,
        is_allowed: bool,
        allowed: &'static str,
    ) -> Result<f64, SettingError> {
        self.check(value.is_finite() && is_allowed, parameter, allowed, || {
            Given::Number(value)
        })
        .map(|()| value)
    }

    pub(crate) fn finite(self, parameter: &'static str, value: f64) -> Result<f64, SettingError> {
        self.number(parameter, value, true, "a finite number")
    }

    pub(crate) fn positive(self, parameter: &'static str, value: f64) -> Result<f64, SettingError> {
        self.number(parameter, value, value > 0.0, "a finite number above 0")
    }

    pub(crate) fn not_negative(
        self,
        parameter: &'static str,
        value: f64,
    ) -> Result<f64, SettingError> {
        self.number(
            parameter,
            value,
            value >= 0.0,
            "a finite number, 0 or above",
        )
    }

    pub(crate) fn time(
        self,
        parameter: &'static str,
        time: Duration,
    ) -> Result<Duration, SettingError> {
        self.check(!time.is_zero(), parameter, "a time above zero", || {
            Given::Time(time)
        })
        .map(|()| time)
    }

    pub(crate) fn check(
        self,
        is_allowed: bool,
        parameter: &'static str,
        allowed: &'static str,
        given: impl FnOnce() -> Given,
    ) -> Result<(), SettingError> {
        if is_allowed {
            return Ok(());
        }
        Err(SettingError {
            block: self.0,
            parameter,
            given: given(),
            allowed,
        })
    }
}
