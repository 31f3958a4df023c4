//! Threads as the standard library makes them: with a name and a stack. Policies and cores are
//! refused.

use crate::thread::{Attributes, Obtained, Policy, Refusal, Why};
use std::marker::PhantomData;

/// Nothing here can be inherited.
pub(crate) fn remember_process() {}

/// Signals are not known here.
pub(crate) fn begin() {}

/// A stack for signal handlers: no handler runs here.
#[derive(Debug)]
#[must_use = "it is taken back when it is dropped"]
pub struct HandlerStack(PhantomData<*const ()>);

impl HandlerStack {
    /// Does nothing.
    pub fn here() -> Self {
        Self(PhantomData)
    }
}

/// Lets this thread run on all cores of the process.
pub fn unpin() {}

/// Applies the attributes to the calling thread: reports those that it cannot have. Its stack is
/// not touched, since its bounds are unknown.
pub(crate) fn apply(attributes: &Attributes) -> Result<Obtained, Refusal> {
    let mut obtained = Obtained::stack_of(attributes);
    if let Some(asked) = attributes.core {
        let why = Why::Unsupported;
        obtained.refused(attributes.mode, Refusal::Core { asked, why })?;
    }
    let asked = attributes.policy;
    if asked.is_real_time() {
        let why = Why::Unsupported;
        obtained.refused(attributes.mode, Refusal::Policy { asked, why })?;
    }
    attributes.settle_spin(&mut obtained)?;
    Ok(obtained)
}

/// Threads have no priorities here.
pub fn highest_priority() -> u8 {
    0
}

/// The policy of this thread.
pub fn current_policy() -> Policy {
    Policy::Other
}

/// The core of this thread.
pub fn current_core() -> Option<usize> {
    None
}

/// The cores of unpinned threads.
pub fn available_cores() -> Vec<usize> {
    (0..std::thread::available_parallelism().map_or(1, usize::from)).collect()
}

/// The standard library knows no capabilities.
pub fn has_capability(_bit: u32) -> Option<bool> {
    None
}
