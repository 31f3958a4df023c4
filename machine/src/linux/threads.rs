//! Policies of other threads, and what a program has that a thread starts.

use luna_platform::on_drop::OnDrop;
use luna_platform::thread::{
    Policy, TIMER_PRIORITY, available_cores, highest_priority, unpin_current,
};
use nix::errno::Errno;
use nix::libc;
use nix::sys::signal::{SigSet, SigmaskHow, Signal, pthread_sigmask};
use nix::unistd::gettid;
use std::mem::MaybeUninit;
use std::os::unix::process::CommandExt;
use std::process::Command;

pub(crate) fn current_number() -> i32 {
    gettid().as_raw()
}

pub(crate) fn promote(number: i32, policy: Policy) {
    let kind = match policy {
        Policy::Fifo(_) => libc::SCHED_FIFO,
        Policy::RoundRobin(_) => libc::SCHED_RR,
        _ => return,
    };
    // Refused to a program that has given up the privilege since its start: then the thread stays
    // an ordinary one.
    let kind = kind | libc::SCHED_RESET_ON_FORK;
    let _ = set_scheduler(number, kind, policy.priority().into());
}

pub(crate) fn demote(number: i32) {
    // One that was ordinary before keeps no flag, and may not be given one: then this does nothing
    // that was needed. So for a thread that has ended.
    let _ = set_scheduler(number, libc::SCHED_OTHER | libc::SCHED_RESET_ON_FORK, 0);
    // SAFETY: a plain system call.
    unsafe { libc::syscall(libc::SYS_setpriority, libc::PRIO_PROCESS, number, 19) };
}

/// Until the guard is dropped, the calling thread runs before all threads of users. One that the
/// kernel refuses this, and one of a deadline policy, goes on as it is.
pub(crate) fn above_users() -> OnDrop<impl FnMut()> {
    // At a user's limit no thread of that user is above this one, and one that is as high waits.
    let priority = highest_priority().min(TIMER_PRIORITY);
    let own = scheduler().filter(|&(policy, _)| {
        let flag = policy & libc::SCHED_RESET_ON_FORK;
        policy & !flag != libc::SCHED_DEADLINE
            && set_scheduler(0, libc::SCHED_FIFO | flag, priority.into()).is_ok()
    });
    OnDrop::new(move || {
        if let Some((policy, priority)) = own {
            // From the higher priority to its own is always allowed.
            let _ = set_scheduler(0, policy, priority);
        }
    })
}

pub(crate) fn ordinary_child(command: &mut Command) {
    // Found here: the child may only make system calls.
    let _ = available_cores();
    let ordinary = || {
        unpin_current();
        let ending = SigSet::from_iter([
            Signal::SIGINT,
            Signal::SIGTERM,
            Signal::SIGHUP,
            Signal::SIGQUIT,
            Signal::SIGPIPE,
            Signal::SIGXFSZ,
            Signal::SIGTTOU,
        ]);
        pthread_sigmask(SigmaskHow::SIG_UNBLOCK, Some(&ending), None)?;
        Ok(())
    };
    // SAFETY: the closure makes plain system calls on values of its own and on the initial mask,
    // which is made by now: it neither allocates nor locks, as it must not between fork and exec.
    unsafe { command.pre_exec(ordinary) };
}

/// Sets the policy of the thread `number`, 0 for the calling thread. Direct system calls here:
/// musl's functions of these names only fail.
fn set_scheduler(number: i32, kind: i32, priority: i32) -> Result<(), Errno> {
    let mut parameter = zeroed_parameter();
    parameter.sched_priority = priority;
    // SAFETY: the parameter is a valid structure for the length of the call.
    let outcome = unsafe {
        libc::syscall(
            libc::SYS_sched_setscheduler,
            number,
            kind,
            &raw const parameter,
        )
    };
    Errno::result(outcome).map(drop)
}

/// The calling thread's policy, with its flags, and its priority.
fn scheduler() -> Option<(i32, i32)> {
    let mut parameter = zeroed_parameter();
    // SAFETY: the parameter is a valid structure to write to.
    let (policy, asked) = unsafe {
        (
            libc::syscall(libc::SYS_sched_getscheduler, 0),
            libc::syscall(libc::SYS_sched_getparam, 0, &raw mut parameter),
        )
    };
    (policy >= 0 && asked == 0).then_some((policy as i32, parameter.sched_priority))
}

fn zeroed_parameter() -> libc::sched_param {
    // SAFETY: a structure of numbers, for which all zeros is a value.
    unsafe { MaybeUninit::zeroed().assume_init() }
}
