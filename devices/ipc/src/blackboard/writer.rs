//! The writing side.

use super::cell::Cell;
use super::directory::{Directory, KEY};
use super::reader::BoardReader;
use super::{Board, TYPE, bad_key, open_locked};
use crate::error::TypeInfo;
use crate::files::LockFile;
use crate::memory::Memory;
use crate::name::Name;
use crate::owned::Access;
use crate::session::{OPEN, namespace};
use crate::{IpcError, Role, ZeroCopySend};
use std::sync::Arc;
use std::sync::atomic::Ordering::{Relaxed, SeqCst};

type SetInitial = Box<dyn FnOnce(&Memory, usize) + Send>;

/// How a blackboard is opened: the latest value of each key, written by one program and read by
/// many, on one computer.
///
/// Writing and reading make no system call, wait for nobody and never see half a value, whatever
/// priorities the programs have and wherever one of them is killed. It synchronizes nothing: a
/// reader sees the newest value, and its age, and misses those in between. For each value, use a
/// [channel](crate::sender).
///
/// ```
/// use luna_ipc::Blackboard;
///
/// let name = format!("doc/{}/cell", std::process::id());
/// let mut board = Blackboard::new(&name)
///     .entry("speed", 0.0_f64)
///     .entry("blocks", 0_u32)
///     .write()?;
/// let mut speed = board.take::<f64>("speed")?;
/// speed.set(1.5);
///
/// // In other programs:
/// let board = Blackboard::new(&name).read()?;
/// let speed = board.entry::<f64>("speed")?;
/// let reading = speed.get()?;
/// assert_eq!((reading.value, reading.number), (1.5, 2)); // the initial one was the first
/// assert!(reading.age() < std::time::Duration::from_secs(60));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Blackboard {
    name: String,
    version: u32,
    entries: Vec<New>,
}

struct New {
    key: String,
    info: fn(u32) -> TypeInfo,
    set: SetInitial,
}

luna_platform::debug_fields!(New, |new| key: new.key);

impl Blackboard {
    /// The blackboard of this name, which is none of a channel. For the name the same holds as for
    /// [that of a channel](crate::Endpoint::new).
    pub fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            version: 0,
            entries: Vec::new(),
        }
    }

    /// As for [a channel](crate::Endpoint::layout_version), for the types of all values.
    #[must_use]
    pub fn layout_version(mut self, version: u32) -> Self {
        self.version = version;
        self
    }

    /// Adds a key of at most 64 bytes, and its first value. For the writer: readers find the keys
    /// in the blackboard.
    #[must_use]
    pub fn entry<T: ZeroCopySend + Send + 'static>(mut self, key: &str, initial: T) -> Self {
        self.entries.push(New {
            key: key.to_owned(),
            info: TypeInfo::of::<T>,
            set: Box::new(|memory, offset| {
                // SAFETY: the directory has planned this cell for this type. This program is the
                // writer, and has given the entry to nobody yet.
                unsafe { Cell::<T>::at(memory, offset).set(initial) };
            }),
        });
        self
    }

    /// Opens it to write, and sets the first values. There is one writer at a time. If readers have
    /// it open still, of a writer before, they see the new one's values; it has the same keys then,
    /// with the same types.
    ///
    /// Not for the real-time path: as [`Endpoint::sender`](crate::Endpoint::sender).
    ///
    /// # Errors
    ///
    /// As there, and [`IpcError::Key`]: a key is empty, too long or there twice, or readers have
    /// the blackboard open with other keys or types.
    pub fn write(self) -> Result<BoardWriter, IpcError> {
        let name = Name::new(&self.name)?;
        for (index, New { key, .. }) in self.entries.iter().enumerate() {
            let before = &self.entries[..index];
            let why = match key.len() {
                0 => "is empty",
                length if length > KEY => "is longer than 64 bytes",
                _ if before.iter().any(|other| other.key == *key) => "is there twice",
                _ => continue,
            };
            return Err(bad_key(&name, key, why));
        }
        let keys = self.entries.iter();
        let keys = keys.map(|new| (new.key.clone(), (new.info)(self.version)));
        let planned = Directory::plan(keys);
        let (directory, size) = planned.ok_or_else(|| IpcError::Size {
            name: name.text().to_owned(),
            value: Box::new(TypeInfo::new(TYPE, usize::MAX, 1, 0)),
        })?;
        let initial = self.entries.into_iter().map(|new| new.set);
        let board = open_locked(name, Role::Sender, |name, lock| {
            let memory = open(name, lock, &directory, size)?;
            for (set, entry) in initial.zip(&directory.entries) {
                set(&memory, entry.offset);
            }
            let own = memory.words().side(Role::Sender);
            own.pid.store(std::process::id(), Relaxed);
            own.namespace.store(namespace(name)?, Relaxed);
            own.end.store(OPEN, Relaxed);
            own.epoch.fetch_add(1, SeqCst);
            Ok(memory)
        })?;
        Ok(BoardWriter {
            board: Arc::new(board),
            left: directory,
        })
    }

    /// Opens it to read, beside any number of readers. Its keys are those of the writer, so it is
    /// there first; a reader keeps it open when the writer has gone.
    ///
    /// Not for the real-time path: as [`Endpoint::sender`](crate::Endpoint::sender).
    ///
    /// # Errors
    ///
    /// As there, and [`IpcError::NoBoard`].
    ///
    /// ```
    /// let name = format!("doc/{}/nothing", std::process::id());
    /// let error = luna_ipc::Blackboard::new(&name).read().unwrap_err();
    /// assert!(matches!(error, luna_ipc::IpcError::NoBoard { .. }));
    /// ```
    pub fn read(&self) -> Result<BoardReader, IpcError> {
        BoardReader::open(Name::new(&self.name)?, self.version)
    }
}

