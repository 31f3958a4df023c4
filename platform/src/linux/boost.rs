//! Temporary boosts of a thread to another priority than its own.

use super::thread::why_no_policy;
use crate::shortfall::PolicyRefusal;
use crate::thread::Policy;
use nix::errno::Errno;
use nix::unistd::gettid;

/// A thread and its scheduling without a boost.
#[derive(Debug)]
pub struct Scheduling {
    thread: i32,
    policy: i32,
    priority: i32,
}

/// The scheduling of the calling thread. Three system calls.
pub fn scheduling() -> Scheduling {
    let (policy, priority) = super::thread::scheduler();
    Scheduling {
        thread: gettid().as_raw(),
        policy,
        priority: i32::from(priority),
    }
}

/// As [`scheduling`], of the thread of `of`, from any thread. Two system calls. Returns the former
/// value if the system does not report it.
pub fn scheduling_again(of: &Scheduling) -> Scheduling {
    let mut parameter = super::thread::zeroed_parameter();
    // Direct system calls, as below. SAFETY: the parameter is a valid structure for the length of
    // the calls.
    let (policy, asked) = unsafe {
        (
            libc::syscall(libc::SYS_sched_getscheduler, of.thread),
            libc::syscall(libc::SYS_sched_getparam, of.thread, &raw mut parameter),
        )
    };
    let is_known = policy >= 0 && asked == 0;
    Scheduling {
        thread: of.thread,
        policy: if is_known { policy as i32 } else { of.policy },
        priority: if is_known {
            parameter.sched_priority
        } else {
            of.priority
        },
    }
}

/// The rank of a deadline thread, as [`Policy::rank`] gives it.
const ABOVE_ALL: u8 = 100;

impl Scheduling {
    /// The real-time priority, 1 to 99; 0 without one, and above all of a deadline thread.
    pub fn rank(&self) -> u8 {
        let policy = self.policy & !libc::SCHED_RESET_ON_FORK;
        if policy == libc::SCHED_DEADLINE {
            return ABOVE_ALL;
        }
        if [libc::SCHED_FIFO, libc::SCHED_RR].contains(&policy) {
            self.priority as u8
        } else {
            0
        }
    }

    /// Whether the thread is ranked by priorities. A deadline thread is above them all.
    fn has_rank(&self) -> bool {
        let policy = self.policy & !libc::SCHED_RESET_ON_FORK;
        [
            libc::SCHED_OTHER,
            libc::SCHED_BATCH,
            libc::SCHED_IDLE,
            libc::SCHED_FIFO,
            libc::SCHED_RR,
        ]
        .contains(&policy)
    }
}

/// Runs the thread under SCHED_FIFO at `priority`. From any thread of the program; one system call.
///
/// # Errors
///
/// The system's error number.
pub fn boost(of: &Scheduling, priority: u8) -> Result<(), i32> {
    if !of.has_rank() {
        return Ok(());
    }
    set(of.thread, libc::SCHED_FIFO, i32::from(priority))
}

/// Restores the thread's own scheduling. One system call. Lowering a priority needs no privilege.
///
/// # Errors
///
/// The system's error number: EBUSY while a thread of a deadline policy waits for a lock that this
/// one holds.
pub fn restore(of: &Scheduling) -> Result<(), i32> {
    if !of.has_rank() {
        return Ok(());
    }
    set(
        of.thread,
        of.policy & !libc::SCHED_RESET_ON_FORK,
        of.priority,
    )
}

/// Threads that it starts meanwhile must not inherit the priority; and clearing the flag would need
/// a privilege.
fn set(thread: i32, policy: i32, priority: i32) -> Result<(), i32> {
    let mut parameter = super::thread::zeroed_parameter();
    parameter.sched_priority = priority;
    // Direct system call: musl's function of this name only fails. SAFETY: the parameter is a valid
    // structure for the length of the call.
    let outcome = unsafe {
        libc::syscall(
            libc::SYS_sched_setscheduler,
            thread,
            policy | libc::SCHED_RESET_ON_FORK,
            &raw const parameter,
        )
    };
    Errno::result(outcome)
        .map(drop)
        .map_err(|error| error as i32)
}

/// Determines why a boost to `priority` was refused with this error number.
pub fn why_refused(priority: u8, number: i32) -> PolicyRefusal {
    match Errno::from_raw(number) {
        Errno::EPERM => why_no_policy(Policy::fifo(priority)),
        error => PolicyRefusal::Kernel {
            message: error.to_string(),
        },
    }
}
