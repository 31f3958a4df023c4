//! What a process does with an alarm, and how the rest of the system is informed.

use crate::fault::Finding;
use crate::response::{Alarm, Reaction};
use luna::safety::{SafeStateEntered, Safety};
use luna::{Error, Sender};

/// The receivers of alarms.
#[derive(Debug, Default)]
pub(super) struct Alarms {
    reports: Option<Sender<Finding>>,
    /// The system's, while the body runs.
    safety: Option<Safety>,
    was_safe_state: bool,
    /// What the process is to end with.
    emergency: Option<Error>,
}

impl Alarms {
    pub(super) fn report_to(&mut self, reports: Sender<Finding>) {
        self.reports = Some(reports);
    }

    /// The body begins.
    pub(super) fn begin(&mut self) {
        self.safety = luna::safety::current();
    }

    pub(super) fn raise(&mut self, alarm: Alarm) {
        let Alarm {
            finding,
            reaction,
            is_first,
        } = alarm;
        if let Some(reports) = &self.reports {
            // An alarm without room is dropped: the process does not wait for its reader.
            let _ = reports.try_send(finding.clone());
        }
        // An error allocates: once for a block's warning, and otherwise when the system stops in
        // any case.
        match (reaction, &self.safety) {
            (Reaction::Warn | Reaction::Neutral, Some(safety)) if is_first => {
                luna::realtime::off_path(|| safety.warn(Error::other(finding)));
            }
            (Reaction::SafeState, Some(safety)) => {
                luna::realtime::off_path(|| safety.enter_safe_state(Error::other(finding)));
                // It may be left before the next look.
                self.was_safe_state = true;
            }
            (Reaction::Emergency, _) => {
                let error = luna::realtime::off_path(|| luna::emergency(Error::other(finding)));
                self.emergency.get_or_insert(error);
            }
            _ => {}
        }
    }

    /// # Errors
    ///
    /// An emergency was raised: the process is to end with it.
    pub(super) fn go_on(&mut self) -> luna::Result<()> {
        self.emergency.take().map_or(Ok(()), Err)
    }

    /// Whether the system is in a safe state, from whatever source: outputs have to be neutral.
    pub(super) fn is_safe_state(&self) -> bool {
        self.safety.as_ref().is_some_and(Safety::is_safe_state)
    }

    /// What ends when the safe state is entered, for the whole body.
    pub(super) fn entered(&self) -> Option<SafeStateEntered> {
        self.safety.as_ref().map(Safety::safe_state_entered)
    }

    /// Whether the process has to put out neutral when the safe state is entered; not while it is
    /// in one.
    pub(super) fn awaits_safe_state(&self) -> bool {
        !self.was_safe_state
    }

    /// Neutral is put out for the safe state.
    pub(super) fn note_safe_state(&mut self) {
        self.was_safe_state = true;
    }

    /// Whether a safe state was left since the last call: then the blocks that led to it judge
    /// again.
    pub(super) fn safe_state_is_over(&mut self) -> bool {
        let is_safe_state = self.is_safe_state();
        std::mem::replace(&mut self.was_safe_state, is_safe_state) && !is_safe_state
    }
}
