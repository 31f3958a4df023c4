//! The waits for files, found by the number of the file's descriptor.

use crate::current::PendingWake;
use crate::waiting::OpList;
use luna_platform::reactor::{Interest, Readiness};
use std::os::fd::RawFd;

/// Number of lists for the waits.
const LISTS: usize = 256;

/// What a wait is for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FileWait {
    pub(crate) fd: RawFd,
    pub(crate) interest: Interest,
}

impl FileWait {
    /// Whether `readiness` is what it waits for.
    pub(crate) fn wants(self, readiness: Readiness) -> bool {
        match self.interest {
            Interest::Readable => readiness.readable,
            Interest::Writable => readiness.writable,
            Interest::Both => readiness.readable || readiness.writable,
        }
    }
}

/// What both together want.
pub(crate) fn both(one: Interest, other: Interest) -> Interest {
    if one == other { one } else { Interest::Both }
}

/// All waits of one thread: in 256 lists by the number of the descriptor, most urgent first. It
/// belongs to a lock, which guards the nodes in it too.
pub(crate) struct Waits(Box<[OpList<FileWait>]>);

impl Waits {
    pub(crate) fn new() -> Self {
        Self((0..LISTS).map(|_| OpList::new()).collect())
    }

    /// The list of the waits for `fd`, and for others of the same number modulo 256.
    pub(crate) fn list(&mut self, fd: RawFd) -> &mut OpList<FileWait> {
        &mut self.0[fd as usize % LISTS]
    }

    /// Removes the most urgent of the waits for `fd` that are `meant`, and returns its wake.
    /// O(waits with descriptors equal modulo 256).
    pub(crate) fn take(
        &mut self,
        fd: RawFd,
        meant: impl Fn(FileWait) -> bool,
    ) -> Option<PendingWake> {
        self.list(fd).take(|wait| wait.fd == fd && meant(wait))
    }

    /// The union of the interests of all waits for `fd`. O(waits with descriptors equal modulo
    /// 256).
    pub(crate) fn interest(&mut self, fd: RawFd) -> Option<Interest> {
        let waits = self.list(fd).waiting().map(|(_, wait)| wait);
        let interests = waits.filter(|wait| wait.fd == fd).map(|wait| wait.interest);
        interests.reduce(both)
    }
}
