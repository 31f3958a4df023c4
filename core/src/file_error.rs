//! Why waiting for files fails.

use luna_platform::reactor::ReactorError;
use std::io;

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
