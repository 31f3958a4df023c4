//! The exit codes of runs. Those of failures are in `failure`, those of the doctor in `doctor`.
//! Each number has one meaning.

use std::process::ExitCode;

/// `luna demo --strict`: the control loop missed slots.
pub(crate) const SLOTS_MISSED: u8 = 5;

/// What `luna demo --help` says of them.
pub(crate) const OF_DEMO: &str = "\
Exit codes: 0 complete (--replay: the outputs are the same), 1 not complete, or failed (--replay: the outputs differ),
2 bad arguments or files, 5 complete, but the control loop missed slots (--strict).";

/// Of a run that was complete, or was not.
pub(crate) fn of_a_run(complete: bool) -> ExitCode {
    ExitCode::from(u8::from(!complete))
}
