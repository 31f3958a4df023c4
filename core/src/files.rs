//! Waiting for files and sockets: the futures. What a thread keeps of them is in `watch`.

use crate::current;
use crate::current::WakeHandle;
use crate::events;
use crate::file_error::FileError;
use crate::file_waits::Node;
use crate::file_watch::ThreadFiles;
use luna_platform::reactor::Interest;
use std::cell::UnsafeCell;
use std::future::Future;
use std::marker::PhantomPinned;
use std::os::fd::{AsFd, BorrowedFd};
use std::pin::Pin;
use std::ptr::NonNull;
use std::sync::Arc;
use std::task::{Context, Poll};

/// Waits until reading from `file` does not block: it has something to read, is at its end, or has
/// an error.
///
/// It is a hint: another reader may be faster, so keep the file in non-blocking mode, read, and
/// wait again if that would block. The most urgent of several waits for one file is readied first,
/// but all of them are.
///
/// Works in the processes of an executor, in an [`OsThread`](crate::OsThread) and in
/// [`block_on`](crate::block_on). The thread sleeps in an epoll from its first such wait on; while
/// it is busy it looks at its files every 64 polls, so a process that waits for one is readied at
/// the latest after 64 polls of others (and as many more for each 64 files that became ready
/// before).
///
/// Real-time path: yes, apart from the first wait of a thread, which makes the epoll: see
/// [`prepare_files`](crate::prepare_files). Nothing is allocated. A wait costs one system call, two
/// for a file that this thread has not waited for before; O(w) steps for w waits of this thread on
/// descriptors equal modulo 256. An executor on which no process waits for a file pays nothing.
///
/// Cancel-safe: a wait that is dropped is withdrawn, at the price of one system call if nothing
/// else waits for the file.
///
/// # Errors
///
/// [`FileError`]: no process runs here, the platform cannot, or the file cannot be waited for, as
/// those on a disk, which always count as ready.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use luna_core::{FileError, block_on, readable};
/// use std::io::{Read, Write};
/// use std::os::unix::net::UnixStream;
///
/// let (mut near, mut far) = UnixStream::pair()?;
/// near.set_nonblocking(true)?;
/// far.write_all(b"hello")?;
/// let mut text = [0; 5];
/// match block_on(readable(&near))? {
///     Ok(()) => assert_eq!(near.read(&mut text)?, 5),
///     Err(error) => assert!(error.is_unsupported()), // not on Linux
/// }
/// # Ok(()) }
/// ```
pub fn readable(file: &impl AsFd) -> FileReady<'_> {
    FileReady::new(file.as_fd(), Interest::Readable)
}

/// Waits until writing to `file` does not block: there is room, or the other side has gone, or it
/// has an error.
///
/// All else, the costs and the errors, is as for [`readable`].
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use luna_core::{block_on, writable};
///
/// let (near, _far) = std::os::unix::net::UnixStream::pair()?;
/// match block_on(writable(&near))? {
///     Ok(()) => {} // there is room in a new socket
///     Err(error) => assert!(error.is_unsupported()),
/// }
/// # Ok(()) }
/// ```
pub fn writable(file: &impl AsFd) -> FileReady<'_> {
    FileReady::new(file.as_fd(), Interest::Writable)
}

/// Made by [`readable`] and [`writable`]. It borrows the file, which therefore cannot be closed
/// meanwhile.
///
/// # Invariants
///
/// `node` is in the list of `files`, or has been readied by it, exactly while there are `files`; it
/// is then pinned, and their lock guards it.
#[must_use = "it waits only when awaited"]
pub struct FileReady<'file> {
    file: BorrowedFd<'file>,
    files: Option<Arc<ThreadFiles>>,
    node: UnsafeCell<Node>,
    _pinned: PhantomPinned,
}

// SAFETY: the node is guarded by the lock of the files that it is listed in, wherever the future
// is.
unsafe impl Send for FileReady<'_> {}
// SAFETY: `&FileReady` gives access to nothing that changes.
unsafe impl Sync for FileReady<'_> {}

impl<'file> FileReady<'file> {
    fn new(file: BorrowedFd<'file>, interest: Interest) -> Self {
        Self {
            file,
            files: None,
            node: UnsafeCell::new(Node::new(file, interest)),
            _pinned: PhantomPinned,
        }
    }

    fn node(&self) -> NonNull<Node> {
        NonNull::from(&self.node).cast()
    }
}

impl Future for FileReady<'_> {
    type Output = Result<(), FileError>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        current::replay_log(|log| log.outside("waiting for a file"));
        let node = this.node();
        let here = match ThreadFiles::here() {
            Ok(here) => here,
            Err(error) => return Poll::Ready(Err(error)),
        };
        if let Some(files) = &this.files {
            // SAFETY: the node was listed there.
            if unsafe { files.is_pending(node, cx) } {
                if Arc::ptr_eq(files, &here) {
                    events::waits_for_other();
                    return Poll::Pending;
                }
                // A wait belongs to the thread that polls it: another one's may not look at its
                // files any more. SAFETY: the node was enlisted there, for this file.
                unsafe { files.withdraw(node, this.file) };
                this.files = None;
            } else {
                this.files = None;
                return Poll::Ready(Ok(()));
            }
        }
        // SAFETY: the node is pinned and in no list; it is withdrawn before it dies.
        match unsafe { here.enlist(node, this.file, WakeHandle::of(cx)) } {
            Ok(()) => {
                this.files = Some(here);
                events::waits_for_other();
                Poll::Pending
            }
            Err(error) => Poll::Ready(Err(error)),
        }
    }
}

impl Drop for FileReady<'_> {
    fn drop(&mut self) {
        if let Some(files) = &self.files {
            events::waits_no_more(|| None);
            // SAFETY: the node was listed there.
            unsafe { files.withdraw(self.node(), self.file) };
        }
    }
}

luna_platform::debug_fields!(FileReady<'_>, |ready| file: ready.file, waits: ready.files.is_some());
