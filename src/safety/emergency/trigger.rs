//! What drivers raise an emergency with, from threads of their own.

use super::Emergency;
use crate::error::Error;
use crate::safety::handle::Safety;
use crate::safety::state::Cause;
use std::fmt;
use std::sync::Arc;

/// Raises an emergency of its system, from any thread: for drivers that run on threads which are no
/// processes. From [`System::emergency_trigger`](crate::System::emergency_trigger). Cloning it is
/// cheap, and it may outlive the system.
///
/// ```
/// use luna::prelude::*;
/// use luna::End;
///
/// let mut system = System::new("arm");
/// system.on_emergency("brakes", || { /* engage them */ });
/// let trigger = system.emergency_trigger();
/// let main = system.executor("main").build()?;
/// main.process("servo").spawn(std::future::pending::<luna::Result<()>>())?;
/// let driver = std::thread::spawn(move || trigger.raise(luna::Error::other("the card does not answer")));
/// assert_eq!(system.run().unwrap_err().to_string(), "the card does not answer");
/// assert_eq!(system.report().unwrap().end, End::Emergency);
/// # driver.join().unwrap();
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Clone)]
pub struct EmergencyTrigger(Arc<Emergency>);

impl EmergencyTrigger {
    pub(crate) fn new(emergency: Arc<Emergency>) -> Self {
        Self(emergency)
    }

    /// Raises an emergency with `cause`, as [`luna::emergency`](crate::emergency()) does in a
    /// process.
    ///
    /// Before [`System::run`](crate::System::run) it is latched: the functions run as soon as that
    /// has begun, and no process is released. After its end nothing happens. Real-time path: yes;
    /// O(1) and at most four system calls, no allocation. `cause` is dropped here if others came
    /// before with more than are kept.
    pub fn raise(&self, cause: Error) {
        self.0.trigger(Cause::Raised(cause));
    }

    /// The system's safety state.
    pub fn safety(&self) -> Safety {
        Safety::new(self.0.clone())
    }
}

impl fmt::Debug for EmergencyTrigger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("EmergencyTrigger")
            .field(&self.0.degree())
            .finish()
    }
}
