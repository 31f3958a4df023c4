//! The words in shared memory. The crate's documentation says which program writes which.

use crate::error::{TYPE_NAME, TypeInfo};
use crate::name::{FOLDER, Name};
use crate::{IpcError, Role};
use iceoryx2_bb_container::semantic_string::SemanticString;
use iceoryx2_bb_posix::creation_mode::CreationMode;
use iceoryx2_bb_posix::permission::Permission;
use iceoryx2_bb_posix::shared_memory::{AccessMode, SharedMemory, SharedMemoryBuilder};
use iceoryx2_bb_system_types::file_name::FileName;
use std::fs;
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
/// The mapping is `size` bytes long, at least `OFFSET`, aligned to a page, and stays while this is.
/// It began as zeros, and its words are changed by atomic operations alone.
#[derive(Debug)]
pub(crate) struct Memory {
    base: NonNull<u8>,
    size: usize,
    _mapping: SharedMemory,
}

// SAFETY: the mapping may be used by any thread; what it holds is atomic, or guarded by the
// numbers of the protocol.
unsafe impl Send for Memory {}
// SAFETY: `&Memory` gives words that are atomic, and pointers to values; each access by such a
// pointer states why it is exclusive.
unsafe impl Sync for Memory {}

impl Memory {
    /// Makes a segment of zeros, and states the type in it. There is none of that name.
    pub(crate) fn create(name: &Name, info: &TypeInfo, size: usize) -> Result<Self, IpcError> {
        let created = SharedMemoryBuilder::new(&file_name(name)?)
            .creation_mode(CreationMode::PurgeAndCreate)
            .size(size)
            .permission(Permission::OWNER_READ_WRITE)
            // The kernel gives zeros.
            .zero_memory(false)
            // The last side to close removes it, with the other files.
            .has_ownership(false)
            .create();
        let mapping = created.map_err(|error| refused(name, "make", error))?;
        let memory = Self::of(mapping, name)?;
        memory.words().state(info);
        Ok(memory)
    }

    /// Opens the segment of a channel that is in use, if this type is stated there.
    pub(crate) fn open(
        name: &Name,
        info: &TypeInfo,
        role: Role,
        size: usize,
    ) -> Result<Self, IpcError> {
        let memory = Self::map(name, AccessMode::ReadWrite)?;
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
        match memory.size < size {
            true => Err(IpcError::Protocol {
                name: name.text().to_owned(),
            }),
            false => Ok(memory),
        }
    }

    /// Opens a segment, whatever is in it.
    pub(crate) fn map(name: &Name, mode: AccessMode) -> Result<Self, IpcError> {
        let opened = SharedMemoryBuilder::new(&file_name(name)?).open_existing(mode);
        let mapping = opened.map_err(|error| refused(name, "open", error))?;
        let memory = Self::of(mapping, name)?;
        match memory.words().magic.load(Ordering::Acquire) {
            MAGIC => Ok(memory),
            _ => Err(IpcError::Protocol {
                name: name.text().to_owned(),
            }),
        }
    }

    /// Opens a segment to look at it; `None`: there is none, or it is being made.
    pub(crate) fn look(name: &Name) -> Result<Option<Self>, IpcError> {
        let path = format!("{FOLDER}/{}", name.memory());
        let is_there = fs::metadata(&path).is_ok_and(|found| found.len() >= OFFSET as u64);
        if !is_there {
            return Ok(None);
        }
        let opened = SharedMemoryBuilder::new(&file_name(name)?).open_existing(AccessMode::Read);
        let mapping = match opened {
            Ok(mapping) => mapping,
            // Removed since.
            Err(_) if !fs::exists(&path).unwrap_or(true) => return Ok(None),
            Err(error) => return Err(refused(name, "open", error)),
        };
        let memory = Self::of(mapping, name)?;
        match memory.words().magic.load(Ordering::Acquire) {
            MAGIC => Ok(Some(memory)),
            0 => Ok(None),
            _ => Err(IpcError::Protocol {
                name: name.text().to_owned(),
            }),
        }
    }

    fn of(mapping: SharedMemory, name: &Name) -> Result<Self, IpcError> {
        let (base, size) = (mapping.base_address(), mapping.size());
        if size < OFFSET {
            return Err(IpcError::Protocol {
                name: name.text().to_owned(),
            });
        }
        Ok(Self {
            base,
            size,
            _mapping: mapping,
        })
    }

    pub(crate) fn size(&self) -> usize {
        self.size
    }

    pub(crate) fn words(&self) -> &Words {
        // SAFETY: by the invariants the mapping is long enough, aligned, and lives as long as
        // `self`. Any bits are valid for atomic integers, which other programs change atomically.
        unsafe { self.base.cast().as_ref() }
    }

    /// The first of `size` bytes at `offset`.
    ///
    /// # Panics
    ///
    /// If they are not in the mapping, beyond the words.
    pub(crate) fn at(&self, offset: usize, size: usize) -> NonNull<u8> {
        const { assert!(size_of::<Words>() <= OFFSET) };
        let end = offset.checked_add(size);
        assert!(offset >= OFFSET && end.is_some_and(|end| end <= self.size));
        // SAFETY: by the invariants the mapping is longer.
        unsafe { self.base.add(offset) }
    }
}

fn file_name(name: &Name) -> Result<FileName, IpcError> {
    FileName::new(name.memory().as_bytes()).map_err(|_| IpcError::Name {
        name: name.text().to_owned(),
    })
}

fn refused(name: &Name, what: &'static str, error: impl std::fmt::Debug) -> IpcError {
    IpcError::Memory {
        name: name.text().to_owned(),
        what,
        why: format!("{error:?}"),
    }
}
