//! The words in shared memory. The crate's documentation says which program writes which.

use crate::error::{TYPE_NAME, TypeInfo};
use crate::name::Name;
use crate::owned::{self, Access, Kind};
use crate::segment::Segment;
use crate::{IpcError, Role};
use std::fs::File;
use std::io;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicI32, AtomicU8, AtomicU32, AtomicU64, Ordering};

/// Where the first value is: aligned for all types that are allowed.
pub(crate) const OFFSET: usize = 4096;

/// What the first word of a segment is: "luna-ipc", the last byte the version of the protocol.
const MAGIC: u64 = u64::from_be_bytes(*b"lunaipc\x02");

/// The words of one role, on cache lines of their own.
#[repr(C, align(128))]
pub(crate) struct Side {
    pub(crate) epoch: AtomicU64,
    pub(crate) bound: AtomicU64,
    /// Of the process, and of its namespace of process numbers.
    pub(crate) pid: AtomicU32,
    pub(crate) end: AtomicU32,
    pub(crate) namespace: AtomicU64,
    pub(crate) asleep: AtomicU32,
    /// The sender's `published`, the receiver's `taken`.
    pub(crate) number: AtomicU64,
    /// Of a link that serves calls: its thread, and that thread's own policy and priority.
    pub(crate) thread: AtomicI32,
    pub(crate) policy: AtomicI32,
    pub(crate) priority: AtomicI32,
    /// Of a link that calls: whether it has raised the partner's thread.
    pub(crate) raised: AtomicU32,
}

/// The head of a segment. The value follows.
#[repr(C, align(128))]
pub(crate) struct Words {
    magic: AtomicU64,
    size: AtomicU64,
    align: AtomicU64,
    version: AtomicU32,
    name_length: AtomicU32,
    name: [AtomicU8; TYPE_NAME],
    pub(crate) start: AtomicU64,
    sides: [Side; 2],
}

impl Words {
    pub(crate) fn side(&self, role: Role) -> &Side {
        match role {
            Role::Sender => &self.sides[0],
            Role::Receiver => &self.sides[1],
        }
    }

    pub(crate) fn published(&self) -> u64 {
        self.side(Role::Sender).number.load(Ordering::Acquire)
    }

    pub(crate) fn taken(&self) -> u64 {
        self.side(Role::Receiver).number.load(Ordering::Acquire)
    }

    fn state(&self, info: &TypeInfo) {
        self.size.store(info.size, Ordering::Relaxed);
        self.align.store(info.align, Ordering::Relaxed);
        self.version.store(info.version, Ordering::Relaxed);
        for (word, byte) in self.name.iter().zip(info.name.bytes()) {
            word.store(byte, Ordering::Relaxed);
        }
        let length = info.name.len().min(TYPE_NAME) as u32;
        self.name_length.store(length, Ordering::Relaxed);
        self.magic.store(MAGIC, Ordering::Release);
    }

    /// What the segment's maker has stated.
    pub(crate) fn stated(&self) -> TypeInfo {
        let length = self.name_length.load(Ordering::Relaxed) as usize;
        let bytes = self.name.iter().take(length);
        let bytes: Vec<u8> = bytes.map(|word| word.load(Ordering::Relaxed)).collect();
        TypeInfo {
            name: String::from_utf8_lossy(&bytes).into_owned(),
            size: self.size.load(Ordering::Relaxed),
            align: self.align.load(Ordering::Relaxed),
            version: self.version.load(Ordering::Relaxed),
        }
    }
}

/// A mapped segment.
///
/// # Invariants
///
/// The mapping is at least `OFFSET` bytes long, aligned to a page, and stays while this is. It began
/// as zeros, and its words are changed by atomic operations alone.
#[derive(Debug)]
pub(crate) struct Memory(Segment);

impl Memory {
    /// Makes a segment of zeros, and states the type in it. There is none of that name.
    pub(crate) fn create(name: &Name, info: &TypeInfo, size: usize) -> Result<Self, IpcError> {
        let path = name.memory();
        let what = "make its shared memory";
        let made = owned::create(name, &path, what)?;
        let file = made.ok_or_else(|| {
            let error = io::ErrorKind::AlreadyExists.into();
            owned::refused(name, &path, Kind::File, what, error)
        })?;
        // The kernel gives zeros.
        let memory = Self(Segment::reserve(name, &file, size.max(OFFSET))?);
        memory.words().state(info);
        Ok(memory)
    }

