//! `luna list`, `luna echo` and `luna send`: what runs on this computer, and what its programs
//! exchange.
//!
//! `survey` finds it, `table` draws it; `echo` and `send` take a side of a channel themselves.

pub(crate) mod echo;
pub(crate) mod list;
pub(crate) mod send;
mod survey;
mod table;

use crate::failure::{Failure, unusable};
use luna_ipc::IpcError;
use luna_ipc::look::{self, Found};
use std::fmt::Display;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// The pause between two looks for a name that is not there yet.
const PAUSE: Duration = Duration::from_millis(20);

/// What has this name, opened by another program; waited for as long as that.
fn wait_for(name: &str, wait: Duration) -> Result<Found, Failure> {
    let begin = Instant::now();
    loop {
        let found = look::at(name).map_err(|error| unusable(name, error))?;
        if let Some(found) = found.filter(Found::is_alive) {
            return Ok(found);
        }
        if begin.elapsed() >= wait {
            return Err(unusable(
                name,
                "no program has it open: start that first, wait for it with --wait S, or see `luna list` for what there is",
            ));
        }
        sleep(PAUSE);
    }
}

/// What went wrong in the exchange with the other program.
fn broken_off(name: &str, error: impl Display) -> Failure {
    Failure::BrokenOff {
        name: name.to_owned(),
        error: error.to_string(),
    }
}

/// A side that cannot be had.
fn refused(name: &str, error: &IpcError) -> Failure {
    match error {
        IpcError::Busy { role, pid, .. } => unusable(
            name,
            format_args!(
                "process {pid} is its {role}, and there is one: end that, or look at the channel from outside by `luna list {name}`"
            ),
        ),
        error => unusable(name, error),
    }
}

/// The error of the system that had the side, without the name of its process.
fn ended(name: &str, error: luna::Error) -> Failure {
    let text = error.to_string();
    let text = text.split_once("`: ").map_or(&*text, |(_, rest)| rest);
    broken_off(name, text)
}
