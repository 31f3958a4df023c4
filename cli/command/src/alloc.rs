//! An allocator that counts what is allocated and freed where it must not be: on the real-time
//! path.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicU64, Ordering};

/// The system's allocator, counting the calls made while a predicate holds on the calling thread.
///
/// Counts are relaxed: exact in sum, and to be read when the measured code has ended.
#[derive(Debug)]
pub struct Counting {
    counts: fn() -> bool,
    allocations: AtomicU64,
    reallocations: AtomicU64,
    frees: AtomicU64,
}

/// How many calls were made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Counts {
    /// New memory.
    pub allocations: u64,
    /// Memory grown or shrunk.
    pub reallocations: u64,
    /// Memory given back.
    pub frees: u64,
}

impl Counting {
    /// Counts calls from threads on which `counts` is true. It is called inside the allocator: it
    /// must not allocate.
    pub const fn new(counts: fn() -> bool) -> Self {
        Self {
            counts,
            allocations: AtomicU64::new(0),
            reallocations: AtomicU64::new(0),
            frees: AtomicU64::new(0),
        }
    }

    /// The calls counted so far.
    pub fn counts(&self) -> Counts {
        Counts {
            allocations: self.allocations.load(Ordering::Relaxed),
            reallocations: self.reallocations.load(Ordering::Relaxed),
            frees: self.frees.load(Ordering::Relaxed),
        }
    }

    fn count(&self, calls: &AtomicU64) {
        if (self.counts)() {
            calls.fetch_add(1, Ordering::Relaxed);
        }
    }
}

// SAFETY: every call goes to `System` unchanged, which keeps the contract; counting touches no
// memory of the caller.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        self.count(&self.allocations);
        // SAFETY: the caller keeps the contract of `GlobalAlloc::alloc`, which is that of `System`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        self.count(&self.allocations);
        // SAFETY: as in `alloc`.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        self.count(&self.reallocations);
        // SAFETY: as in `alloc`; the block came from here, so from `System`.
        unsafe { System.realloc(block, layout, new_size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        self.count(&self.frees);
        // SAFETY: as in `realloc`.
        unsafe { System.dealloc(block, layout) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    thread_local! {
        static COUNTED: Cell<bool> = const { Cell::new(false) };
    }

    fn exercise(allocator: &Counting) {
        let layout = Layout::array::<u8>(64).unwrap();
        let larger = Layout::array::<u8>(128).unwrap();
        // SAFETY: the layouts have a size, and each block goes back with the layout that it has by
        // then.
        unsafe {
            let block = allocator.alloc(layout);
            assert!(!block.is_null());
            block.write_bytes(7, 64);
            let block = allocator.realloc(block, layout, larger.size());
            assert_eq!(*block.add(63), 7);
            allocator.dealloc(block, larger);
            let block = allocator.alloc_zeroed(layout);
            assert_eq!(*block, 0);
            allocator.dealloc(block, layout);
        }
    }

    #[test]
    fn counts_each_kind_where_the_predicate_holds() {
        let allocator = Counting::new(|| COUNTED.get());
        exercise(&allocator);
        assert_eq!(allocator.counts(), Counts::default());
        COUNTED.set(true);
        exercise(&allocator);
        let once = Counts {
            allocations: 2,
            reallocations: 1,
            frees: 2,
        };
        assert_eq!(allocator.counts(), once);
        // Another thread decides for itself.
        std::thread::scope(|scope| {
            scope.spawn(|| exercise(&allocator));
        });
        assert_eq!(allocator.counts(), once);
    }
}
