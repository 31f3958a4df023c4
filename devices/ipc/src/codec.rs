//! How a value lies in shared memory, and where.
//!
//! Sizes may be another program's, or a user's: what adds them up says so when it goes beyond all
//! addresses, and nothing is opened then.

use crate::copy;
use crate::error::TypeInfo;
use crate::memory::OFFSET;
use crate::session::Session;
use crate::{IpcError, ZeroCopySend};
use std::ptr::NonNull;
#[cfg(feature = "serde")]
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;

type Write<T> = Box<dyn Fn(NonNull<u8>, usize, &T) -> Result<(), String> + Send + Sync>;
type Read<T> = Box<dyn Fn(NonNull<u8>, usize) -> Result<T, String> + Send + Sync>;

type HandleWrite<T> = Box<dyn Fn(&T) -> [u64; 2] + Send + Sync>;
type HandleRead<T> = Box<dyn Fn([u64; 2]) -> Result<T, String> + Send + Sync>;

/// How values of a type are written and read.
///
/// # Invariants
///
/// `write` and `read` may be called with a place that is `size` bytes long and aligned to a page:
/// `write`, while no one else accesses it; `read`, where `write` of the same codec has written,
/// while no one writes.
pub(crate) struct Codec<T> {
    info: TypeInfo,
    size: usize,
    write: Write<T>,
    read: Read<T>,
    /// Takes a value back that was written, and that may have been read.
    take_back: fn(&mut T),
}

/// Where values of a codec are in the memory of a session.
pub(crate) struct Place<T> {
    codec: Codec<T>,
    offset: usize,
}

impl<T> Place<T> {
    /// The first place in a segment.
    pub(crate) fn first(codec: Codec<T>) -> Self {
        let offset = OFFSET;
        Self { codec, offset }
    }

    /// The next one, on pages of its own. If there are no addresses for it, it is nowhere, and has
    /// no end.
    pub(crate) fn after<U>(place: &Place<U>, codec: Codec<T>) -> Self {
        let end = place.end();
        let offset = end.and_then(|end| end.checked_next_multiple_of(OFFSET));
        let offset = offset.unwrap_or(usize::MAX);
        Self { codec, offset }
    }

    /// The bytes of a segment that ends with this place; `None`: more than there are addresses.
    pub(crate) fn end(&self) -> Option<usize> {
        let end = self.offset.checked_add(self.codec.size)?;
        isize::try_from(end).is_ok().then_some(end)
    }

    pub(crate) fn info(&self) -> &TypeInfo {
        &self.codec.info
    }

    /// Writes a value.
    ///
    /// # Errors
    ///
    /// It cannot be encoded; then nothing is to be published.
    ///
    /// # Safety
    ///
    /// Of the two programs this one has the turn to write here: no one else accesses the place.
    pub(crate) unsafe fn write(&self, session: &Session, value: &T) -> Result<(), IpcError> {
        let place = session.memory().at(self.offset, self.codec.size);
        // SAFETY of what the codec does: the place is as long, and aligned to a page, since offsets
        // are. The caller promises that no one else accesses it.
        (self.codec.write)(place, self.codec.size, value).map_err(|why| IpcError::Encode {
            name: session.name().to_owned(),
            capacity: self.codec.size,
            why,
        })
    }

    /// Takes a value back after its sending has failed, before its sender has it again.
    pub(crate) fn take_back(&self, value: &mut T) {
        (self.codec.take_back)(value);
    }

    /// Copies a value out.
    ///
    /// # Errors
    ///
    /// It cannot be decoded.
    ///
    /// # Safety
    ///
    /// The other program has written a value here by the same codec, and does not write meanwhile.
    pub(crate) unsafe fn read(&self, session: &Session) -> Result<T, IpcError> {
        let place = session.memory().at(self.offset, self.codec.size);
        // SAFETY of what the codec does: the place is as long, and aligned to a page, since offsets
        // are. The caller promises that a value is there, and that no one writes meanwhile.
        (self.codec.read)(place, self.codec.size).map_err(|why| IpcError::Decode {
            name: session.name().to_owned(),
            pid: session.other().pid.load(Relaxed),
            why,
        })
    }
}

impl<T: ZeroCopySend> Codec<T> {
    /// The value as it is, with its padding.
    pub(crate) fn plain(version: u32) -> Self {
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
            info: TypeInfo::of::<T>(version),
            size: size_of::<T>(),
            write: Box::new(|place, _, value| {
                // SAFETY: by the codec's contract the place is large enough, aligned, and no one
                // else accesses it. The value is a borrow, so it is elsewhere.
                unsafe { place.cast::<T>().copy_from_nonoverlapping(value.into(), 1) };
                Ok(())
            }),
            // SAFETY: by the codec's contract a value was written there. Both programs state the
            // same type, whose bits mean the same in both, by `ZeroCopySend`; it has no drop, so a
            // copy is harmless.
            read: Box::new(|place, _| Ok(unsafe { place.cast::<T>().read() })),
            take_back: |_| (),
        }
    }
}

