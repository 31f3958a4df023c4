//! A stack for signal handlers, for a thread that has used up its own.

use super::thread::page_size;
use nix::libc;
use std::ptr;

/// Large enough for the calls in a crash, with frames that hold all registers of the processor:
/// also of an unoptimized program.
const SIZE: usize = 64 << 10;

/// The calling thread's stack for handlers, until it is dropped on that thread. The page below it
/// is a guard.
pub(crate) struct AlternateStack {
    /// The mapping, and what was set before; none if there was no memory, and the thread keeps the
    /// stack that it had.
    made: Option<(*mut libc::c_void, usize, libc::stack_t)>,
}

impl AlternateStack {
    pub(crate) fn make() -> Self {
        let (guard, length) = (page_size(), page_size() + SIZE);
        // In memory from the beginning: a handler of an urgent thread is not to wait for pages.
        // SAFETY: a new mapping, at no address in particular; its lowest page is then made a guard.
        let mapping = unsafe {
            libc::mmap(
                ptr::null_mut(),
                length,
                libc::PROT_READ | libc::PROT_WRITE,
                libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_STACK | libc::MAP_POPULATE,
                -1,
                0,
            )
        };
        if mapping == libc::MAP_FAILED {
            return Self { made: None };
        }
        let stack = libc::stack_t {
            ss_sp: mapping.wrapping_byte_add(guard),
            ss_flags: 0,
            ss_size: SIZE,
        };
        let mut before = libc::stack_t {
            ss_sp: ptr::null_mut(),
            ss_flags: libc::SS_DISABLE,
            ss_size: 0,
        };
        // SAFETY: the mapping is this value's alone, and is unmapped only when the kernel does not
        // use it any more. The call fails only on one of the former stacks.
        let is_set = unsafe {
            libc::mprotect(mapping, guard, libc::PROT_NONE);
            libc::sigaltstack(&raw const stack, &raw mut before) == 0
        };
        if !is_set {
            // SAFETY: the kernel did not accept the mapping, so it is unused.
            unsafe { libc::munmap(mapping, length) };
            return Self { made: None };
        }
        Self {
            made: Some((mapping, length, before)),
        }
    }
}

impl Drop for AlternateStack {
    fn drop(&mut self) {
        let Some((mapping, length, before)) = self.made.take() else {
            return;
        };
        // SAFETY: the former stack lives as long as the thread; the mapping is unmapped only if the
        // kernel does not use it any more.
        unsafe {
            if libc::sigaltstack(&raw const before, ptr::null_mut()) == 0 {
                libc::munmap(mapping, length);
            }
        }
    }
}
