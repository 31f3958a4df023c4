//! After the first wait of a thread, waiting for files allocates and frees nothing.

#![cfg(all(unix, not(loom)))]

use crate::file_support;
use crate::support;
use file_support::{pair, read_byte, with_files, write_byte};
use luna_core::{Exit, ProcessSpec, prepare_files, yield_now};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use support::{Log, executor};

struct Counting;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: the system's allocator does the work.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = COUNT.try_with(|count| count.set(count.get() + 1));
        // SAFETY: the caller promises a layout that is not of size 0, which is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        let _ = COUNT.try_with(|count| count.set(count.get() + 1));
        // SAFETY: all calls are passed on, so the system's allocator made the block, and with this
        // layout.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn waits_of_prepared_threads() {
    let Some(_watch) = with_files() else { return };
    let (one, two) = (executor(), executor());
    let (near, far) = pair();
    two.spawn(ProcessSpec::new("echo"), move || async move {
        while let Ok(Some(byte)) = read_byte(&far).await {
            write_byte(&far, byte).await.unwrap();
        }
    });
    let counts = Log::new();
    let own = counts.clone();
    let process = one.spawn(ProcessSpec::new("asks"), move || async move {
        prepare_files().unwrap();
        // The first wait of all, for a file that the thread has not waited for before, belongs to
        // what is measured.
        let before = COUNT.get();
        for byte in 0..100 {
            write_byte(&near, byte).await.unwrap();
            assert_eq!(read_byte(&near).await, Ok(Some(byte)));
            yield_now().await;
        }
        let after = COUNT.get();
        own.add(after - before);
    });
    one.release();
    two.release();
    assert_eq!(process.wait(), Exit::Completed);
    assert_eq!(counts.take(), [0]);
}
