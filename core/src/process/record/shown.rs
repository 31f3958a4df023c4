//! What a record has for the threads that wait for its process, and for those that look at it.

use super::RawExit;
use crate::current::Process;
use crate::waiting::OpList;
use core::ptr;
use core::sync::atomic::{AtomicPtr, Ordering};

/// The record's view of the process itself, in one word: nothing yet, its address, or how often it
/// was polled before it went.
///
/// # Invariants
///
/// It is changed under the record's lock. A process that is here while the lock is held is live,
/// and has a waker: it clears this before it goes.
pub(in crate::process) struct Seen(pub(in crate::process) AtomicPtr<Process>);

impl Seen {
    pub(in crate::process) const fn nothing() -> Self {
        Self(AtomicPtr::new(ptr::null_mut()))
    }

    /// That of a process that was polled so often before it went.
    pub(in crate::process) fn gone(polls: u64) -> Self {
        let most = usize::MAX >> 1;
        let polls = usize::try_from(polls).unwrap_or(most).min(most);
        Self(AtomicPtr::new(ptr::without_provenance_mut(polls << 1 | 1)))
    }

    /// How often a process that has gone was polled. No process lies at an odd address.
    pub(in crate::process) fn polls_of_gone(word: *mut Process) -> Option<u64> {
        let word = word.addr();
        (word & 1 != 0).then_some((word >> 1) as u64)
    }

    /// How often the process was polled, if it has gone: without the lock, since that does not
    /// change any more.
    pub(in crate::process) fn last_polls(&self) -> Option<u64> {
        Self::polls_of_gone(self.0.load(Ordering::Acquire))
    }

    /// The process, if it is there.
    ///
    /// # Safety
    ///
    /// The record's lock is held as long as what is returned is used.
    pub(in crate::process) unsafe fn process(&self) -> Option<&Process> {
        let word = self.0.load(Ordering::Relaxed);
        if Self::polls_of_gone(word).is_some() {
            return None;
        }
        // SAFETY: the caller promises that the lock is held as long as the result is used; by the
        // invariant a process that is here is live meanwhile.
        unsafe { word.as_ref() }
    }

    /// How often it was polled.
    ///
    /// # Safety
    ///
    /// The record's lock is held.
    pub(in crate::process) unsafe fn polls(&self) -> u64 {
        // SAFETY: the caller promises that the record's lock is held, so also until the process was
        // asked.
        let process = unsafe { self.process() };
        process.map_or(self.last_polls().unwrap_or(0), Process::polls)
    }

    /// Clears the pointer: the process goes.
    ///
    /// # Safety
    ///
    /// The record's lock is held.
    pub(in crate::process) unsafe fn forget(&self) {
        // SAFETY: the caller promises that the record's lock is held, as `polls` requires.
        let gone = Self::gone(unsafe { self.polls() });
        self.0.store(gone.0.into_inner(), Ordering::Release);
    }
}

/// State that other threads read and change.
pub(in crate::process) struct Shown {
    pub(in crate::process) joining: OpList<()>,
    /// Of a process that has ended, with what is to be taken.
    pub(in crate::process) exit: RawExit,
}

impl Shown {
    pub(in crate::process) const fn nothing() -> Self {
        Self {
            joining: OpList::new(),
            exit: RawExit::Completed,
        }
    }
}
