//! What a program for any chip needs beside LUNA, by hand: the vectors, the start, memory for the
//! set-up, and an output. The crates `cortex-m-rt`, `embedded-alloc` and `defmt` have the same.

use crate::program;
use core::alloc::{GlobalAlloc, Layout};
use core::arch::asm;
use core::cell::UnsafeCell;
use core::fmt::{self, Write};
use core::panic::PanicInfo;
use critical_section::with;

unsafe extern "C" {
    static stack_start: u32;
    static data_source: u32;
    static mut data_start: u32;
    static data_end: u32;
    static mut bss_start: u32;
    static bss_end: u32;
}

#[repr(C)]
union Vector {
    stack: *const u32,
    handler: unsafe extern "C" fn(),
    none: usize,
}

// SAFETY: it is constant.
unsafe impl Sync for Vector {}

#[unsafe(link_section = ".vectors")]
#[unsafe(no_mangle)]
static VECTORS: [Vector; 16] = [
    Vector {
        stack: &raw const stack_start,
    },
    Vector { handler: reset },
    Vector { handler: fault },
    Vector { handler: fault },
    Vector { handler: fault },
    Vector { handler: fault },
    Vector { handler: fault },
    Vector { none: 0 },
    Vector { none: 0 },
    Vector { none: 0 },
    Vector { none: 0 },
    Vector { handler: fault },
    Vector { handler: fault },
    Vector { none: 0 },
    Vector { handler: fault },
    Vector {
        handler: program::sys_tick,
    },
];

/// The first code that runs.
#[unsafe(no_mangle)]
unsafe extern "C" fn reset() {
    // SAFETY: nothing else runs yet. The linker script gives the bounds, which are aligned to
    // words; the register turns on the floating-point unit, which the target's code uses.
    unsafe {
        let (mut to, mut from) = (&raw mut data_start, &raw const data_source);
        while to.cast_const() < &raw const data_end {
            to.write_volatile(from.read_volatile());
            (to, from) = (to.add(1), from.add(1));
        }
        let mut to = &raw mut bss_start;
        while to.cast_const() < &raw const bss_end {
            to.write_volatile(0);
            to = to.add(1);
        }
        let coprocessors = 0xE000_ED88 as *mut u32;
        coprocessors.write_volatile(coprocessors.read_volatile() | 0xF << 20);
        asm!("dsb", "isb");
    }
    program::main();
    exit(true);
}

unsafe extern "C" fn fault() {
    println(format_args!("a fault"));
    exit(false);
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    println(format_args!("{info}"));
    exit(false);
}

/// Memory for the set-up: it is given and not taken back, so that it takes a bounded time.
struct Memory {
    room: UnsafeCell<[u64; 8 << 10]>,
    used: UnsafeCell<usize>,
}

// SAFETY: it is used in critical sections alone.
unsafe impl Sync for Memory {}

#[global_allocator]
static MEMORY: Memory = Memory {
    room: UnsafeCell::new([0; 8 << 10]),
    used: UnsafeCell::new(0),
};

// SAFETY: each piece is given once, aligned as asked for.
unsafe impl GlobalAlloc for Memory {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        with(|_| {
            let room = self.room.get().cast::<u8>();
            // SAFETY: this is a critical section, and the piece lies within the room.
            unsafe {
                let free = room.add(*self.used.get());
                let end = *self.used.get() + free.align_offset(layout.align()) + layout.size();
                if end > size_of::<[u64; 8 << 10]>() {
                    return core::ptr::null_mut();
                }
                *self.used.get() = end;
                room.add(end - layout.size())
            }
        })
    }

    unsafe fn dealloc(&self, _: *mut u8, _: Layout) {}
}

/// How many bytes have been given.
pub(crate) fn allocated() -> usize {
    // SAFETY: this is a critical section.
    with(|_| unsafe { *MEMORY.used.get() })
}

/// A call of the debugger's host: semihosting.
fn host(operation: u32, argument: usize) {
    // SAFETY: the host reads what the argument points to, and nothing else.
    unsafe { asm!("bkpt 0xAB", inout("r0") operation => _, in("r1") argument, options(nostack)) };
}

/// Ends the program, and the emulator with it.
pub(crate) fn exit(is_well: bool) -> ! {
    // ADP_Stopped_ApplicationExit, or ADP_Stopped_RunTimeErrorUnknown.
    host(0x18, if is_well { 0x2_0026 } else { 0x2_0023 });
    #[expect(clippy::empty_loop, reason = "the emulator has ended")]
    loop {}
}

/// A line for the host.
struct Line([u8; 128], usize);

impl Write for Line {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for &byte in text.as_bytes().iter().take(126 - self.1) {
            self.0[self.1] = byte;
            self.1 += 1;
        }
        Ok(())
    }
}

pub(crate) fn println(text: fmt::Arguments<'_>) {
    let mut line = Line([0; 128], 0);
    // It never fails: what does not fit is left out.
    let _ = line.write_fmt(text);
    line.0[line.1] = b'\n';
    host(0x04, line.0.as_ptr().addr());
}
