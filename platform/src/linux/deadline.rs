//! SCHED_DEADLINE: set, read back, and why it was refused.

use super::privileges;
use super::thread::{available_cores, current_policy};
use crate::facts::task::CAP_SYS_NICE;
use crate::shortfall::PolicyRefusal;
use crate::thread::{Policy, write_core_list};
use nix::errno::Errno;
use std::fs;

/// Gives the calling thread `asked`, which is a deadline policy. Threads that it starts must not
/// inherit it: the kernel would refuse the start.
pub(super) fn set(asked: Policy) -> Result<(), PolicyRefusal> {
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
    match Errno::result(outcome) {
        Ok(_) => match current_policy() {
            obtained if obtained == asked => Ok(()),
            obtained => Err(PolicyRefusal::NotKept { obtained }),
        },
        Err(Errno::EPERM) => Err(why_not_permitted()),
        Err(Errno::EBUSY) => Err(PolicyRefusal::NoBandwidth { share: share() }),
        Err(error) => Err(out_of_range(period).unwrap_or_else(|| kernel(error))),
    }
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

/// Determines the kernel's reason for `EPERM`. A limit on priorities does not matter here.
fn why_not_permitted() -> PolicyRefusal {
    match privileges::has_capability(CAP_SYS_NICE) {
        Some(true) if privileges::in_a_user_namespace() => PolicyRefusal::UserNamespace,
        // The process is permitted: so its cores are too few.
        Some(true) => PolicyRefusal::NotAllCores {
            allowed: write_core_list(&available_cores()),
        },
        _ => PolicyRefusal::NotPermitted { limit: None },
    }
}

/// How much of the processors real-time threads may have, in percent.
fn share() -> Option<u8> {
    let (runtime, period) = (
        setting("sched_rt_runtime_us")?,
        setting("sched_rt_period_us")?,
    );
    u8::try_from(runtime.checked_mul(100)?.checked_div(period)?).ok()
}

/// Whether the kernel's limits on the period are the reason.
fn out_of_range(period: u64) -> Option<PolicyRefusal> {
    let (least, most) = (
        setting("sched_deadline_period_min_us")?,
        setting("sched_deadline_period_max_us")?,
    );
    let within = least.saturating_mul(1000)..=most.saturating_mul(1000);
    (!within.contains(&period)).then_some(PolicyRefusal::PeriodRange { least, most })
}

pub(super) fn kernel(error: Errno) -> PolicyRefusal {
    PolicyRefusal::Kernel {
        message: error.to_string(),
    }
}

/// A number of the scheduler's settings.
fn setting(name: &str) -> Option<u64> {
    let text = fs::read_to_string(format!("/proc/sys/kernel/{name}")).ok()?;
    text.trim().parse().ok()
}
