//! The exit codes of runs. Those of failures are in `failure`, those of the doctor in `doctor`.
//! Each number has one meaning.

use luna::Report;
use std::process::ExitCode;

/// `luna demo --strict`: the control loop missed slots.
pub(crate) const SLOTS_MISSED: u8 = 5;

/// What `luna demo --help` says of them.
pub(crate) const OF_DEMO: &str = "\
Exit codes: 0 complete (--replay: the outputs are the same), 1 not complete, or failed, or --log or --record could not be written
(--replay: the outputs differ), 2 bad arguments or files, 5 complete, but the control loop missed slots (--strict).";

/// Whether what was to be recorded could be written; says on standard error where it could not be. A
/// ring that had no room for a while is not meant: that is counted in the report.
pub(crate) fn is_recorded(report: &Report) -> bool {
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
pub(crate) fn of_a_run(complete: bool) -> ExitCode {
    ExitCode::from(u8::from(!complete))
}
