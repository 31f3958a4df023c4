//! A stack for signal handlers, for a thread that has used up its own.

use super::thread::page_size;
use nix::libc;
use std::ptr;

/// Large enough for the calls in a crash, with frames that hold all registers of the processor:
/// also of an unoptimized program.
const SIZE: usize = 64 << 10;

/// A stack for signal handlers, as the threads made here have, for a thread that was made
/// elsewhere: until it is dropped there. The page below it is a guard.
#[derive(Debug)]
#[must_use = "it is taken back when it is dropped"]
pub struct HandlerStack {
    /// The mapping, and what was set before; none if there was no memory, and the thread keeps the
    /// stack that it had.
    made: Option<(*mut libc::c_void, usize, libc::stack_t)>,
}

impl HandlerStack {
    /// Makes the stack, and sets it for the calling thread, in place of a former one. If there is
    /// no memory for it nothing changes. Not for the real-time path.
    pub fn here() -> Self {
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

impl Drop for HandlerStack {
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
