//! A process that is to be built on its executor.

use super::Phase;
use crate::process::poll_monitor;
use crate::task::Unbuilt;
use core::fmt;
use luna_core::current;

/// A process to be, on its executor: see
/// [`ExecutorHandle::announce`](crate::ExecutorHandle::announce). If it is dropped, the process
/// ends as cancelled, and its builder is dropped.
#[must_use = "a process that is announced and not started ends as cancelled"]
pub struct Announced {
    pub(super) process: Unbuilt,
    /// The result of [`is_built_here`](Self::is_built_here).
    pub(super) decided: Option<bool>,
}

impl Announced {
    /// Whether [`start`](Self::start) builds the process before it returns: then it calls what is
    /// the user's. If not, it only hands it over.
    pub fn is_built_here(&mut self) -> bool {
        let here = self.can_be_built_here();
        self.decided = Some(here);
        here
    }

    /// In a monitored turn, and in one that drops an abandoned body, a builder would count as a
    /// part of that turn. Then it gets a turn of its own.
    pub(super) fn can_be_built_here(&self) -> bool {
        let shared = self.process.shared();
        current::executor_id() == Some(shared.executor_id)
            && shared.phase() == Phase::RELEASED
            && poll_monitor().is_none()
            && !current::is_abandoned()
            && !current::dropped_ends_poison()
    }

    /// Starts the process: as [`ExecutorHandle::spawn`](crate::ExecutorHandle::spawn). On an
    /// executor that has stopped, gives it back: its builder is the user's, and is dropped with
    /// what is given.
    #[must_use = "dropping it drops what is the user's, which is nothing to be done under a lock"]
    pub fn start(self) -> Option<Announced> {
        // A caller that saw what is done here relies on it. The executor may be released meanwhile,
        // or asked to stop: that it sees after this turn. This may have gone to another thread.
        let is_decided = self.decided == Some(true)
            && current::executor_id() == Some(self.process.shared().executor_id);
        if is_decided || self.decided.is_none() && self.can_be_built_here() {
            // Off the path, and no part of the turn in the middle of which it is done.
            let on_path = current::set_on_path(false);
            // SAFETY: building a process uses no turn of the caller's.
            unsafe { current::outside(|| self.process.build()) };
            current::set_on_path(on_path);
            return None;
        }
        let shared = self.process.shared().clone();
        {
            let mut arrivals = shared.arrivals.lock();
            if arrivals.closed {
                return Some(self);
            }
            arrivals.announced = arrivals.announced.wrapping_add(1);
            arrivals.waiting.push(self.process);
        }
        // A held executor looks when it is released, or waited for: waking it for each process
        // would cost a switch between threads. If it is released meanwhile it has either found the
        // process, or its phase was set before the lock was taken here.
        if shared.phase() != Phase::HELD {
            shared.inbound.ask_attention();
        }
        None
    }
}

impl fmt::Debug for Announced {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Announced")
            .field(self.process.record())
            .finish()
    }
}
