//! Memory that is resident when it is used.
//!
//! A page that is not in memory costs the thread that touches it some microseconds, or milliseconds
//! if it must be read from a disk. [`lock_memory`] keeps every page of the process in memory, those
//! to come included; [`prefault_heap`] faults in the pages of the heap before they are needed and
//! makes the allocator keep them. Stacks are faulted in by
//! [`thread::spawn`](luna_platform::thread::spawn).
//!
//! Not for the real-time path.

use crate::backend::memory as backend;
use crate::shortfall::Shortfall;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// The number of locks held in this process. The kernel knows one lock: the first takes it and the
/// last releases it.
static HELD: Mutex<usize> = Mutex::new(0);

/// The maximum number of bytes copied at once: bodies of processes have some hundreds.
const MAX_COPIED: usize = 1 << 20;

/// The words that lie in a range of this program's addresses, copied by the kernel; of at most a
/// mebibyte. Empty where the kernel refuses, where there is no such memory, and on the portable
/// backend. For reports that look for addresses in what a process holds. Not for the real-time
/// path.
///
/// The kernel reads bytes, whatever they are for: that some of them were never written, are written
/// at the same time or have gone is no access of the program's own. So what it finds is a hint.
///
/// ```
/// use luna_machine::memory::copy_words;
///
/// let words = [3_usize, 5, 8];
/// let range = words.as_ptr_range();
/// let copied = copy_words(range.start.addr()..range.end.addr());
/// assert!(copied.is_empty() || copied == words);
/// assert!(copy_words(8..64).is_empty());
/// ```
pub fn copy_words(range: Range<usize>) -> Vec<usize> {
    const WORD: usize = size_of::<usize>();
    let start = range.start.next_multiple_of(WORD);
    let length = range.end.saturating_sub(start).min(MAX_COPIED);
    let mut bytes = vec![0; length];
    let copied = backend::copy(start, &mut bytes);
    let (words, _) = bytes[..copied].as_chunks::<WORD>();
    words.iter().copied().map(usize::from_ne_bytes).collect()
}

/// Locks the memory of the whole process, now and to come, until the last lock is dropped.
///
/// Only with CAP_IPC_LOCK or an unlimited RLIMIT_MEMLOCK: under a smaller limit it would succeed
/// here, and the third thread or so would fail to start, since its stack is locked too. Each page
/// of the process then takes real memory: O(its size).
///
/// # Errors
///
/// [`Shortfall::MemoryLock`] reports why not, and how to get it.
///
/// ```
/// match luna_machine::memory::lock_memory() {
///     Ok(lock) => drop(lock), // hold it as long as real-time threads run
///     Err(shortfall) => eprintln!("{shortfall}"),
/// }
/// ```
pub fn lock_memory() -> Result<MemoryLock, Shortfall> {
    let mut held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    if *held == 0 {
        backend::lock().map_err(Shortfall::MemoryLock)?;
    }
    *held += 1;
    Ok(MemoryLock { _private: () })
}

/// The process' memory is locked while one of these lives.
#[derive(Debug)]
#[must_use = "the memory is unlocked when the last lock is dropped"]
pub struct MemoryLock {
    _private: (),
}

impl Drop for MemoryLock {
    fn drop(&mut self) {
        let mut held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
        *held -= 1;
        if *held == 0 {
            backend::unlock();
        }
    }
}

/// Faults in `bytes` of heap and makes the allocator keep them: later allocations of that size in
/// all find their pages present.
///
/// With the GNU C library's allocator the setting holds for the rest of the program's run: freed
/// memory stays with the process, and large blocks come from the heap too instead of from mappings
/// of their own. It is the heap of the calling thread and of all threads that share its arena;
/// other threads have arenas of their own, and only [`lock_memory`] makes the pages of those
/// present. With another allocator the pages are fetched, and whether it keeps them is up to it.
///
/// O(`bytes`): 1.3 µs a page on the reference machine, a virtual one, so some 0.3 s a gigabyte.
///
/// # Errors
///
/// [`HeapError`] if there is not that much memory to be had.
///
/// ```
/// luna_machine::memory::prefault_heap(1 << 20)?;
/// # Ok::<(), luna_machine::memory::HeapError>(())
/// ```
pub fn prefault_heap(bytes: usize) -> Result<(), HeapError> {
    backend::keep_heap();
    let mut pages: Vec<u8> = Vec::new();
    pages
        .try_reserve_exact(bytes)
        .map_err(|_| HeapError { bytes })?;
    // One write to each page; 4 KiB is the smallest page there is.
    for page in pages.spare_capacity_mut().chunks_mut(4096) {
        if let Some(first) = page.first_mut() {
            // Volatile, since the compiler would remove a store that is never read. SAFETY: the
            // byte lies in the vector's spare capacity, and any value may be written to it.
            unsafe { first.as_mut_ptr().write_volatile(0) };
        }
    }
    Ok(())
}

/// There is not that much memory.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "the heap cannot hold {bytes} bytes in advance; ask for less, or raise the memory limit (ulimit -v)"
)]
pub struct HeapError {
    bytes: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_heap_than_there_is() {
        let error = prefault_heap(usize::MAX / 4).unwrap_err();
        assert!(
            error.to_string().contains(&(usize::MAX / 4).to_string()),
            "{error}"
        );
        prefault_heap(0).unwrap();
    }
}
