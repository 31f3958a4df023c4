//! The value of a key whose type is known at run time alone: as bytes, by the rules of `cell`.

use super::cell::{Layout, SLOTS, TRIES};
use super::directory::{Directory, Entry};
use super::{TYPE, bad_key, open_locked};
use crate::any::AnyValue;
use crate::copy;
use crate::error::TypeInfo;
use crate::memory::{Memory, OFFSET};
use crate::name::Name;
use crate::owned::Access;
use crate::session::{OPEN, namespace};
use crate::{IpcError, Role};
use luna_platform::clock::Instant;
use std::marker::PhantomData;
use std::ptr::NonNull;
use std::sync::atomic::Ordering::{Acquire, Relaxed, Release, SeqCst};
use std::sync::atomic::{AtomicU64, fence};

/// A cell, as bytes.
///
/// # Invariants
///
/// `base` is aligned to the cell's layout, and so long, in the mapping. All of the cell is accessed
/// atomically, the value by [`copy`].
pub(super) struct Raw<'m> {
    base: NonNull<u8>,
    size: usize,
    layout: Layout,
    _memory: PhantomData<&'m Memory>,
}

impl<'m> Raw<'m> {
    /// The cell of an entry; `None` if there is no room for it, so that no writer has planned it.
    pub(super) fn at(memory: &'m Memory, entry: &Entry) -> Option<Self> {
        let size = usize::try_from(entry.info.size).ok()?;
        let align = usize::try_from(entry.info.align).ok()?;
        let is_layout = align.is_power_of_two() && align <= OFFSET && size <= memory.size();
        if !is_layout {
            return None;
        }
        let layout = Layout::of(size, align)?;
        let end = entry.offset.checked_add(layout.length)?;
        let is_there = entry.offset >= OFFSET
            && entry.offset.is_multiple_of(layout.align)
            && end <= memory.size();
        is_there.then(|| Self {
            base: memory.at(entry.offset, layout.length),
            size,
            layout,
            _memory: PhantomData,
        })
    }

    fn latest(&self) -> &AtomicU64 {
        // SAFETY: by the invariants it is there, aligned, and accessed atomically.
        unsafe { self.base.cast().as_ref() }
    }

    /// The time and the value of a slot: as in `cell`.
    fn slot(&self, number: u64) -> (&AtomicU64, NonNull<u8>) {
        let at = self.layout.slot(number);
        // SAFETY: by the invariants all slots are in the cell, and the time is aligned.
        unsafe {
            let slot = self.base.add(at);
            (slot.cast().as_ref(), slot.add(self.layout.align))
        }
    }

    /// The newest value, its number, and when it was set; without bytes if the writer has set it
    /// anew during each copy. `None` if it was never set.
    pub(super) fn get(&self) -> Option<(Vec<u8>, u64, Instant)> {
        let mut number = 0;
        for _ in 0..TRIES {
            number = self.latest().load(Acquire);
            if number == 0 {
                return None;
            }
            let (time, place) = self.slot(number);
            let time = time.load(Relaxed);
            let bytes = self.copy(place);
            fence(Acquire);
            if self.latest().load(Relaxed).wrapping_sub(number) < SLOTS - 1 {
                return Some((bytes, number, Instant::from_nanos(time)));
            }
        }
        let (time, _) = self.slot(number);
        Some((Vec::new(), number, Instant::from_nanos(time.load(Relaxed))))
    }

    /// The bytes of a slot's value, also while they are written: then they are to be thrown away.
    fn copy(&self, place: NonNull<u8>) -> Vec<u8> {
        // SAFETY: by the invariants the bytes are there, aligned to 64 of them or more, and accessed
        // by copies alone. In shared memory each has a value.
        unsafe { copy::bytes(place, self.size) }
    }

    /// Sets the value, and returns its number.
    ///
    /// # Safety
    ///
    /// The mapping may be written, this program is the writer, and no other thread sets the cell.
    /// The bytes are as many as the value has.
    unsafe fn set(&self, bytes: &[u8]) -> u64 {
        let number = self.latest().load(Relaxed).wrapping_add(1);
        let (time, place) = self.slot(number);
        // A reader that sees any of the following sees the `latest` before it too.
        fence(Release);
        time.store(Instant::now_real().as_nanos(), Relaxed);
        // SAFETY: by the invariants the place is there, aligned, and accessed by copies alone. The
        // caller promises that it may be written, and that the bytes are as many as the value has.
        // A reader that copies meanwhile discards the copy.
        unsafe { copy::store(bytes.as_ptr(), place, bytes.len()) };
        self.latest().store(number, Release);
        number
    }
}

/// Sets the value of one key, as the writer of the blackboard for so long. Returns its number.
pub(crate) fn set(name: &str, key: &str, value: &AnyValue) -> Result<u64, IpcError> {
    let board = open_locked(Name::new(name)?, Role::Sender, |name, lock| {
        if !lock.take(Role::Sender)? {
            return Err(IpcError::Busy {
                name: name.text().to_owned(),
                role: Role::Sender,
                pid: Memory::holder(name, Role::Sender),
            });
        }
        // Without readers it ends with its writer: there would be nobody to see the value.
        if !lock.is_held(Role::Receiver)? {
            return Err(IpcError::NoBoard {
                name: name.text().to_owned(),
            });
        }
        let memory = Memory::map(name, Access::Write)?;
        let own = memory.words().side(Role::Sender);
        let there = memory.words().stated();
        if there.name != TYPE || own.epoch.load(SeqCst) == 0 {
            return Err(IpcError::Type {
                name: name.text().to_owned(),
                role: Role::Sender,
                here: Box::new(TypeInfo::new(TYPE, memory.size(), 1, 0)),
                there: Box::new(there),
                pid: memory.words().side(Role::Receiver).pid.load(Relaxed),
            });
        }
        // Before this program shows as the writer.
        check(name, &memory, key, value)?;
        own.pid.store(std::process::id(), Relaxed);
        own.namespace.store(namespace(name)?, Relaxed);
        own.end.store(OPEN, Relaxed);
        own.epoch.fetch_add(1, SeqCst);
        Ok(memory)
    })?;
    let entry = check(&board.name, &board.memory, key, value)?;
    let raw = Raw::at(&board.memory, &entry);
    let raw = raw.ok_or_else(|| IpcError::Protocol {
        name: name.to_owned(),
    })?;
    // SAFETY: this program has the writer's role, in this call alone, and the value was made of
    // the type that the key has.
    Ok(unsafe { raw.set(value.bytes()) })
}

/// The entry of the key, if the value is of its type.
fn check(name: &Name, memory: &Memory, key: &str, value: &AnyValue) -> Result<Entry, IpcError> {
    let entries = Directory::read(memory).entries.into_iter();
    let entry = entries.into_iter().find(|entry| entry.key == key);
    let entry = entry.ok_or_else(|| bad_key(name, key, "is not there"))?;
    let here = value.of().info();
    if *here == entry.info && value.bytes().len() as u64 == entry.info.size {
        return Ok(entry);
    }
    Err(IpcError::Type {
        name: format!("{}: {key}", name.text()),
        role: Role::Sender,
        here: Box::new(here.clone()),
        there: Box::new(entry.info),
        pid: memory.words().side(Role::Sender).pid.load(Relaxed),
    })
}
