//! An allocator that counts, for test programs that make it theirs.

#![allow(dead_code, reason = "each test file uses some of it")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicU64, Ordering};

/// Counts on the real-time path, on the calling thread, and everywhere.
pub(crate) struct Counting {
    before: fn(Layout),
    on_path: Counts,
    everywhere: Counts,
}

struct Counts {
    allocations: AtomicU64,
    frees: AtomicU64,
}

/// Allocations and frees.
pub(crate) type Counted = (u64, u64);

thread_local! {
    static HERE: Cell<Counted> = const { Cell::new((0, 0)) };
    static IS_MAIN: Cell<Option<bool>> = const { Cell::new(None) };
}

/// Whether this is the program's first thread, where the test harness also does its own work.
fn is_main() -> bool {
    IS_MAIN.get().unwrap_or_else(|| {
        #[cfg(target_os = "linux")]
        let is_main = nix::unistd::gettid() == nix::unistd::getpid();
        #[cfg(not(target_os = "linux"))]
        let is_main = false;
        IS_MAIN.set(Some(is_main));
        is_main
    })
}

impl Counts {
    const fn new() -> Self {
        Self {
            allocations: AtomicU64::new(0),
            frees: AtomicU64::new(0),
        }
    }

    fn get(&self) -> Counted {
        (
            self.allocations.load(Ordering::SeqCst),
            self.frees.load(Ordering::SeqCst),
        )
    }

    fn add(&self, (allocations, frees): Counted) {
        self.allocations.fetch_add(allocations, Ordering::SeqCst);
        self.frees.fetch_add(frees, Ordering::SeqCst);
    }
}

impl Counting {
    pub(crate) const fn new() -> Self {
        Self::calling(|_| ())
    }

    /// Calls `before` with what each allocation asks for.
    pub(crate) const fn calling(before: fn(Layout)) -> Self {
        Self {
            before,
            on_path: Counts::new(),
            everywhere: Counts::new(),
        }
    }

    /// Where `luna::realtime::on_path()` says so.
    pub(crate) fn on_path(&self) -> Counted {
        self.on_path.get()
    }

    /// On all threads but the program's first.
    pub(crate) fn everywhere(&self) -> Counted {
        self.everywhere.get()
    }

    /// On this thread.
    pub(crate) fn here(&self) -> Counted {
        HERE.get()
    }

    fn count(&self, (allocations, frees): Counted) {
        let here = HERE.get();
        HERE.set((here.0 + allocations, here.1 + frees));
        if !is_main() {
            self.everywhere.add((allocations, frees));
        }
        if luna::realtime::on_path() {
            self.on_path.add((allocations, frees));
        }
    }
}

// SAFETY: all is passed on to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        (self.before)(layout);
        self.count((1, 0));
        // SAFETY: the caller promises a layout that is not of size 0, which is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        self.count((0, 1));
        // SAFETY: the caller promises that this allocator made the block, with this layout; all
        // calls are passed on, so the system's allocator made it.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        self.count((1, 0));
        // SAFETY: the caller promises that this allocator made the block, with this layout, and
        // that the new size is one of a layout, and not 0; all calls are passed on, so the system's
        // made it.
        unsafe { System.realloc(pointer, layout, size) }
    }
}
