//! What the programs of the command `luna` share: where measured processes run, how a run is
//! printed, as text and as JSON, how a failure ends a program, and the files that are written.
//!
//! It is a part of `luna` and of the programs that `luna` starts, such as `luna-demo`, and changes
//! with them.

pub mod alloc;
pub mod columns;
pub mod exit;
pub mod failure;
mod histogram_text;
pub mod output;
pub mod place;
pub mod print;
pub mod progress;
pub mod report;
pub mod result_file;
pub mod text;
pub mod values;

use failure::Failure;
use std::process::ExitCode;

/// Where the scope listens: this machine alone can reach it.
pub const SCOPE: &str = "127.0.0.1:8620";

/// Before anything else in a program: what it inherited is not to change what it does.
///
/// # Safety
///
/// No other thread has been started, so none reads the environment.
pub unsafe fn begin() {
    // The file is of the user's programs, and has names that no system of these programs has.
    // SAFETY: the caller says that there is no other thread.
    unsafe { std::env::remove_var("LUNA_DEPLOYMENT") };
    ignore_the_limit_of_files();
}

/// The exit code of what a program has done. Says on standard error why it failed.
pub fn end(outcome: Result<ExitCode, Failure>) -> ExitCode {
    outcome.unwrap_or_else(|failure| {
        eprintln!("luna: {failure}");
        ExitCode::from(failure.exit_code())
    })
}

/// A file that reaches `RLIMIT_FSIZE` is an error of the write, which is reported, as a full disk
/// is.
fn ignore_the_limit_of_files() {
    #[cfg(unix)]
    {
        use nix::sys::signal::{SigHandler, Signal, signal};
        // SAFETY: to ignore a signal runs nothing. It fails for no signal that can be ignored.
        let _ = unsafe { signal(Signal::SIGXFSZ, SigHandler::SigIgn) };
    }
}
