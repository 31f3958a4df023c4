//! Temporary boosts of a thread to another priority than its own.

use super::thread::{scheduler, set_scheduler};
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
    scheduling_again(&Scheduling {
        thread: gettid().as_raw(),
        policy: libc::SCHED_OTHER,
        priority: 0,
    })
}

/// As [`scheduling`], of the thread of `of`, from any thread. Two system calls. Returns the former
/// value if the system does not report it.
pub fn scheduling_again(of: &Scheduling) -> Scheduling {
    let (policy, priority) = scheduler(of.thread).unwrap_or((of.policy, of.priority));
    Scheduling {
        thread: of.thread,
        policy,
        priority,
    }
}

/// The rank of a deadline thread, as [`Policy::rank`] gives it.
const ABOVE_ALL: u8 = 100;

impl Scheduling {
    /// The real-time priority, 1 to 99; 0 without one, and above all of a deadline thread.
    pub fn rank(&self) -> u8 {
        match self.policy & !libc::SCHED_RESET_ON_FORK {
            libc::SCHED_DEADLINE => ABOVE_ALL,
            libc::SCHED_FIFO | libc::SCHED_RR => self.priority as u8,
            _ => 0,
        }
    }

    /// Whether the thread is ranked by priorities. A deadline thread is above them all.
    fn has_rank(&self) -> bool {
        use libc::{SCHED_BATCH, SCHED_FIFO, SCHED_IDLE, SCHED_OTHER, SCHED_RR};
        let policy = self.policy & !libc::SCHED_RESET_ON_FORK;
        [SCHED_OTHER, SCHED_BATCH, SCHED_IDLE, SCHED_FIFO, SCHED_RR].contains(&policy)
    }
}

/// Runs the thread under SCHED_FIFO at `priority`. From any thread of the program; one system call.
///
/// # Errors
///
/// The system's error number.
pub fn boost(of: &Scheduling, priority: u8) -> Result<(), i32> {
    set(of, libc::SCHED_FIFO, i32::from(priority))
}

/// Restores the thread's own scheduling. One system call. Lowering a priority needs no privilege.
///
/// # Errors
///
/// The system's error number: EBUSY while a thread of a deadline policy waits for a lock that this
/// one holds.
pub fn restore(of: &Scheduling) -> Result<(), i32> {
    set(of, of.policy, of.priority)
}

/// Threads that it starts meanwhile must not inherit the priority; and clearing the flag would need
/// a privilege.
fn set(of: &Scheduling, policy: i32, priority: i32) -> Result<(), i32> {
    if !of.has_rank() {
        return Ok(());
    }
    set_scheduler(of.thread, policy | libc::SCHED_RESET_ON_FORK, priority)
        .map_err(|error| error as i32)
}
