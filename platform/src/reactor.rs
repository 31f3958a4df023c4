//! Waiting for files, for a deadline and for other threads at once: an executor sleeps in it when
//! its processes wait for files.

pub use crate::backend::reactor::Reactor;
#[cfg(any(unix, target_os = "wasi"))]
pub use std::os::fd::BorrowedFd;

/// A borrowed file descriptor. This system has none of the kind, so there is no value of this type.
#[cfg(not(any(unix, target_os = "wasi")))]
#[derive(Debug, Clone, Copy)]
pub struct BorrowedFd<'fd> {
    _never: std::convert::Infallible,
    _borrowed: std::marker::PhantomData<&'fd ()>,
}

/// What is waited for at a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Interest {
    /// That it can be read.
    Readable,
    /// That it can be written.
    Writable,
    /// Either.
    Both,
}

/// The readiness of a file. A file at its end, or with an error, is ready for both: reading or
/// writing then reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct Readiness {
    /// Reading does not wait.
    pub readable: bool,
    /// Writing does not wait.
    pub writable: bool,
    /// The other side has gone, or there is an error.
    pub closed: bool,
}

/// Why a wait ended. None of these: a signal's handler ran.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub struct Ended {
    /// How many files were reported.
    pub files: usize,
    /// Whether `wake` was called.
    pub woken: bool,
    /// Whether the deadline has come.
    pub timed_out: bool,
}

/// The tokens from this one on are the reactor's own.
pub const FIRST_RESERVED_TOKEN: u64 = u64::MAX - 1;

/// Why a file is not waited for.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ReactorError {
    /// The token is one of the reactor's own.
    #[error("the token {token} is the reactor's own; choose one below {FIRST_RESERVED_TOKEN}")]
    ReservedToken {
        /// The token given.
        token: u64,
    },
    /// The kernel cannot wait for this kind of file: one on a disk, or a directory. They are always
    /// ready.
    #[error(
        "descriptor {fd} is a file on a disk or a directory, which cannot be waited for; read it with \
         a blocking call on another thread"
    )]
    AlwaysReady {
        /// The file's descriptor.
        fd: i32,
    },
    /// The file is registered already.
    #[error("descriptor {fd} is registered already; rearm it, or deregister it first")]
    AlreadyRegistered {
        /// The file's descriptor.
        fd: i32,
    },
    /// The file is not registered here.
    #[error("descriptor {fd} is not registered here; register it first")]
    NotRegistered {
        /// The file's descriptor.
        fd: i32,
    },
    /// The kernel refused.
    #[error("{call} failed: {message}; see {call}(2)")]
    Kernel {
        /// The call that it refused.
        call: &'static str,
        /// Its words.
        message: String,
    },
    /// This backend cannot wait for files.
    #[error(
        "waiting for files needs Linux: the portable backend cannot; run it on Linux, built without \
         `--cfg luna_portable`"
    )]
    Unsupported,
}
