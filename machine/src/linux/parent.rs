//! A descriptor of the parent process.

use crate::parent::Watched;
use nix::errno::Errno;
use nix::libc;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::eventfd::{EfdFlags, EventFd};
use nix::unistd::getppid;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, FromRawFd, OwnedFd};

/// Watches the process that is this one's parent.
#[derive(Debug)]
pub struct ParentWatch {
    /// None: it had ended before there was a descriptor.
    parent: Option<OwnedFd>,
    stop: EventFd,
}

impl ParentWatch {
    /// Watches the parent, from now on; one that ends at this very moment is seen too. Not for the
    /// real-time path.
    ///
    /// # Errors
    ///
    /// The system cannot watch a process: Linux does from 5.3.
    pub fn new() -> io::Result<Self> {
        let stop = EventFd::from_flags(EfdFlags::EFD_CLOEXEC)?;
        let parent = getppid();
        // SAFETY: a plain system call; what it returns is a new descriptor, or an error.
        let opened = unsafe { libc::syscall(libc::SYS_pidfd_open, parent.as_raw(), 0) };
        let descriptor = match Errno::result(opened) {
            Ok(number) => {
                // SAFETY: the descriptor is open, and this is its only owner.
                let descriptor = unsafe { OwnedFd::from_raw_fd(number as i32) };
                // If the process is still the parent now, its number was not reused before the
                // descriptor was opened.
                (getppid() == parent).then_some(descriptor)
            }
            Err(Errno::ESRCH) => None,
            Err(error) => return Err(error.into()),
        };
        Ok(Self {
            parent: descriptor,
            stop,
        })
    }

    /// Blocks until the parent has ended, or [`stop`](Self::stop) was called. If the true parent
    /// ended before the watch began, another process has taken its place: the end of that one is
    /// not seen.
    pub fn wait(&self) -> Watched {
        let Some(parent) = &self.parent else {
            return Watched::HasEnded;
        };
        loop {
            let mut waited = [
                PollFd::new(parent.as_fd(), PollFlags::POLLIN),
                PollFd::new(self.stop.as_fd(), PollFlags::POLLIN),
            ];
            // Interrupted, or out of memory for a moment: again.
            if poll(&mut waited, PollTimeout::NONE).is_err() {
                continue;
            }
            let is_ready =
                |one: &PollFd<'_>| one.revents().is_some_and(|events| !events.is_empty());
            if is_ready(&waited[1]) {
                return Watched::Stopped;
            }
            if is_ready(&waited[0]) {
                return Watched::HasEnded;
            }
        }
    }

    /// Blocks until `input` has data or has ended, or until the parent has ended. Returns whether
    /// the input has something: what the parent had written before its end comes first. So a copy
    /// of the parent that holds the other end of a pipe open cannot keep this process waiting.
    pub fn wait_for_input(&self, input: BorrowedFd<'_>) -> bool {
        loop {
            let watched = [Some(input), self.parent.as_ref().map(AsFd::as_fd)];
            let watched = watched.into_iter().flatten();
            let mut waited: Vec<_> = watched
                .map(|fd| PollFd::new(fd, PollFlags::POLLIN))
                .collect();
            let timeout = match self.parent {
                Some(_) => PollTimeout::NONE,
                None => PollTimeout::ZERO,
            };
            // Interrupted, or out of memory for a moment: again.
            if poll(&mut waited, timeout).is_err() {
                continue;
            }
            let is_ready =
                |one: &PollFd<'_>| one.revents().is_some_and(|events| !events.is_empty());
            if is_ready(&waited[0]) {
                return true;
            }
            let has_ended = waited.get(1).is_none_or(is_ready);
            if has_ended {
                // The parent may have written between the two looks of the kernel, and then ended.
                let mut input = [PollFd::new(input, PollFlags::POLLIN)];
                return poll(&mut input, PollTimeout::ZERO).is_ok_and(|ready| ready > 0);
            }
        }
    }

    /// Ends the wait, from any thread, for good.
    pub fn stop(&self) {
        // It fails only when the count is at its end, and then it is not zero.
        let _ = self.stop.write(1);
    }
}

/// Makes this process survive what ends its terminal or its session, or is typed there: for a
/// process that must be the last.
pub(crate) fn outlive_requests() {
    // Fails for the leader of a process group, which is in a session of its own already, or was
    // started by a user.
    let _ = nix::unistd::setsid();
    for signal in [
        libc::SIGINT,
        libc::SIGTERM,
        libc::SIGHUP,
        libc::SIGQUIT,
        libc::SIGPIPE,
    ] {
        // SAFETY: to ignore a signal runs nothing.
        unsafe { libc::signal(signal, libc::SIG_IGN) };
    }
}
