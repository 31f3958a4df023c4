//! Errors of a run that were not reported yet.
//!
//! [`System::run`](crate::System::run) returns one error, and a `main` that returns it prints it.
//! So that it is not printed twice, an error is reported on standard error while the system runs
//! only if the system goes on without the process for [`PATIENCE`]. At the end the others are
//! reported, but not the one that is returned.

use crate::error::Error;
use crate::notice::notice;
use luna_platform::clock::Instant;
use std::cell::RefCell;
use std::time::Duration;

/// How long an error waits for the end of the run.
const PATIENCE: Duration = Duration::from_secs(1);

struct Pending {
    due: Instant,
    error: Error,
    /// Made at once, since the user's code may make it, which may panic. At the end nothing may.
    text: String,
}

/// In the order in which they came. On the thread that runs the system alone.
#[derive(Default)]
pub(super) struct PendingErrors(RefCell<Vec<Pending>>);

impl PendingErrors {
    pub(super) fn add(&self, error: &Error) {
        let pending = Pending {
            due: Instant::now() + PATIENCE,
            error: error.clone(),
            text: error.to_string(),
        };
        self.0.borrow_mut().push(pending);
    }

    /// Reports those for which the run has not ended in time; gives when to come again.
    pub(super) fn report_due(&self) -> Instant {
        if self.0.borrow().is_empty() {
            return Instant::NEVER;
        }
        let now = Instant::now();
        let mut due = self.0.take();
        let later = due.split_off(due.partition_point(|one| one.due <= now));
        let next = later.first().map_or(Instant::NEVER, |next| next.due);
        self.0.replace(later);
        for Pending { text, .. } in due {
            notice!("luna: {text}");
        }
        next
    }

    /// The run has ended: reports all but the error that it returns.
    pub(super) fn settle(&self, returned: Option<&Error>) {
        for Pending { error, text, .. } in self.0.take() {
            if Some(&error) != returned {
                notice!("luna: {text}");
            }
        }
    }
}
