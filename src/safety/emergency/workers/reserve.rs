//! The reserve: workers that sleep until they take over a core, or the place of one that hangs.
//!
//! Waking a thread on another core takes long on a virtual machine. So the reserve waits on the
//! cores of the system's real-time threads, one worker on each: a trigger on such a core calls that
//! worker, which preempts the core and runs the functions.

use super::EmergencyWorkers;
use luna_core::path::{self, Call};
use luna_platform::thread::{self, EMERGENCY_PRIORITY, Obtained, Policy};

impl EmergencyWorkers {
    /// `member` waits on a core, with what it obtained, and takes it over when it is called there.
    pub(super) fn wait_on_core(&self, member: u8, asked: Policy, obtained: &Obtained) {
        if let Some(core) = core_to_take_over(asked, obtained.policy, obtained.core) {
            // Each member is made once.
            let _ = self.cores[usize::from(member)].set(core);
        }
    }

    /// Calls the worker that waits on this core, if there is one. Returns whether it comes.
    pub(in super::super) fn call_here(&self) -> bool {
        let member = thread::current_core().and_then(|here| {
            let mut cores = self.cores.iter();
            cores.position(|core| core.get() == Some(&here))
        });
        member.is_some_and(|member| {
            // One of the same priority, such as a function of another system, does not give way,
            // nor does a thread with a deadline.
            path::expected(Call::Wake, thread::current_policy).rank() < EMERGENCY_PRIORITY
                && self.parkers[member].unpark()
        })
    }
}

/// The core that a worker of the reserve can preempt. None if it was refused its core, since it
/// then waits on any core, or its policy, since it would then wait for the thread that calls it.
fn core_to_take_over(asked: Policy, obtained: Policy, core: Option<usize>) -> Option<usize> {
    core.filter(|_| asked.is_real_time() && obtained == asked)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_that_has_both_its_policy_and_its_core_takes_it_over() {
        let emergency = Policy::fifo(EMERGENCY_PRIORITY);
        assert_eq!(core_to_take_over(emergency, emergency, Some(1)), Some(1));
        assert_eq!(core_to_take_over(emergency, emergency, None), None);
        for refused in [Policy::Other, Policy::fifo(50)] {
            assert_eq!(core_to_take_over(emergency, refused, Some(1)), None);
        }
        assert_eq!(
            core_to_take_over(Policy::Other, Policy::Other, Some(1)),
            None
        );
    }
}
