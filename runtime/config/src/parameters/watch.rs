//! The file's changes, which a thread of its own looks for: a file that does not answer holds up
//! nothing else.

use super::error::SetError;
use super::sources::{self, Given};
use super::store::Store;
use luna_machine::signals;
use luna_platform::thread::{Attributes, Policy, SpawnError, spawn};
use std::convert::Infallible;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, SystemTime};

/// Looks now and then whether the file has changed, as long as it is there.
pub struct FileWatch {
    /// The thread ends when it is dropped, or when the file answers.
    _ends: mpsc::Sender<()>,
}

/// The thread's.
struct Looks {
    store: Arc<Store>,
    file: PathBuf,
    changes: Changes,
}

/// What changes of a file that is written, or replaced by another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stamp {
    length: u64,
    modified: SystemTime,
    /// Its number in the file system, where files have one.
    file: u64,
}

/// When the file is to be read, by its stamps alone: a program that writes it may have written a
/// part of it, or nothing yet.
#[derive(Debug)]
struct Changes {
    /// The stamp of what was read last.
    read: Option<Stamp>,
    /// At the last look; none if there was no file.
    last: Option<Stamp>,
}

impl Changes {
    /// Whether what a look has found is to be read: it is not what was read last, and has not
    /// changed since the look before. One without a byte was not written yet.
    fn are_to_be_read(&mut self, found: Option<Stamp>) -> bool {
        let has_settled = std::mem::replace(&mut self.last, found) == found;
        has_settled && found.is_some_and(|found| found.length > 0) && found != self.read
    }

    /// It was read. Whether that counts: it has not changed meanwhile, else the next looks go on
    /// from `now`.
    fn have_been_read(&mut self, now: Option<Stamp>) -> bool {
        let is_whole = self.last == now;
        if is_whole {
            self.read = now;
        }
        self.last = now;
        is_whole
    }
}

impl FileWatch {
    /// None if there is no file, or no thread to be had. That, and what is wrong with a file, goes
    /// to `report`.
    pub fn start(
        store: &Arc<Store>,
        every: Duration,
        report: fn(fmt::Arguments<'_>),
    ) -> Option<Self> {
        let read = store.stamp();
        let mut looks = Looks {
            file: store.file()?,
            store: store.clone(),
            changes: Changes { read, last: read },
        };
        let (ends, ended) = mpsc::channel();
        let started = spawn(
            Attributes::framework("luna-parameters", Policy::Other),
            |_| {
                signals::refuse_write_signals_here();
                Ok(())
            },
            move |()| {
                while ended.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
                    let looked = looks.look();
                    // Once the system ends nothing counts any more.
                    if let Err(error) = looked
                        && ended.try_recv() != Err(mpsc::TryRecvError::Disconnected)
                    {
                        report(format_args!("luna: {error}"));
                    }
                }
            },
        );
        if let Err(error) = started.map_err(|error: SpawnError<Infallible>| error.to_string()) {
            report(format_args!(
                "luna: changes of the parameters' file are not seen: {error}"
            ));
            return None;
        }
        Some(Self { _ends: ends })
    }
}

impl Looks {
    /// Reads the file if it is another. An error is for once: until the file changes again.
    fn look(&mut self) -> Result<(), SetError> {
        let Self {
            store,
            file,
            changes,
        } = self;
        if !changes.are_to_be_read(stamp(file)) {
            return Ok(());
        }
        store.reload_if(|| changes.have_been_read(stamp(file)))?;
        Ok(())
    }
}

/// The values of a file, and which file it was.
#[derive(Debug)]
pub struct FileValues {
    pub(super) values: Vec<Given>,
    pub(super) stamp: Option<Stamp>,
}

/// Reads a file of parameters.
///
/// # Errors
///
/// [`SetError::File`].
pub fn read(file: &Path) -> Result<FileValues, SetError> {
    let stamp = stamp(file);
    let values = sources::read(file)?;
    Ok(FileValues { values, stamp })
}

luna_platform::debug_fields!(FileWatch);

/// None if there is no such file, or its metadata cannot be read.
fn stamp(file: &Path) -> Option<Stamp> {
    let about = std::fs::metadata(file).ok()?;
    #[cfg(unix)]
    let number = std::os::unix::fs::MetadataExt::ino(&about);
    #[cfg(not(unix))]
    let number = 0;
    Some(Stamp {
        length: about.len(),
        modified: about.modified().ok()?,
        file: number,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(length: u64, second: u64) -> Option<Stamp> {
        Some(Stamp {
            length,
            modified: SystemTime::UNIX_EPOCH + Duration::from_secs(second),
            file: 7,
        })
    }

    fn begun() -> Changes {
        let read = of(10, 1);
        Changes { read, last: read }
    }

    #[test]
    fn what_was_read_is_not_read_again() {
        let mut changes = begun();
        assert!(!changes.are_to_be_read(of(10, 1)));
        assert!(!changes.are_to_be_read(of(10, 1)));
        // It was away for a while.
        for found in [None, None, of(10, 1), of(10, 1)] {
            assert!(!changes.are_to_be_read(found));
        }
    }

    #[test]
    fn a_file_that_is_being_written_is_not_read() {
        let mut changes = begun();
        for found in [of(0, 2), of(0, 2), of(0, 2), of(4, 3), of(8, 3), of(12, 4)] {
            assert!(!changes.are_to_be_read(found), "{found:?}");
        }
        assert!(changes.are_to_be_read(of(12, 4)));
        assert!(changes.have_been_read(of(12, 4)));
        assert!(!changes.are_to_be_read(of(12, 4)));
    }

    #[test]
    fn what_changed_while_it_was_read_does_not_count() {
        let mut changes = begun();
        assert!(!changes.are_to_be_read(of(12, 2)));
        assert!(changes.are_to_be_read(of(12, 2)));
        assert!(!changes.have_been_read(of(0, 3)));
        assert!(!changes.are_to_be_read(of(0, 3)));
        assert!(!changes.are_to_be_read(of(12, 3)));
        assert!(changes.are_to_be_read(of(12, 3)));
        assert!(!changes.have_been_read(None));
        // Back as it was: it was never read.
        assert!(!changes.are_to_be_read(of(12, 3)));
        assert!(changes.are_to_be_read(of(12, 3)));
        assert!(changes.have_been_read(of(12, 3)));
    }

    #[test]
    fn one_of_the_same_length_and_time_is_another_by_its_number() {
        let mut changes = begun();
        let other = of(10, 1).map(|stamp| Stamp { file: 8, ..stamp });
        assert!(!changes.are_to_be_read(other));
        assert!(changes.are_to_be_read(other));
    }

    #[test]
    fn a_start_without_a_file_reads_one_that_comes() {
        let mut changes = Changes {
            read: None,
            last: None,
        };
        assert!(!changes.are_to_be_read(None));
        assert!(!changes.are_to_be_read(of(3, 1)));
        assert!(changes.are_to_be_read(of(3, 1)));
    }
}
