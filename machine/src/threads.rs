//! Threads in relation to others, and programs that threads start.

use crate::backend::threads as backend;
use luna_platform::on_drop::OnDrop;
use luna_platform::thread::Policy;
use std::process::Command;

/// The system's number of a thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ThreadNumber(i32);

impl ThreadNumber {
    pub(crate) fn get(self) -> i32 {
        self.0
    }
}

/// The calling thread's number: 0 if the system has none. One system call.
pub fn current_number() -> ThreadNumber {
    ThreadNumber(backend::current_number())
}

/// Lets the program that `command` starts run on all cores of this process and take signals,
/// whatever thread starts it. Without it a child has what its thread has: the core that it is
/// pinned to, and the signals SIGINT, SIGTERM, SIGHUP and SIGQUIT blocked. Its policy is an
/// ordinary one in any case. Does nothing where threads are not pinned. Not for the real-time path.
///
/// ```
/// use luna_machine::threads::ordinary_child;
/// use std::process::Command;
///
/// let mut command = Command::new("true");
/// assert!(ordinary_child(&mut command).get_program() == "true");
/// ```
pub fn ordinary_child(command: &mut Command) -> &mut Command {
    backend::ordinary_child(command);
    command
}

/// Gives another thread a policy with a fixed priority, if the program is allowed to: for a thread
/// that waits as an ordinary one until it is needed. One system call, async-signal-safe. Does
/// nothing for other policies, where threads have no priorities, or to one that has ended.
///
/// ```
/// use luna_machine::threads::{current_number, demote, promote};
/// use luna_platform::thread::Policy;
///
/// promote(current_number(), Policy::fifo(10));
/// # demote(current_number());
/// ```
pub fn promote(thread: ThreadNumber, policy: Policy) {
    backend::promote(thread.0, policy);
}

/// Gives another thread the lowest priority there is: no real-time policy, and nice 19. For a
/// thread that does not end; it needs no privilege. Three system calls at most. Does nothing where
/// threads have no priorities, or to one that has ended.
///
/// ```
/// use luna_machine::threads::{current_number, demote};
/// demote(current_number());
/// ```
pub fn demote(thread: ThreadNumber) {
    backend::demote(thread.0);
}

/// Until the guard is dropped, the calling thread runs before all threads of users: at SCHED_FIFO
/// 98, or at the user's limit, if the program is allowed to. For some steps that the threads which
/// they wake must not interrupt; start no thread meanwhile. Three system calls now, one when it is
/// dropped.
///
/// ```
/// use luna_machine::threads::above_users;
/// use luna_platform::thread::current_policy;
///
/// let own = current_policy();
/// drop(above_users());
/// assert_eq!(current_policy(), own);
/// ```
pub fn above_users() -> OnDrop<impl FnMut()> {
    backend::above_users()
}
