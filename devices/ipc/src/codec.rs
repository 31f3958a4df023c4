//! How a value lies in shared memory.

use crate::ZeroCopySend;
use std::fmt;
use std::ptr::NonNull;

type Write<T> = unsafe fn(NonNull<u8>, usize, &T) -> Result<(), String>;
type Read<T> = unsafe fn(NonNull<u8>, usize) -> Result<T, String>;

/// How values of a type are written and read.
///
/// # Invariants
///
/// `write` and `read` may be called with a place that is `size` bytes long and aligned to a page;
/// `read`, where `write` of the same codec has written.
pub(crate) struct Codec<T> {
    size: usize,
    write: Write<T>,
    read: Read<T>,
}

impl<T> Clone for Codec<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Codec<T> {}

impl<T> Codec<T> {
    /// The bytes that a value needs at most.
    pub(crate) fn size(&self) -> usize {
        self.size
    }

    /// # Safety
    ///
    /// `place` is as long as `size()`, aligned to a page, writable, and accessed by no one else.
    pub(crate) unsafe fn write(&self, place: NonNull<u8>, value: &T) -> Result<(), String> {
        // SAFETY: the contract, and the invariants.
        unsafe { (self.write)(place, self.size, value) }
    }

    /// # Safety
    ///
    /// As for `write`, and the same codec has written the place.
    pub(crate) unsafe fn read(&self, place: NonNull<u8>) -> Result<T, String> {
        // SAFETY: the contract, and the invariants.
        unsafe { (self.read)(place, self.size) }
    }
}

impl<T: ZeroCopySend> Codec<T> {
    /// The value as it is, with its padding.
    pub(crate) fn plain() -> Self {
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
        Self {
            size: size_of::<T>(),
            write: |place, _, value| {
                // SAFETY: by the codec's contract the place is large enough, aligned, and no one
                // else accesses it. The value is a borrow, so it is elsewhere.
                unsafe { place.cast::<T>().copy_from_nonoverlapping(value.into(), 1) };
                Ok(())
            },
            // SAFETY: by the codec's contract a value was written there. Both programs state the
            // same type, whose bits mean the same in both, by `ZeroCopySend`; it has no drop, so a
            // copy is harmless.
            read: |place, _| Ok(unsafe { place.cast::<T>().read() }),
        }
    }
}

#[cfg(feature = "serde")]
impl<T: serde::Serialize + serde::de::DeserializeOwned> Codec<T> {
    /// The value in postcard's format, with its length before it: `capacity` bytes at most.
    pub(crate) fn postcard(capacity: usize) -> Self {
        Self {
            size: LENGTH + capacity,
            write: |place, size, value| {
                // SAFETY: by the codec's contract the place is as long, and no one else accesses
                // it. It holds bytes, which the kernel has set to zero before the first use.
                let bytes = unsafe { std::slice::from_raw_parts_mut(place.as_ptr(), size) };
                let (length, room) = bytes.split_at_mut(LENGTH);
                let used = postcard::to_slice(value, room)
                    .map_err(|error| error.to_string())?
                    .len();
                length.copy_from_slice(&used.to_ne_bytes());
                Ok(())
            },
            read: |place, size| {
                // SAFETY: as for `write`; the sender does not write while this is read.
                let bytes = unsafe { std::slice::from_raw_parts(place.as_ptr(), size) };
                let (length, room) = bytes.split_at(LENGTH);
                let length = length.try_into().map(usize::from_ne_bytes);
                let used = length.ok().and_then(|length| room.get(..length));
                let used = used.ok_or("its length is beyond the end of the memory")?;
                postcard::from_bytes(used).map_err(|error| error.to_string())
            },
        }
    }
}

/// Bytes of the length before an encoded value.
#[cfg(feature = "serde")]
const LENGTH: usize = size_of::<usize>();

impl<T> fmt::Debug for Codec<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Codec")
            .field("size", &self.size)
            .finish_non_exhaustive()
    }
}
