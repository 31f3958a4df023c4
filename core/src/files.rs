//! Waiting for files and sockets: the futures. What a thread keeps of them is in `file_watch`.

use crate::current;
use crate::file_watch::{FileWait, ThreadFiles, Waits};
use crate::waiting::{Kind, Op, OpList};
use luna_platform::reactor::{Interest, ReactorError};
use pin_project_lite::pin_project;
use std::future::Future;
use std::io;
use std::ops::DerefMut;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::pin::Pin;
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

pin_project! {
    /// Made by [`readable`] and [`writable`]. It borrows the file, which therefore cannot be closed
    /// meanwhile.
    #[must_use = "it waits only when awaited"]
    pub struct FileReady<'file> {
        file: BorrowedFd<'file>,
        interest: Interest,
        // From the first poll on.
        #[pin]
        op: Option<Op<Ready<'file>>>,
    }
}

/// That a file is ready, as the thread that polls learns of it.
struct Ready<'file> {
    file: BorrowedFd<'file>,
    wait: FileWait,
    files: Arc<ThreadFiles>,
}

impl<'file> FileReady<'file> {
    fn new(file: BorrowedFd<'file>, interest: Interest) -> Self {
        Self {
            file,
            interest,
            op: None,
        }
    }
}

// SAFETY: the files of a thread have one lock, which guards the list of each number.
unsafe impl Kind for Ready<'_> {
    type Queue = Waits;
    type Note = FileWait;
    type Output = Result<(), FileError>;

    fn lock(&self) -> impl DerefMut<Target = Waits> {
        self.files.waits.lock()
    }

    fn list<'q>(&self, waits: &'q mut Waits) -> &'q mut OpList<FileWait> {
        waits.list(self.wait.fd)
    }

    fn attempt(&self, _: &mut Waits) -> Option<Self::Output> {
        None
    }

    fn begin(&self, waits: &mut Waits) -> Result<FileWait, Self::Output> {
        let armed = self.files.arm(waits, self.file, self.wait);
        armed.map(|()| self.wait).map_err(Err)
    }

    fn settled(&self) -> Option<Self::Output> {
        Some(Ok(()))
    }

    fn withdrawn(&self, waits: &mut Waits) {
        self.files.disarm(waits, self.file);
    }
}

impl Future for FileReady<'_> {
    type Output = Result<(), FileError>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        current::replay_log(|log| log.outside("waiting for a file"));
        let mut this = self.project();
        let here = match ThreadFiles::here() {
            Ok(here) => here,
            Err(error) => return Poll::Ready(Err(error)),
        };
        loop {
            let op = this.op.as_mut().as_pin_mut();
            // A wait belongs to the thread that polls it: another one's may not look at its files
            // any more.
            if let Some(op) = op.filter(|op| Arc::ptr_eq(&op.kind().files, &here)) {
                return op.poll(cx);
            }
            let wait = FileWait {
                fd: this.file.as_raw_fd(),
                interest: *this.interest,
            };
            this.op.set(Some(Op::new(Ready {
                file: *this.file,
                wait,
                files: here.clone(),
            })));
        }
    }
}

luna_platform::debug_fields!(FileReady<'_>, |ready| file: ready.file, waits: ready.op.is_some());

/// Why a process cannot wait for a file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// This thread runs no process of LUNA, so it never looks at files.
    #[error(
        "a file was awaited on a thread that runs no LUNA process: await it inside luna::run, a \
         process of a System, or use your runtime's own means"
    )]
    NoProcess,
    /// The system cannot watch the file, or no file at all.
    #[error("{0}")]
    Refused(#[source] ReactorError),
}

impl FileError {
    /// Whether this platform cannot wait for any file: then a blocking call can
    /// ([`blocking`](crate::blocking)).
    pub fn is_unsupported(&self) -> bool {
        *self == FileError::Refused(ReactorError::Unsupported)
    }
}

impl From<FileError> for io::Error {
    fn from(error: FileError) -> io::Error {
        let kind = match &error {
            FileError::Refused(ReactorError::Unsupported | ReactorError::AlwaysReady { .. }) => {
                io::ErrorKind::Unsupported
            }
            _ => io::ErrorKind::Other,
        };
        io::Error::new(kind, error)
    }
}
