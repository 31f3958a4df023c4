//! Copies between a value and its place in shared memory, while other threads or programs access
//! that place.
//!
//! A copy may be torn, which its user detects and discards. It must be no data race all the same,
//! so each word is accessed atomically. The words are `MaybeUninit`, since values may have padding:
//! that is what the standard library's atomics cannot hold.

use atomic_maybe_uninit::AtomicMaybeUninit;
use std::mem::MaybeUninit;
use std::ptr::NonNull;
use std::sync::atomic::Ordering::Relaxed;

/// A word of a copy: the fewer words, the less likely is a copy torn.
type Word = usize;

/// The bits of a size that make whole words.
const WHOLE: usize = !(size_of::<Word>() - 1);

/// Copies `size` bytes out of shared memory.
///
/// # Safety
///
/// `from` is aligned to a word, and begins `size` bytes that are live and, meanwhile, accessed by
/// this module alone. `to` is room for them that no other thread accesses.
#[inline]
pub(crate) unsafe fn load(from: NonNull<u8>, to: *mut u8, size: usize) {
    let whole = size & WHOLE;
    // SAFETY: all words and bytes are within `size` of both pointers, and words are aligned in
    // shared memory. There all accesses are atomic, and of the other place this thread's alone. The
    // shared memory may be mapped for reading alone: the references only load.
    unsafe {
        for offset in (0..whole).step_by(size_of::<Word>()) {
            let word = from.add(offset).cast::<AtomicMaybeUninit<Word>>().as_ref();
            let to = to.add(offset).cast::<MaybeUninit<Word>>();
            to.write_unaligned(word.load(Relaxed));
        }
        for offset in whole..size {
            let byte = from.add(offset).cast::<AtomicMaybeUninit<u8>>().as_ref();
            let to = to.add(offset).cast::<MaybeUninit<u8>>();
            to.write(byte.load(Relaxed));
        }
    }
}

/// A copy of the first `size` bytes of a place in shared memory: what is checked in it stays as it
/// was when it was checked, whatever the other program does.
///
/// # Safety
///
/// `from` is aligned to a word, and begins `size` bytes that are live and have values.
pub(crate) unsafe fn bytes(from: NonNull<u8>, size: usize) -> Vec<u8> {
    let mut bytes = vec![0; size];
    // SAFETY: the caller promises what is said of `from`, and the vector is as long, and this
    // thread's.
    unsafe { load(from, bytes.as_mut_ptr(), size) };
    bytes
}

/// Copies `size` bytes into shared memory.
///
/// # Safety
///
/// `to` is aligned to a word, and begins `size` bytes that are live, may be written and are,
/// meanwhile, accessed by this module alone. `from` begins as many bytes that no other thread
/// writes.
#[inline]
pub(crate) unsafe fn store(from: *const u8, to: NonNull<u8>, size: usize) {
    let whole = size & WHOLE;
    // SAFETY: all words and bytes are within `size` of both pointers, and words are aligned in
    // shared memory. There all accesses are atomic, and the other place is not written.
    unsafe {
        for offset in (0..whole).step_by(size_of::<Word>()) {
            let word = AtomicMaybeUninit::<Word>::from_ptr(to.add(offset).cast().as_ptr());
            let from = from.add(offset).cast::<MaybeUninit<Word>>();
            word.store(from.read_unaligned(), Relaxed);
        }
        for offset in whole..size {
            let byte = AtomicMaybeUninit::<u8>::from_ptr(to.add(offset).cast().as_ptr());
            let from = from.add(offset).cast::<MaybeUninit<u8>>();
            byte.store(from.read(), Relaxed);
        }
    }
}