    /// Opens the segment of a channel that is in use, if this type is stated there. Of a longer one
    /// no more is taken than this type needs.
    pub(crate) fn open(
        name: &Name,
        info: &TypeInfo,
        role: Role,
        size: usize,
    ) -> Result<Self, IpcError> {
        let memory = Self::of(name, Access::Write, size)?;
        let there = memory.words().stated();
        if there != *info {
            return Err(IpcError::Type {
                name: name.text().to_owned(),
                role,
                here: Box::new(info.clone()),
                there: Box::new(there),
                pid: memory
                    .words()
                    .side(role.other())
                    .pid
                    .load(Ordering::Relaxed),
            });
        }
        match memory.size() < size {
            true => Err(broken(name)),
            false => Ok(memory),
        }
    }

    /// Opens a segment, whatever is in it.
    pub(crate) fn map(name: &Name, access: Access) -> Result<Self, IpcError> {
        Self::of(name, access, usize::MAX)
    }

    /// The process that has said to have the role; 0: none has said so.
    pub(crate) fn holder(name: &Name, role: Role) -> u32 {
        let memory = Self::of(name, Access::Read, OFFSET);
        memory.map_or(0, |memory| {
            memory.words().side(role).pid.load(Ordering::Relaxed)
        })
    }

    /// Opens a segment to look at it; `None`: there is none, or it is being made.
    pub(crate) fn look(name: &Name) -> Result<Option<Self>, IpcError> {
        let Some((file, size)) = open(name, Access::Read)? else {
            return Ok(None);
        };
        if size < OFFSET {
            return Ok(None);
        }
        let memory = Self(Segment::look(name, &file, size)?);
        match memory.words().magic.load(Ordering::Acquire) {
            MAGIC => Ok(Some(memory)),
            0 => Ok(None),
            _ => Err(broken(name)),
        }
    }

    /// Maps `most` bytes at most.
    fn of(name: &Name, access: Access, most: usize) -> Result<Self, IpcError> {
        let gone = || IpcError::system(name.text(), OPEN, io::ErrorKind::NotFound);
        let (file, size) = open(name, access)?.ok_or_else(gone)?;
        let size = size.min(most.max(OFFSET));
        if size < OFFSET {
            return Err(broken(name));
        }
        let memory = Self(match access {
            Access::Read => Segment::read(name, &file, size)?,
            Access::Write => Segment::reserve(name, &file, size)?,
        });
        match memory.words().magic.load(Ordering::Acquire) {
            MAGIC => Ok(memory),
            _ => Err(broken(name)),
        }
    }

    /// Whether the system keeps it in memory, also if it swaps.
    pub(crate) fn is_locked(&self) -> bool {
        self.0.is_locked()
    }

    pub(crate) fn size(&self) -> usize {
        self.0.size()
    }

    pub(crate) fn words(&self) -> &Words {
        const { assert!(size_of::<Words>() <= OFFSET) };
        // SAFETY: by the invariants the mapping is long enough, aligned, and lives as long as
        // `self`. Any bits are valid for atomic integers, which other programs change atomically.
        unsafe { &*self.0.base().cast() }
    }

    /// The first of `size` bytes at `offset`.
    ///
    /// # Panics
    ///
    /// If they are not in the mapping, beyond the words.
    pub(crate) fn at(&self, offset: usize, size: usize) -> NonNull<u8> {
        let end = offset.checked_add(size);
        assert!(offset >= OFFSET && end.is_some_and(|end| end <= self.size()));
        // SAFETY: the mapping is longer, as was just seen, and no mapping begins at address 0.
        unsafe { NonNull::new_unchecked(self.0.base().add(offset)) }
    }
}

const OPEN: &str = "open its shared memory";

/// The file, and its length; `None`: there is none.
fn open(name: &Name, access: Access) -> Result<Option<(File, usize)>, IpcError> {
    let opened = owned::open(name, &name.memory(), (Kind::File, access), OPEN)?;
    let Some(file) = opened else {
        return Ok(None);
    };
    let found = file.metadata();
    let found = found.map_err(|error| IpcError::system(name.text(), OPEN, error))?;
    Ok(Some((file, usize::try_from(found.len()).unwrap_or(0))))
}

fn broken(name: &Name) -> IpcError {
    IpcError::Protocol {
        name: name.text().to_owned(),
    }
}
