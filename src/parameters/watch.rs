//! The file's changes, which the thread that runs the system looks for.

use super::error::SetError;
use super::store::Store;
use luna_platform::clock::Instant;
use std::path::PathBuf;
use std::time::{Duration, SystemTime};

/// Looks now and then whether the file has changed.
pub(crate) struct FileWatch {
    file: PathBuf,
    every: Duration,
    next: Instant,
    seen: Option<Stamp>,
}

/// What changes of a file that is written.
type Stamp = (u64, SystemTime);

impl FileWatch {
    /// None if there is no file.
    pub(crate) fn new(store: &Store, every: Duration) -> Option<Self> {
        let file = store.file()?;
        Some(Self {
            seen: stamp(&file),
            file,
            every,
            next: Instant::now() + every,
        })
    }

    /// When to look again.
    pub(crate) fn next(&self) -> Instant {
        self.next
    }

    /// Looks, if it is time to; reads the file if it is another. An error is for once: until the file changes again.
    pub(crate) fn look(&mut self, store: &Store) -> Result<(), SetError> {
        let now = Instant::now();
        if now < self.next {
            return Ok(());
        }
        self.next = now + self.every;
        let stamp = stamp(&self.file);
        // One that is gone may be about to be replaced.
        if stamp.is_none() || stamp == self.seen {
            return Ok(());
        }
        self.seen = stamp;
        store.reload().map(drop)
    }
}

fn stamp(file: &PathBuf) -> Option<Stamp> {
    let about = std::fs::metadata(file).ok()?;
    Some((about.len(), about.modified().ok()?))
}