impl<T: 'static> Codec<T> {
    /// Of values that are bytes in a place of `size` bytes. `bytes` gives at most so many.
    pub(crate) fn bytes(
        info: TypeInfo,
        size: usize,
        bytes: impl Fn(&T) -> Result<Vec<u8>, String> + Send + Sync + 'static,
        value: impl Fn(&[u8]) -> Result<T, String> + Send + Sync + 'static,
    ) -> Self {
        Self {
            info,
            size,
            write: Box::new(move |place, size, value| {
                let bytes = bytes(value)?;
                if bytes.len() > size {
                    return Err("it is too long".to_owned());
                }
                // SAFETY: by the codec's contract the place is as long, and no one else accesses
                // it. The bytes are elsewhere.
                unsafe {
                    place.copy_from_nonoverlapping(NonNull::from_ref(&*bytes).cast(), bytes.len())
                };
                Ok(())
            }),
            read: Box::new(move |place, size| {
                // SAFETY: by the codec's contract the place is as long, aligned to a page, and a
                // value is there. In shared memory each byte has a value.
                value(&unsafe { copy::bytes(place, size) })
            }),
            take_back: |_| (),
        }
    }

    /// Of a handle of which 16 bytes cross.
    pub(crate) fn handle(
        info: TypeInfo,
        write: HandleWrite<T>,
        read: HandleRead<T>,
        take_back: fn(&mut T),
    ) -> Self {
        Self {
            info,
            size: size_of::<[u64; 2]>(),
            write: Box::new(move |place, _, value| {
                // SAFETY: by the codec's contract the place is large enough, aligned to a page, and
                // accessed by no one else.
                unsafe { place.cast().write(write(value)) };
                Ok(())
            }),
            // SAFETY: by the codec's contract the place is large enough, aligned to a page, and
            // written by no one now. `write` has written there, and any bits are valid.
            read: Box::new(move |place, _| read(unsafe { place.cast().read() })),
            take_back,
        }
    }

    /// A value or none: a word after the place of `codec` says which.
    pub(crate) fn optional(codec: Codec<T>) -> Codec<Option<T>> {
        let Codec {
            info,
            size,
            write,
            read,
            ..
        } = codec;
        let offset = size.checked_next_multiple_of(align_of::<u64>());
        let room = offset.and_then(|offset| offset.checked_add(size_of::<u64>()));
        // Without room there is no place either, so that nothing is written or read.
        let offset = offset.unwrap_or(0);
        let put = move |place: NonNull<u8>, _: usize, value: &Option<T>| {
            if let Some(value) = value {
                write(place, size, value)?;
            }
            let word = u64::from(value.is_some());
            // SAFETY: by the codec's contract the place has room for the word behind the value, is
            // aligned to a page, and is accessed by no one else.
            unsafe { place.add(offset).cast::<u64>().write(word) };
            Ok(())
        };
        let get = move |place: NonNull<u8>, _: usize| {
            // SAFETY: by the codec's contract `put` has written the word, in the room behind the
            // value, and no one writes now. Any bits are valid.
            let word = unsafe { place.add(offset).cast::<u64>().read() };
            match word {
                0 => Ok(None),
                _ => read(place, size).map(Some),
            }
        };
        Codec {
            info,
            size: room.unwrap_or(usize::MAX),
            write: Box::new(put),
            read: Box::new(get),
            take_back: |_| (),
        }
    }
}

#[cfg(feature = "serde")]
impl<T: serde::Serialize + serde::de::DeserializeOwned> Codec<T> {
    /// The value in postcard's format, with its length before it: `capacity` bytes at most.
    pub(crate) fn postcard(capacity: usize, version: u32) -> Self {
        let name = format!("{} by postcard", std::any::type_name::<T>());
        Self {
            info: TypeInfo::new(&name, capacity, 1, version),
            size: LENGTH.saturating_add(capacity),
            write: Box::new(|place, size, value| {
                // SAFETY: by the codec's contract the place is as long, and no one else accesses
                // it. It holds bytes, which the kernel has set to zero before the first use.
                let bytes = unsafe { std::slice::from_raw_parts_mut(place.as_ptr(), size) };
                let (length, room) = bytes.split_at_mut(LENGTH);
                let used = postcard::to_slice(value, room)
                    .map_err(|error| error.to_string())?
                    .len();
                length.copy_from_slice(&used.to_ne_bytes());
                Ok(())
            }),
            read: Box::new(|place, size| {
                // SAFETY: by the codec's contract the place is as long, which is `LENGTH` at least,
                // and aligned to a page. In shared memory each byte has a value.
                let length = unsafe { place.cast::<AtomicUsize>().as_ref() }.load(Relaxed);
                if size.checked_sub(LENGTH).is_none_or(|room| length > room) {
                    return Err("its length is beyond the end of the memory".to_owned());
                }
                // A copy: a string whose bytes change after they were checked would be none.
                // SAFETY: as above; the value is behind its length, at a multiple of a word, and it
                // was just seen that the place has so many bytes there.
                let used = unsafe { copy::bytes(place.add(LENGTH), length) };
                postcard::from_bytes(&used).map_err(|error| error.to_string())
            }),
            take_back: |_| (),
        }
    }
}

/// Bytes of the length before an encoded value.
#[cfg(feature = "serde")]
const LENGTH: usize = size_of::<usize>();
