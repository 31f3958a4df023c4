//! The exit codes of runs. Those of failures are in `failure`, those of the doctor in `doctor`.
//! Each number has one meaning.

use luna::Report;
use std::process::ExitCode;

/// Whether what was to be recorded could be written; says on standard error where it could not be.
/// A ring that had no room for a while is not meant: that is counted in the report.
pub fn is_recorded(report: &Report) -> bool {
    let Some(logging) = &report.logging else {
        return true;
    };
    match &logging.error {
        Some(error) => {
            eprintln!(
                "luna: the recording {} is not complete: {error}",
                logging.to
            );
            false
        }
        None => true,
    }
}

/// Of a run that was complete, or was not.
pub fn of_a_run(complete: bool) -> ExitCode {
    ExitCode::from(u8::from(!complete))
}
