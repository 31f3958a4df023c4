//! The death of the program that started this one, as an emergency.

use super::emergency::Emergency;
use super::state::Cause;
use crate::error::{Error, Result, SetupError};
use crate::notice::notice;
use luna_machine::parent::{ParentWatch, Watched};
use luna_platform::thread::{self, Attributes, MINIMUM_STACK_SIZE, Policy, Thread};
use std::convert::Infallible;
use std::sync::Arc;

/// The thread that waits for the parent's death. Dropping it ends it.
pub(crate) struct ParentThread {
    watch: Arc<ParentWatch>,
    thread: Option<Thread<()>>,
}

impl ParentThread {
    /// Starts it. A machine that does not support it is an error if that `is_strict`, else a
    /// notice.
    pub(crate) fn start(
        emergency: Arc<Emergency>,
        policy: Policy,
        is_strict: bool,
    ) -> Result<Option<Self>> {
        let watch = match ParentWatch::new() {
            Ok(watch) => Arc::new(watch),
            Err(error) => {
                let error = Error::from(SetupError::system(format!(
                    "the parent process cannot be watched: {error}; Linux 5.3 or later can (pidfd_open(2))"
                )));
                if is_strict {
                    return Err(error);
                }
                notice!("luna: {error}");
                return Ok(None);
            }
        };
        let own = watch.clone();
        let thread = thread::spawn(
            Attributes::framework("luna-parent", policy).stack_size(MINIMUM_STACK_SIZE),
            |_| Ok::<_, Infallible>(()),
            move |()| {
                if own.wait() == Watched::HasEnded {
                    emergency.trigger(Cause::ParentDied);
                }
            },
        )
        .map_err(|error| Error::not_started("the watch of the parent process", error))?;
        Ok(Some(Self {
            watch,
            thread: Some(thread),
        }))
    }
}

impl Drop for ParentThread {
    fn drop(&mut self) {
        self.watch.stop();
        if let Some(thread) = self.thread.take() {
            // It holds no user data.
            let _ = thread.join();
        }
    }
}
