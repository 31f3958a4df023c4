//! Where facts are read from: this machine's files, or a copy of another's.

use crate::backend::facts as backend;
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

/// The most bytes of a file that are read: the kernel's own are far smaller.
const MAX_BYTES: u64 = 4 << 20;

/// The most entries of a folder that are listed.
const MAX_ENTRIES: usize = 100_000;

/// The files with the facts (`/proc`, `/sys`, `/dev`, `/boot`), of this machine or below a folder
/// that holds a copy of them.
///
/// Not for the real-time path: it opens files and allocates.
///
/// ```
/// use luna_machine::facts::{Source, UnreadReason};
///
/// let nowhere = Source::folder("/no/such/folder");
/// let unread = nowhere.read("/proc/cmdline").unwrap_err();
/// assert_eq!(unread.file, "/proc/cmdline");
/// assert_eq!(unread.reason, UnreadReason::Missing);
/// ```
#[derive(Debug, Clone)]
pub struct Source {
    /// Nothing where the backend knows no such files.
    root: Option<PathBuf>,
    machine: bool,
}

impl Source {
    /// The files of this machine. On the portable backend none can be read.
    pub fn machine() -> Source {
        Source {
            root: backend::ROOT.map(PathBuf::from),
            machine: true,
        }
    }

    /// The files below `folder`, which holds `proc`, `sys` and so on. On every backend.
    pub fn folder(folder: impl Into<PathBuf>) -> Source {
        Source {
            root: Some(folder.into()),
            machine: false,
        }
    }

    /// Whether these are the files of this machine, and not a copy.
    pub fn is_machine(&self) -> bool {
        self.machine
    }

    /// The text of `file`, an absolute path. Bytes that are no text are replaced; at most 4 MiB are
    /// read, of a regular file.
    ///
    /// # Errors
    ///
    /// [`Unread`] reports which file, and why.
    pub fn read(&self, file: &str) -> Result<String, Unread> {
        let bytes = self.read_bytes(file)?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// The bytes of `file`, as [`read`](Self::read) its text.
    ///
    /// # Errors
    ///
    /// [`Unread`] reports which file, and why.
    pub fn read_bytes(&self, file: &str) -> Result<Vec<u8>, Unread> {
        let read = || {
            let opened = File::open(self.path(file)?)?;
            // A copy may hold a pipe by mistake, which would never end.
            if !opened.metadata()?.is_file() {
                return Err(UnreadReason::Malformed);
            }
            let mut bytes = Vec::new();
            opened.take(MAX_BYTES).read_to_end(&mut bytes)?;
            Ok(bytes)
        };
        read().map_err(|reason| Unread::new(file, reason))
    }

    /// What `parser` makes of the text of `file`.
    ///
    /// # Errors
    ///
    /// [`Unread`], with [`UnreadReason::Malformed`] if the parser makes nothing of it.
    ///
    /// ```
    /// use luna_machine::facts::{Source, parse};
    ///
    /// match Source::machine().parse("/sys/devices/system/cpu/online", parse::core_list) {
    ///     Ok(cores) => assert!(!cores.is_empty()),
    ///     Err(unread) => eprintln!("{unread}"),
    /// }
    /// ```
    pub fn parse<T>(
        &self,
        file: &str,
        parser: impl FnOnce(&str) -> Option<T>,
    ) -> Result<T, Unread> {
        let text = self.read(file)?;
        parser(&text).ok_or_else(|| Unread::new(file, UnreadReason::Malformed))
    }

    /// The one word or line of `file`, without white space around it; an empty file is malformed.
    ///
    /// # Errors
    ///
    /// As [`parse`](Self::parse).
    pub fn word(&self, file: &str) -> Result<String, Unread> {
        self.parse(file, |text| {
            Some(text.trim().to_owned()).filter(|word| !word.is_empty())
        })
    }

    /// The names in `folder`, sorted; at most 100 000.
    ///
    /// # Errors
    ///
    /// [`Unread`] reports why it cannot be listed.
    pub fn list(&self, folder: &str) -> Result<Vec<String>, Unread> {
        let list = || {
            let entries = fs::read_dir(self.path(folder)?)?.flatten();
            let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
            let mut names: Vec<_> = names.take(MAX_ENTRIES).collect();
            names.sort_unstable();
            Ok(names)
        };
        list().map_err(|reason| Unread::new(folder, reason))
    }

    /// Whether there is such a file or folder, as far as this process can see.
    pub fn has(&self, file: &str) -> bool {
        self.path(file).is_ok_and(|path| path.exists())
    }

    /// Whether this process may write to `file`: opens it for writing, and writes nothing.
    ///
    /// # Errors
    ///
    /// [`Unread`] reports why not.
    pub fn may_write(&self, file: &str) -> Result<(), Unread> {
        let open = || {
            OpenOptions::new().write(true).open(self.path(file)?)?;
            Ok(())
        };
        open().map_err(|reason| Unread::new(file, reason))
    }

    fn path(&self, file: &str) -> Result<PathBuf, UnreadReason> {
        let root = self.root.as_deref().ok_or(UnreadReason::Unsupported)?;
        Ok(Path::new(root).join(file.trim_start_matches('/')))
    }
}

/// A file that could not be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{file} {reason}")]
#[non_exhaustive]
pub struct Unread {
    /// Its path, as on the machine that it is of.
    pub file: String,
    /// Why.
    pub reason: UnreadReason,
}

/// Why a file could not be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum UnreadReason {
    /// There is none: another kernel, a container, or nothing of the kind on this machine.
    #[error("does not exist")]
    Missing,
    /// This process may not read it.
    #[error("may not be opened by this user")]
    NotPermitted,
    /// It has not the form that it should have.
    #[error("has an unknown form")]
    Malformed,
    /// This backend knows no such files.
    #[error("is not read by the portable backend")]
    Unsupported,
    /// Another error of the system.
    #[error("cannot be read: {message}")]
    Other {
        /// Its words.
        message: String,
    },
}

