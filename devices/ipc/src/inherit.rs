//! Priority inheritance across programs.
//!
//! The caller's link raises the thread of the server's link, by a system call that names it, before
//! it publishes the request, and sets it back when the caller has the answer. So the thread has the
//! caller's priority before it has to run, and one program alone changes it. A lock with priority
//! inheritance in shared memory would do the same, but the caller's thread would have to block in
//! it, with all other processes of its executor.
//!
//! If the caller's program is killed, the server's link sets its own thread back.

use crate::Status;
use crate::session::Session;
use luna::realtime::off_path;
use luna_platform::path::{Call, expected};
use std::sync::atomic::Ordering::{Acquire, Relaxed, Release, SeqCst};

/// What a thread is scheduled by: a policy and a priority.
#[derive(Debug, Clone, Copy)]
struct Scheduling {
    thread: i32,
    policy: i32,
    priority: i32,
}

impl Scheduling {
    /// Of the calling thread.
    fn here() -> Option<Self> {
        let mut parameter = libc::sched_param { sched_priority: 0 };
        // SAFETY: the calls read the calling thread's attributes, into a structure that is there.
        let (thread, policy, read) = unsafe {
            (
                libc::gettid(),
                libc::sched_getscheduler(0),
                libc::sched_getparam(0, &mut parameter),
            )
        };
        (policy >= 0 && read == 0).then_some(Self {
            thread,
            policy,
            priority: parameter.sched_priority,
        })
    }

    /// Its real-time priority; 0 without one; none of a deadline thread, which is above all.
    fn rank(&self) -> Option<i32> {
        match self.policy & !libc::SCHED_RESET_ON_FORK {
            libc::SCHED_FIFO | libc::SCHED_RR => Some(self.priority),
            libc::SCHED_DEADLINE => None,
            _ => Some(0),
        }
    }

    /// Schedules the thread by it. Whether the system allows it.
    fn set(&self) -> bool {
        // Threads that it starts meanwhile do not inherit the priority.
        let policy = self.policy | libc::SCHED_RESET_ON_FORK;
        let parameter = libc::sched_param {
            sched_priority: self.priority,
        };
        // SAFETY: takes numbers and a structure that is there.
        expected(Call::Boost, || unsafe {
            libc::sched_setscheduler(self.thread, policy, &parameter) == 0
        })
    }
}

/// The thread of the other program's link runs at the caller's priority until this is dropped.
#[derive(Debug)]
pub(crate) struct Raised {
    own: Scheduling,
}

impl Raised {
    /// Raises the thread that serves the session to the priority of the running process, which has
    /// inherited the caller's. None: it is as high already, has ended, or the system refuses, which
    /// is counted.
    pub(crate) fn to_caller(session: &Session, status: &Status) -> Option<Self> {
        // Above the highest priority is only a deadline thread.
        let caller = i32::from(luna_core::current::priority().thread).min(99);
        let server = session.other();
        let own = Scheduling {
            thread: server.thread.load(Acquire),
            policy: server.policy.load(Relaxed),
            priority: server.priority.load(Relaxed),
        };
        if own.thread <= 0 || own.rank().is_none_or(|rank| rank >= caller) {
            session.own().raised.store(0, Relaxed);
            return None;
        }
        // Before it is so: if this program is killed in between, the other one sets itself back.
        session.own().raised.store(1, SeqCst);
        let raised = Scheduling {
            policy: libc::SCHED_FIFO,
            priority: caller,
            ..own
        };
        if !raised.set() {
            status.refuse_priority();
            return None;
        }
        Some(Self { own })
    }
}

impl Drop for Raised {
    fn drop(&mut self) {
        // It can only fail if the thread has ended.
        self.own.set();
    }
}

/// The calling thread serves a session, until this is dropped.
#[derive(Debug)]
pub(crate) struct Servant<'a> {
    session: &'a Session,
    own: Option<Scheduling>,
}

impl<'a> Servant<'a> {
    /// Tells the other program which thread to raise.
    pub(crate) fn here(session: &'a Session) -> Self {
        let own = off_path(Scheduling::here);
        let side = session.own();
        if let Some(own) = own {
            side.policy.store(own.policy, Relaxed);
            side.priority.store(own.priority, Relaxed);
        }
        // It runs, also if the system does not say how.
        let thread = own.map_or(-1, |own| own.thread);
        side.thread.store(thread, Release);
        Self { session, own }
    }

    /// Whether the other program has stated so, so that the first call is inherited too.
    pub(crate) fn is_there(session: &Session) -> bool {
        session.other().thread.load(Acquire) != 0
    }

    /// Leaves the core to the caller, if it has raised this thread to its own priority and waits on
    /// the same core. On another one it sets this thread back soon.
    pub(crate) fn yield_to_caller(session: &Session) {
        if session.other().raised.load(Relaxed) != 0 {
            // SAFETY: takes nothing.
            expected(Call::Boost, || unsafe { libc::sched_yield() });
        }
    }
}

impl Drop for Servant<'_> {
    fn drop(&mut self) {
        self.session.own().thread.store(0, SeqCst);
        if let Some(own) = &self.own
            && self.session.other().raised.load(SeqCst) != 0
        {
            own.set();
        }
    }
}
