//! The value of one key.
//!
//! The writer writes value n into slot n modulo `SLOTS`, and then stores `latest` = n. So the
//! newest value is never changed, also if the writer is killed while it writes the next one. A
//! reader copies the slot of `latest`, and looks at `latest` again: the slot was changed meanwhile
//! only if the writer has begun value n + `SLOTS`, so if `latest` is n + `SLOTS` - 1 or more.

use crate::copy;
use crate::memory::Memory;
use luna_platform::clock::Instant;
use std::marker::PhantomData;
use std::mem::MaybeUninit;
use std::ptr::NonNull;
use std::sync::atomic::Ordering::{Acquire, Relaxed, Release};
use std::sync::atomic::{AtomicU64, fence};

/// A copy is spoilt when the writer sets the value three times meanwhile.
pub(super) const SLOTS: u64 = 4;
/// How often a reader copies.
pub(super) const TRIES: u32 = 8;
/// The bytes before the slots.
pub(super) const HEAD: usize = 64;

/// The writer has set the value three times or more during each of eight copies: the reader was
/// kept from its core, or the writer sets without a pause. The value before is as good as any.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the writer has set the value anew during each of {TRIES} copies of it")]
pub struct Contended;

/// How a cell lies in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    /// All of it, in bytes.
    pub(super) length: usize,
    pub(super) align: usize,
    /// Where the first slot begins: its time, with the value `align` bytes behind it.
    slots: usize,
    /// From slot to slot.
    stride: usize,
}

impl Layout {
    /// Of a value; `None`: it is longer than addresses reach. The size may be another program's.
    pub(super) const fn of(size: usize, align: usize) -> Option<Self> {
        let align = if align > HEAD { align } else { HEAD };
        let Some(slots) = HEAD.checked_next_multiple_of(align) else {
            return None;
        };
        let Some(stride) = align.checked_add(size) else {
            return None;
        };
        let Some(stride) = stride.checked_next_multiple_of(align) else {
            return None;
        };
        let Some(length) = stride.checked_mul(SLOTS as usize) else {
            return None;
        };
        let Some(length) = length.checked_add(slots) else {
            return None;
        };
        Some(Self {
            length,
            align,
            slots,
            stride,
        })
    }

    /// Where the slot of a value is, within the cell.
    pub(super) fn slot(&self, number: u64) -> usize {
        // No larger than `length`, which was found.
        let slot = (number % SLOTS) as usize;
        self.slots.saturating_add(self.stride.saturating_mul(slot))
    }
}

/// The cell of a value of type `T`.
///
/// # Invariants
///
/// `base` is aligned as `LAYOUT` says, and so long, in a mapping that lives while this is used. One
/// program writes there, by one `set` at a time; all of it is accessed atomically, the values by
/// [`copy`].
#[derive(Debug)]
pub(super) struct Cell<T> {
    base: NonNull<u8>,
    _value: PhantomData<T>,
}

impl<T> Clone for Cell<T> {
    fn clone(&self) -> Self {
        Self { ..*self }
    }
}

// SAFETY: a cell is a place in shared memory, which any thread may use; what it moves between them
// are values.
unsafe impl<T: Send> Send for Cell<T> {}
// SAFETY: `&Cell` gives `get`, which copies values out, and `set`, the caller of which promises
// that no other thread sets the cell. All else is atomic.
unsafe impl<T: Send> Sync for Cell<T> {}

impl<T> Cell<T> {
    const LAYOUT: Layout = match Layout::of(size_of::<T>(), align_of::<T>()) {
        Some(layout) => layout,
        None => panic!("four values of this type are longer than addresses reach"),
    };

    /// # Safety
    ///
    /// A cell for this type is at `offset`, and the mapping outlives the result.
    ///
    /// # Panics
    ///
    /// If it is not in the mapping.
    pub(super) unsafe fn at(memory: &Memory, offset: usize) -> Self {
        const {
            assert!(
                !std::mem::needs_drop::<T>(),
                "a value that is to be dropped is no plain data: it would be dropped in two programs"
            );
            assert!(
                align_of::<T>() <= 4096,
                "shared memory is aligned to pages of 4096 bytes"
            );
        }
        let Layout { length, align, .. } = Self::LAYOUT;
        assert!(offset.is_multiple_of(align));
        Self {
            base: memory.at(offset, length),
            _value: PhantomData,
        }
    }

    fn latest(&self) -> &AtomicU64 {
        // SAFETY: by the invariants it is there, aligned, and accessed atomically.
        unsafe { self.base.cast().as_ref() }
    }

    /// The time and the value of a slot.
    fn slot(&self, number: u64) -> (&AtomicU64, NonNull<u8>) {
        let at = Self::LAYOUT.slot(number);
        // SAFETY: by the invariants all slots are in the cell. The value is `align` bytes behind
        // the slot's begin, which is aligned to that; the time is before it.
        unsafe {
            let slot = self.base.add(at);
            (slot.cast().as_ref(), slot.add(Self::LAYOUT.align))
        }
    }

    /// Sets the value. Wait-free.
    ///
    /// # Safety
    ///
    /// This program is the writer, and no other thread sets the cell.
    pub(super) unsafe fn set(&self, value: T) {
        let number = self.latest().load(Relaxed).wrapping_add(1);
        let (time, place) = self.slot(number);
        // A reader that sees any of the following sees the `latest` before it too.
        fence(Release);
        time.store(Instant::now_real().as_nanos(), Relaxed);
        // SAFETY: by the invariants the place is there, aligned, and accessed by copies alone. A
        // reader may copy it meanwhile: it takes that for a value only after it has seen that
        // nobody wrote.
        unsafe { copy::store((&raw const value).cast(), place, size_of::<T>()) };
        self.latest().store(number, Release);
    }

    /// Whether a value was ever set.
    pub(super) fn is_set(&self) -> bool {
        self.latest().load(Acquire) > 0
    }

    /// The newest value, its number, and when it was set. Wait-free.
    ///
    /// # Safety
    ///
    /// The cell is set.
    pub(super) unsafe fn get(&self) -> Result<(T, u64, Instant), Contended> {
        for _ in 0..TRIES {
            let number = self.latest().load(Acquire);
            let (time, place) = self.slot(number);
            let time = time.load(Relaxed);
            let mut value = MaybeUninit::<T>::uninit();
            // SAFETY: by the invariants the place is there, aligned, and accessed by copies alone.
            // The writer may write it meanwhile: then the copy is discarded.
            unsafe { copy::load(place, value.as_mut_ptr().cast(), size_of::<T>()) };
            fence(Acquire);
            if self.latest().load(Relaxed).wrapping_sub(number) < SLOTS - 1 {
                // SAFETY: value `number` was written there whole before `latest` said so, and the
                // next one for this slot was not begun. Both programs state one type. It has no
                // drop, so a copy is harmless.
                let value = unsafe { value.assume_init() };
                return Ok((value, number, Instant::from_nanos(time)));
            }
        }
        Err(Contended)
    }
}