impl Unread {
    /// Reports that `file` could not be read, for `reason`.
    pub fn new(file: &str, reason: UnreadReason) -> Unread {
        Unread {
            file: file.to_owned(),
            reason,
        }
    }
}

impl From<std::io::Error> for UnreadReason {
    fn from(error: std::io::Error) -> Self {
        match error.kind() {
            ErrorKind::NotFound | ErrorKind::NotADirectory => UnreadReason::Missing,
            ErrorKind::PermissionDenied => UnreadReason::NotPermitted,
            _ => UnreadReason::Other {
                message: error.to_string(),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder of this test alone, gone when it is dropped.
    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Folder {
            let path = std::env::temp_dir().join(format!("luna-{name}-{}", std::process::id()));
            fs::create_dir_all(path.join("proc")).unwrap();
            Folder(path)
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn reads_below_its_folder_and_names_the_file_as_the_machine_does() {
        let folder = Folder::new("source");
        fs::write(folder.0.join("proc/word"), " value\n").unwrap();
        fs::write(folder.0.join("proc/empty"), "\n").unwrap();
        fs::write(folder.0.join("proc/bytes"), [b'a', 0xff, b'b']).unwrap();
        let source = Source::folder(&folder.0);
        assert!(!source.is_machine() && source.has("/proc/word") && !source.has("/proc/none"));
        assert_eq!(source.word("/proc/word").unwrap(), "value");
        assert_eq!(source.read("/proc/bytes").unwrap(), "a\u{fffd}b");
        assert_eq!(source.list("/proc").unwrap(), ["bytes", "empty", "word"]);
        assert_eq!(source.may_write("/proc/word"), Ok(()));
        let reason = |outcome: Result<String, Unread>| outcome.unwrap_err().reason;
        assert_eq!(reason(source.word("/proc/empty")), UnreadReason::Malformed);
        assert_eq!(reason(source.read("/proc")), UnreadReason::Malformed);
        assert_eq!(reason(source.read("/proc/none")), UnreadReason::Missing);
        assert_eq!(
            reason(source.read("/proc/word/none")),
            UnreadReason::Missing
        );
        assert_eq!(
            source.may_write("/proc/none").unwrap_err().to_string(),
            "/proc/none does not exist"
        );
    }
}
