//! SCHED_DEADLINE: set, and read back.

use super::thread::kept;
use crate::thread::{Policy, Why};
use nix::errno::Errno;

/// Gives the calling thread `asked`, which is a deadline policy. Threads that it starts must not
/// inherit it: the kernel would refuse the start.
pub(super) fn set(asked: Policy) -> Result<(), Why> {
    let Policy::Deadline {
        runtime,
        deadline,
        period,
    } = asked
    else {
        return Ok(());
    };
    let mut attributes = zeroed();
    attributes.sched_policy = libc::SCHED_DEADLINE as u32;
    attributes.sched_flags = libc::SCHED_FLAG_RESET_ON_FORK as u64;
    attributes.sched_runtime = runtime;
    attributes.sched_deadline = deadline;
    attributes.sched_period = period;
    // SAFETY: the structure is valid for the length of the call and says its size; 0 is the calling
    // thread, and no flags.
    let outcome = unsafe { libc::syscall(libc::SYS_sched_setattr, 0, &raw const attributes, 0) };
    kept(asked, Errno::result(outcome).map(drop))
}

/// The calling thread's policy, which is known to be this one.
pub(super) fn get() -> Policy {
    let mut attributes = zeroed();
    // SAFETY: the structure may be written up to its size; 0 is the calling thread, and no flags.
    unsafe {
        libc::syscall(
            libc::SYS_sched_getattr,
            0,
            &raw mut attributes,
            attributes.size,
            0,
        );
    }
    // It cannot fail for the calling thread; zeros would read as a policy that was never set.
    Policy::Deadline {
        runtime: attributes.sched_runtime,
        deadline: attributes.sched_deadline,
        period: attributes.sched_period,
    }
}

fn zeroed() -> libc::sched_attr {
    // SAFETY: a structure of numbers, for which all zeros is a value.
    let attributes: libc::sched_attr = unsafe { std::mem::zeroed() };
    libc::sched_attr {
        size: size_of::<libc::sched_attr>() as u32,
        ..attributes
    }
}
