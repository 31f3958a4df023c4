//! The name of a channel, and of its files.

use crate::{IpcError, Role};
use std::path::{Path, PathBuf};

/// Where the files are: POSIX shared memory is there too.
pub(crate) const FOLDER: &str = "/dev/shm";
/// How the names of all files begin.
pub(crate) const PREFIX: &str = "luna-ipc.";
/// How the name of a lock file ends.
pub(crate) const LOCK: &str = ".lock";

/// A name that was checked.
#[derive(Debug, Clone)]
pub(crate) struct Name {
    text: String,
    /// The beginning of the names of its files.
    base: String,
}

impl Name {
    pub(crate) fn new(text: &str) -> Result<Self, IpcError> {
        let is_allowed = |c: char| c.is_ascii_alphanumeric() || "_-./".contains(c);
        if text.is_empty() || text.len() > 180 || !text.chars().all(is_allowed) {
            return Err(IpcError::Name {
                name: text.to_owned(),
            });
        }
        // `+` is in no name, so no two names have one file.
        let base = format!("{PREFIX}{}", text.replace('/', "+"));
        Ok(Self {
            text: text.to_owned(),
            base,
        })
    }

    /// Of the channel that has a lock file of this name.
    pub(crate) fn of_lock(file: &str) -> Option<Self> {
        let base = file.strip_prefix(PREFIX)?.strip_suffix(LOCK)?;
        Self::new(&base.replace('+', "/")).ok()
    }

    pub(crate) fn text(&self) -> &str {
        &self.text
    }

    pub(crate) fn lock(&self) -> PathBuf {
        Path::new(FOLDER).join(format!("{}{LOCK}", self.base))
    }

    pub(crate) fn bell(&self, role: Role) -> PathBuf {
        Path::new(FOLDER).join(format!("{}.{}", self.base, role.word()))
    }

    /// The shared memory.
    pub(crate) fn memory(&self) -> PathBuf {
        Path::new(FOLDER).join(format!("{}.words", self.base))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_checked_and_come_back() {
        for bad in ["", "a b", "a+b", "ä", &"x".repeat(181)] {
            assert!(Name::new(bad).is_err(), "{bad}");
        }
        let name = Name::new("cell/feeder/ready").unwrap();
        let lock = name.lock();
        let file = lock.file_name().unwrap().to_str().unwrap();
        assert_eq!(file, "luna-ipc.cell+feeder+ready.lock");
        assert_eq!(Name::of_lock(file).unwrap().text(), "cell/feeder/ready");
        assert!(Name::of_lock("luna-ipc.x.words").is_none());
    }
}
