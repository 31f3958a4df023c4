//! A process that is to be built on its executor.

use super::Phase;
use crate::current;
use crate::process::{Unbuilt, is_monitored};
use alloc::collections::LinkedList;

/// A process to be, on its executor: see
/// [`ExecutorHandle::announce`](crate::ExecutorHandle::announce). If it is dropped, the process
/// ends as cancelled, and its builder is dropped.
#[must_use = "a process that is announced and not started ends as cancelled"]
pub struct Announced {
    pub(super) process: Unbuilt,
}

impl Announced {
    /// In a monitored turn, and in one that drops an abandoned body, a builder would count as a
    /// part of that turn. Then it gets a turn of its own.
    #[inline]
    fn can_be_built_here(&self) -> bool {
        let shared = self.process.executor();
        current::executor_id() == Some(shared.executor_id)
            && shared.phase() == Phase::RELEASED
            && !is_monitored()
            && !current::is_abandoned()
            && !current::dropped_ends_poison()
    }

    /// Starts the process: as [`ExecutorHandle::spawn`](crate::ExecutorHandle::spawn). On an
    /// executor that has stopped, gives it back: its builder is the user's, and is dropped with
    /// what is given.
    #[must_use = "dropping it drops what is the user's, which is nothing to be done under a lock"]
    pub fn start(self) -> Option<Announced> {
        self.start_under(())
    }

    /// As [`start`](Self::start), and drops `lock` meanwhile: after the process was handed over,
    /// and before anything of the user's is called.
    #[must_use = "dropping it drops what is the user's, which is nothing to be done under a lock"]
    pub fn start_under<L>(self, lock: L) -> Option<Announced> {
        if self.can_be_built_here() {
            drop(lock);
            self.build_here();
            return None;
        }
        self.hand_over()
    }

    #[inline]
    fn build_here(self) {
        // Off the path, and no part of the turn in the middle of which it is done.
        let on_path = current::set_on_path(false);
        // SAFETY: building a process uses no turn of the caller's.
        unsafe { current::outside(|| self.process.build()) };
        current::set_on_path(on_path);
    }

    #[cold]
    fn hand_over(self) -> Option<Announced> {
        let shared = self.process.executor().clone();
        // The list's node is allocated before the lock is taken.
        let mut process = LinkedList::from([self.process]);
        {
            let mut arrivals = shared.arrivals.lock();
            if arrivals.closed {
                drop(arrivals);
                return process.pop_front().map(|process| Self { process });
            }
            arrivals.announced = arrivals.announced.wrapping_add(1);
            arrivals.waiting.append(&mut process);
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

luna_platform::debug_fields!(Announced, |announced| process: announced.process.process());
