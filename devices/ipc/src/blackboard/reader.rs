//! The reading side.

use super::cell::{Cell, Contended};
use super::directory::Directory;
use super::raw::Raw;
use super::{Board, TYPE, open_locked};
use crate::error::TypeInfo;
use crate::memory::Memory;
use crate::name::Name;
use crate::owned::Access;
use crate::session::{OPEN, namespace, open_process};
use crate::{IpcError, Role, ZeroCopySend};
use luna::external::readable;
use luna::realtime::off_path;
use luna::{Error, Instant};
use std::io;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::{Relaxed, SeqCst};
use std::time::Duration;

/// What is known of a blackboard's writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WriterState {
    /// It has the blackboard open, as far as is known: its death is noticed by
    /// [`watch`](BoardReader::watch).
    Open,
    /// It has closed the blackboard.
    Closed,
    /// Its process has ended without that.
    Died,
}

/// The reading side of a [`Blackboard`](crate::Blackboard). It is closed when this and all its
/// entries are dropped: not for the real-time path.
#[derive(Debug, Clone)]
pub struct BoardReader {
    shared: Arc<Shared>,
    version: u32,
}

#[derive(Debug)]
struct Shared {
    board: Board,
    directory: Directory,
    /// The opening of the writer that has died.
    dead: AtomicU64,
}

impl Shared {
    fn writer(&self) -> WriterState {
        let writer = self.board.memory.words().side(Role::Sender);
        let epoch = writer.epoch.load(SeqCst);
        match writer.end.load(SeqCst) {
            OPEN if self.dead.load(Relaxed) == epoch => WriterState::Died,
            OPEN => WriterState::Open,
            _ => WriterState::Closed,
        }
    }
}

impl BoardReader {
    pub(super) fn open(name: Name, version: u32) -> Result<Self, IpcError> {
        let board = open_locked(name, Role::Receiver, |name, lock| {
            let no_board = || IpcError::NoBoard {
                name: name.text().to_owned(),
            };
            // If nobody has it open, its values are of programs that were killed.
            if !lock.is_held(Role::Sender)? && !lock.is_held(Role::Receiver)? {
                return Err(no_board());
            }
            if !lock.share(Role::Receiver)? {
                return Err(IpcError::Busy {
                    name: name.text().to_owned(),
                    role: Role::Receiver,
                    pid: 0,
                });
            }
            let memory = Memory::map(name, Access::Read)?;
            let writer = memory.words().side(Role::Sender);
            let (there, pid) = (memory.words().stated(), writer.pid.load(Relaxed));
            if there.name != TYPE {
                return Err(IpcError::Type {
                    name: name.text().to_owned(),
                    role: Role::Receiver,
                    here: Box::new(TypeInfo::new(TYPE, memory.size(), 1, 0)),
                    there: Box::new(there),
                    pid,
                });
            }
            if writer.namespace.load(Relaxed) != namespace(name)? {
                return Err(IpcError::Namespace {
                    name: name.text().to_owned(),
                    pid,
                });
            }
            Ok(memory)
        })?;
        let directory = Directory::read(&board.memory);
        let shared = Arc::new(Shared {
            board,
            directory,
            dead: AtomicU64::new(0),
        });
        Ok(Self { shared, version })
    }