/// The set-up lock is held.
fn open(
    name: &Name,
    lock: &LockFile,
    directory: &Directory,
    size: usize,
) -> Result<Memory, IpcError> {
    let role = Role::Sender;
    if !lock.take(role)? {
        return Err(IpcError::Busy {
            name: name.text().to_owned(),
            role,
            pid: Memory::holder(name, role),
        });
    }
    let info = TypeInfo::new(TYPE, size, 1, 0);
    if !lock.is_held(role.other())? {
        lock.remove_contents();
        let memory = Memory::create(name, &info, size)?;
        // SAFETY: the set-up lock is held, and this program has just made the segment, to be
        // written. The opening is counted after this.
        unsafe { directory.write(&memory) };
        return Ok(memory);
    }
    let memory = Memory::map(name, Access::Write)?;
    let there = memory.words().stated();
    if there.name != TYPE {
        return Err(IpcError::Type {
            name: name.text().to_owned(),
            role,
            here: Box::new(info),
            there: Box::new(there),
            pid: memory.words().side(role.other()).pid.load(Relaxed),
        });
    }
    let there = Directory::read(&memory);
    if there == *directory {
        return match memory.size() < size {
            // It was made shorter since.
            true => Err(IpcError::Protocol {
                name: name.text().to_owned(),
            }),
            false => Ok(memory),
        };
    }
    let is_other = |key: &&str| there.entry(key) != directory.entry(key);
    let keys = [directory, &there].map(|keys| keys.entries.iter().map(|entry| &*entry.key));
    let key = keys
        .into_iter()
        .flatten()
        .find(is_other)
        .unwrap_or_default();
    let why = "differs from what its readers have open: end them, or use another name";
    Err(bad_key(name, key, why))
}

/// The writing side of a [`Blackboard`]. It is closed when this and all its entries are dropped:
/// not for the real-time path.
#[derive(Debug)]
pub struct BoardWriter {
    board: Arc<Board>,
    left: Directory,
}

impl BoardWriter {
    /// What sets the value of `key`. There is one for each key, which may go to another thread.
    ///
    /// Not for the real-time path.
    ///
    /// # Errors
    ///
    /// [`IpcError::Key`]: there is no such key, or it was taken; [`IpcError::Type`].
    pub fn take<T: ZeroCopySend + Send + 'static>(
        &mut self,
        key: &str,
    ) -> Result<WriteEntry<T>, IpcError> {
        let board = &self.board;
        let index = self.left.entries.iter().position(|entry| entry.key == key);
        let index = index.ok_or_else(|| board.bad_key(key, "is not there, or was taken"))?;
        let entry = &self.left.entries[index];
        let here = TypeInfo::of::<T>(entry.info.version);
        if here != entry.info {
            return Err(IpcError::Type {
                name: board.name.text().to_owned(),
                role: board.role,
                here: Box::new(here),
                there: Box::new(entry.info.clone()),
                pid: std::process::id(),
            });
        }
        // SAFETY: the directory has planned this cell for this type, and the board is kept.
        let cell = unsafe { Cell::at(&board.memory, entry.offset) };
        let board = board.clone();
        self.left.entries.remove(index);
        Ok(WriteEntry {
            cell,
            _board: board,
        })
    }
}

/// Sets the value of a key of a [`Blackboard`].
///
/// # Invariants
///
/// It is the only one for its cell.
#[derive(Debug)]
pub struct WriteEntry<T> {
    cell: Cell<T>,
    _board: Arc<Board>,
}

impl<T: Send> WriteEntry<T> {
    /// Sets the value. Readers see the value before until it is whole.
    ///
    /// Real-time path: yes. It copies the value, reads the clock, makes no system call and waits
    /// for nobody.
    pub fn set(&mut self, value: T) {
        // SAFETY: this program has the writer's role, and by the invariants nothing else sets it.
        unsafe { self.cell.set(value) };
    }
}
