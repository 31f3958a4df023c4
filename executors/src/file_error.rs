//! Why waiting for files fails.

use luna_platform::reactor::ReactorError;
use std::fmt;
use std::io;

/// Why a process cannot wait for a file.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum FileError {
    /// This thread runs no process of LUNA, so it never looks at files.
    NoProcess,
    /// The system cannot watch the file, or no file at all.
    Refused(ReactorError),
}

impl FileError {
    /// Whether this platform cannot wait for any file: then a blocking call can
    /// ([`blocking`](crate::blocking)).
    pub fn is_unsupported(&self) -> bool {
        *self == FileError::Refused(ReactorError::Unsupported)
    }
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FileError::NoProcess => f.write_str(
                "a file was awaited on a thread that runs no LUNA process: await it inside luna::run, a process of a System, or use \
                 your runtime's own means",
            ),
            FileError::Refused(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for FileError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            FileError::NoProcess => None,
            FileError::Refused(error) => Some(error),
        }
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
