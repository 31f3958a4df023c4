//! Blackboards: the latest value of each key, written by one program and read by many.
//!
//! A blackboard is a segment as that of a channel. Its type is stated as `blackboard`. The writer
//! holds the sender's role, and the readers share the receiver's. Behind the words lies a directory
//! of the keys, which does not change after the segment was made, and a cell for each key.

mod cell;
mod directory;
mod raw;
mod reader;
mod writer;

pub use cell::Contended;
pub use reader::{BoardReader, ReadEntry, Reading, WriterState};
pub use writer::{Blackboard, BoardWriter, WriteEntry};

use crate::files::LockFile;
use crate::look;
use crate::memory::Memory;
use crate::name::Name;
use crate::session::End;
use crate::{IpcError, Role};
use directory::Directory;
use raw::Raw;
pub(crate) use raw::set;
use std::sync::atomic::Ordering::Release;

/// What its segment states as its type.
pub(crate) const TYPE: &str = "blackboard";

/// A blackboard that this program has open. Closed when dropped.
#[derive(Debug)]
struct Board {
    name: Name,
    role: Role,
    lock: LockFile,
    memory: Memory,
}

impl Board {
    fn bad_key(&self, key: &str, why: &'static str) -> IpcError {
        bad_key(&self.name, key, why)
    }
}

/// The keys, and their newest values. The directory is whole.
pub(crate) fn keys(memory: &Memory) -> Vec<look::Key> {
    let entries = Directory::read(memory).entries.into_iter();
    let keys = entries.filter_map(|entry| {
        let (bytes, number, set) = Raw::at(memory, &entry)?.get()?;
        Some(look::Key {
            key: entry.key,
            value: entry.info,
            number,
            set,
            bytes,
        })
    });
    keys.collect()
}

fn bad_key(name: &Name, key: &str, why: &'static str) -> IpcError {
    IpcError::Key {
        name: name.text().to_owned(),
        key: key.to_owned(),
        why,
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        if self.role == Role::Sender {
            let own = self.memory.words().side(self.role);
            own.end.store(End::Closed as u32, Release);
        }
        // Without the lock the files cannot be removed, nor the role be given up in order: it ends
        // with the file.
        let Ok(set_up) = self.lock.set_up() else {
            return;
        };
        self.lock.give_up(self.role);
        set_up.remove_if_unused();
    }
}

/// Opens a board under the set-up lock. What fails leaves nothing.
fn open_locked(
    name: Name,
    role: Role,
    open: impl FnOnce(&Name, &LockFile) -> Result<Memory, IpcError>,
) -> Result<Board, IpcError> {
    let lock = LockFile::enter(&name)?;
    match open(&name, &lock) {
        Ok(memory) => {
            lock.leave();
            Ok(Board {
                name,
                role,
                lock,
                memory,
            })
        }
        Err(error) => {
            if !matches!(error, IpcError::Busy { .. }) {
                lock.give_up(role);
            }
            lock.remove_if_unused();
            lock.leave();
            Err(error)
        }
    }
}
