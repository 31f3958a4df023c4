//! An asymmetric pair of fences, one of which costs nothing: `membarrier(2)`.

use nix::errno::Errno;
use std::sync::atomic::{AtomicU8, Ordering, compiler_fence};

const REGISTER: libc::c_long = libc::MEMBARRIER_CMD_REGISTER_PRIVATE_EXPEDITED as libc::c_long;
const EXPEDITED: libc::c_long = libc::MEMBARRIER_CMD_PRIVATE_EXPEDITED as libc::c_long;

const GLOBAL: libc::c_long = libc::MEMBARRIER_CMD_GLOBAL as libc::c_long;

const UNASKED: u8 = 0;
const AVAILABLE: u8 = 1;
const REFUSED: u8 = 2;
static STATE: AtomicU8 = AtomicU8::new(UNASKED);

/// Asks the kernel for the heavy fence, once for the program. Off the real-time path: the first
/// call may take milliseconds.
pub fn prepare() {
    if STATE.load(Ordering::Acquire) == UNASKED {
        let granted = call(REGISTER).and_then(|()| call(EXPEDITED)).is_ok();
        STATE.store(if granted { AVAILABLE } else { REFUSED }, Ordering::Release);
    }
}

/// Whether the heavy fence can be had.
#[inline]
pub fn is_available() -> bool {
    STATE.load(Ordering::Relaxed) == AVAILABLE
}

/// Orders what this thread does for a thread that calls [`heavy`]. No instruction.
#[inline(always)]
pub fn light() {
    compiler_fence(Ordering::SeqCst);
}

/// A full fence on this thread, and on each other running thread of the program. A system call.
pub fn heavy() {
    let fenced = crate::path::expected(crate::path::Call::Fence, || match call(EXPEDITED) {
        // The kernel allocates a set of processors to interrupt on machines with very many. The
        // slow command needs no memory.
        Err(Errno::ENOMEM) => call(GLOBAL),
        fenced => fenced,
    });
    // What was granted once is not refused: the kernel keeps the registration with the address
    // space.
    if let Err(error) = fenced {
        panic!("the kernel refused a memory barrier that it had granted: {error}");
    }
}

fn call(command: libc::c_long) -> Result<(), Errno> {
    // SAFETY: the call takes no pointers.
    Errno::result(unsafe { libc::syscall(libc::SYS_membarrier, command, 0, 0) }).map(drop)
}
