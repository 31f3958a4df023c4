//! What a process does with an alarm: the one place that knows how the rest of the system is told.

use crate::fault::Cause;
use crate::response::{Alarm, Reaction};
use luna::Sender;

/// Who is told.
#[derive(Debug, Default)]
pub(super) struct Alarms {
    told: Option<Sender<Cause>>,
    /// What the process is to end with.
    emergency: Option<luna::Error>,
}

impl Alarms {
    pub(super) fn tell(&mut self, told: Sender<Cause>) {
        self.told = Some(told);
    }

    pub(super) fn raise(&mut self, alarm: Alarm) {
        let Alarm { cause, reaction } = alarm;
        if let Some(told) = &self.told {
            // Who does not look misses it: nobody waits for that.
            let _ = told.try_send(cause.clone());
        }
        match reaction {
            Reaction::Warn | Reaction::Neutral => {}
            Reaction::Emergency => {
                // It allocates; there is nothing left to be in time for.
                let error = luna::off_path(|| luna::emergency(luna::Error::other(cause)));
                self.emergency.get_or_insert(error);
            }
        }
    }

    /// # Errors
    ///
    /// An emergency was raised: the process is to end with it.
    pub(super) fn go_on(&mut self) -> luna::Result<()> {
        self.emergency.take().map_or(Ok(()), Err)
    }
}
