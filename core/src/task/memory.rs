//! The memory of tasks: at a multiple of [`Process::ALIGN`], from the allocator's fast path.
//!
//! An allocator serves an alignment of more than two words by a slow path, which splits what it
//! finds: several times as expensive as all else that a spawn allocates. So a task requests half of
//! the alignment that it needs, and that much more memory.

use crate::current::Process;
use alloc::alloc::{Layout, alloc, dealloc, handle_alloc_error};
use core::ptr::NonNull;

/// What every allocator gives without a detour.
const PLAIN: usize = Process::ALIGN / 2;

/// What is allocated for a `T`, which has the alignment that is returned.
fn layout<T>() -> (Layout, usize) {
    let value = Layout::new::<T>();
    let align = value.align().max(Process::ALIGN);
    let (size, asked) = if align > Process::ALIGN {
        (value.size(), align)
    } else {
        (value.size() + PLAIN, PLAIN)
    };
    match Layout::from_size_align(size, asked) {
        Ok(layout) => (layout, align),
        Err(_) => handle_alloc_error(value),
    }
}

/// Room for a `T`, and how many bytes in front of it belong to it.
pub(super) fn allocate<T>() -> (NonNull<T>, u8) {
    let (layout, align) = layout::<T>();
    // SAFETY: a task is never empty.
    let Some(start) = NonNull::new(unsafe { alloc(layout) }) else {
        handle_alloc_error(layout)
    };
    let skipped = start.addr().get().wrapping_neg() % align;
    // SAFETY: either nothing is skipped, or there is as much more than a `T` takes: `start` is
    // aligned to half of the needed alignment.
    (unsafe { start.add(skipped) }.cast(), skipped as u8)
}

/// Frees the room, in front of which `skipped` bytes belong to it.
///
/// # Safety
///
/// Both are of one call of [`allocate`] for this type, and nothing uses the room any more.
pub(super) unsafe fn free<T>(room: NonNull<T>, skipped: u8) {
    // SAFETY: the caller promises that `allocate` gave both for this type: it skipped so many bytes
    // of memory with this layout. Nothing uses the room any more.
    unsafe {
        dealloc(
            room.cast::<u8>().sub(usize::from(skipped)).as_ptr(),
            layout::<T>().0,
        );
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[repr(align(128))]
    struct Wide {
        _bytes: [u8; 256],
    }

    fn fits<T>(align: usize) {
        let rooms: Vec<_> = (0..64).map(|_| allocate::<T>()).collect();
        for &(room, _) in &rooms {
            assert_eq!(room.addr().get() % align, 0);
            // SAFETY: it is room for a `T`, and owned by this call: a tool that looks at memory
            // finds what is outside.
            unsafe { room.write_bytes(0xA5, 1) };
        }
        for (room, skipped) in rooms {
            // SAFETY: it was allocated above.
            unsafe { free(room, skipped) };
        }
    }

    #[test]
    fn room_is_aligned_as_references_ask_for_whatever_the_type() {
        fits::<[u64; 1]>(Process::ALIGN);
        fits::<[u64; 37]>(Process::ALIGN);
        fits::<[u128; 9]>(Process::ALIGN);
        fits::<Wide>(128);
        assert_eq!(size_of::<Wide>(), 256);
    }
}