    /// The keys, in the writer's order.
    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.shared
            .directory
            .entries
            .iter()
            .map(|entry| &*entry.key)
    }

    /// What reads the value of `key`. Not for the real-time path.
    ///
    /// # Errors
    ///
    /// [`IpcError::Key`]: there is no such key; [`IpcError::Type`]: the writer states another type
    /// for it.
    pub fn entry<T: ZeroCopySend + Send + 'static>(
        &self,
        key: &str,
    ) -> Result<ReadEntry<T>, IpcError> {
        let board = &self.shared.board;
        let entry = self.shared.directory.entry(key);
        let entry = entry.ok_or_else(|| board.bad_key(key, "is not there"))?;
        let here = TypeInfo::of::<T>(self.version);
        if here != entry.info {
            return Err(IpcError::Type {
                name: format!("{}: {key}", board.name.text()),
                role: board.role,
                here: Box::new(here),
                there: Box::new(entry.info.clone()),
                pid: board.memory.words().side(Role::Sender).pid.load(Relaxed),
            });
        }
        let broken = || IpcError::Protocol {
            name: board.name.text().to_owned(),
        };
        // The offset is the other program's.
        if Raw::at(&board.memory, entry).is_none() {
            return Err(broken());
        }
        // SAFETY: the writer has planned this cell for this type, it is within the memory, and the
        // board is kept.
        let cell = unsafe { Cell::at(&board.memory, entry.offset) };
        if !cell.is_set() {
            return Err(broken());
        }
        let shared = self.shared.clone();
        Ok(ReadEntry { cell, shared })
    }

    /// What is known of the writer. Real-time path: yes; no system call.
    pub fn writer(&self) -> WriterState {
        self.shared.writer()
    }

    /// Waits until the writer's process has ended, and lets all readings say so: for a process of
    /// its own, beside those that read. The next writer is another one to wait for. Returns at once
    /// if the writer has closed already; if it closes and its process lives on, that is seen by
    /// [`writer`](Self::writer) alone.
    ///
    /// Cancel-safe. Real-time path: yes, but for its beginning and its end, which allocate and make
    /// system calls.
    ///
    /// # Errors
    ///
    /// The system refuses to watch the process, or files cannot be awaited here.
    ///
    /// ```
    /// use luna_ipc::{Blackboard, WriterState};
    ///
    /// let name = format!("doc/{}/watched", std::process::id());
    /// let writer = Blackboard::new(&name).entry("speed", 0.0_f64).write()?;
    /// let reader = Blackboard::new(&name).read()?;
    /// assert_eq!(reader.writer(), WriterState::Open);
    /// drop(writer);
    /// luna::run(async move {
    ///     assert_eq!(reader.watch().await?, WriterState::Closed);
    ///     Ok(())
    /// })?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub async fn watch(&self) -> luna::Result<WriterState> {
        let board = &self.shared.board;
        let writer = board.memory.words().side(Role::Sender);
        let epoch = writer.epoch.load(SeqCst);
        let is_over = || match self.writer() {
            WriterState::Open => None,
            over => Some(over),
        };
        if let Some(over) = is_over() {
            return Ok(over);
        }
        let opened = off_path(|| {
            luna::external::prepare_files().map_err(Error::other)?;
            let process = match open_process(writer.pid.load(Relaxed)) {
                Ok(process) => Some(process),
                Err(error) if error.raw_os_error() == Some(libc::ESRCH) => None,
                Err(error) => return Err(self.failed(error).into()),
            };
            // It lives after its process was opened: so the number was its own.
            let lives = board.lock.is_held(Role::Sender)? && writer.epoch.load(SeqCst) == epoch;
            Ok::<_, Error>(process.filter(|_| lives))
        })?;
        if let Some(process) = &opened {
            let ended = readable(process).await;
            ended.map_err(|error| off_path(|| self.failed(io::Error::other(error))))?;
        }
        off_path(|| drop(opened));
        self.shared.dead.store(epoch, Relaxed);
        Ok(is_over().unwrap_or(WriterState::Died))
    }

    fn failed(&self, error: io::Error) -> IpcError {
        IpcError::system(self.shared.board.name.text(), "watch its writer", error)
    }
}

/// Reads the value of a key of a [`Blackboard`](crate::Blackboard).
#[derive(Debug, Clone)]
pub struct ReadEntry<T> {
    cell: Cell<T>,
    shared: Arc<Shared>,
}

impl<T: Send> ReadEntry<T> {
    /// The newest value.
    ///
    /// Real-time path: yes. It copies the value once, and at most seven times more, makes no system
    /// call and waits for nobody.
    ///
    /// # Errors
    ///
    /// [`Contended`].
    pub fn get(&self) -> Result<Reading<T>, Contended> {
        // SAFETY: that it is set was seen when this was made, and stays so.
        let (value, number, set) = unsafe { self.cell.get() }?;
        Ok(Reading {
            value,
            number,
            set,
            writer: self.shared.writer(),
        })
    }
}

/// A value that was read.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Reading<T> {
    /// The value.
    pub value: T,
    /// Its number: 1 for the first value of the key, and one more for each that was set since.
    pub number: u64,
    /// When it was set, on the monotonic clock, which all programs of a computer share.
    pub set: Instant,
    /// What is known of its writer.
    pub writer: WriterState,
}

impl<T> Reading<T> {
    /// How long ago it was set, on the machine's clock. Reads the clock.
    pub fn age(&self) -> Duration {
        Duration::from_nanos(Instant::now_real().nanos_since(self.set))
    }
}
