//! Locked memory: `mlockall`, where it keeps working.

use crate::facts::task::CAP_IPC_LOCK;
use crate::shortfall::{MemoryRefusal, in_a_user_namespace};
use luna_platform::thread::has_capability;
use nix::errno::Errno;
use nix::libc;
use nix::sys::mman::{MlockAllFlags, mlockall, munlockall};
use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit};
use nix::sys::uio::{RemoteIoVec, process_vm_readv};
use nix::unistd::Pid;
use std::io::IoSliceMut;

/// Locks all pages, those to come too.
pub(crate) fn lock() -> Result<(), MemoryRefusal> {
    let limit = getrlimit(Resource::RLIMIT_MEMLOCK)
        .ok()
        .map(|(soft, _)| soft);
    // A capability in a user namespace does not lift the limit.
    let capable = has_capability(CAP_IPC_LOCK) == Some(true) && !in_a_user_namespace();
    if !capable && limit != Some(RLIM_INFINITY) {
        return Err(MemoryRefusal::Limited { limit });
    }
    mlockall(MlockAllFlags::MCL_CURRENT | MlockAllFlags::MCL_FUTURE).map_err(|error| match error {
        Errno::EPERM => MemoryRefusal::Limited { limit },
        error => MemoryRefusal::Kernel {
            message: error.to_string(),
        },
    })
}

/// Copies the memory from `address` on; returns the number of bytes.
pub(crate) fn copy(address: usize, into: &mut [u8]) -> usize {
    let from = RemoteIoVec {
        base: address,
        len: into.len(),
    };
    process_vm_readv(Pid::this(), &mut [IoSliceMut::new(into)], &[from]).unwrap_or(0)
}

/// Unlocks all pages.
pub(crate) fn unlock() {
    // The call has no way to fail.
    let _ = munlockall();
}

/// Makes the allocator return no memory to the kernel.
pub(crate) fn keep_heap() {
    #[cfg(target_env = "gnu")]
    // SAFETY: both parameters exist, and may be changed at any time by any thread. A refusal (0)
    // leaves things as they were.
    unsafe {
        // Never shrink the heap: -1 is the largest threshold.
        libc::mallopt(libc::M_TRIM_THRESHOLD, -1);
        // No block gets a mapping of its own, which `free` would unmap.
        libc::mallopt(libc::M_MMAP_MAX, 0);
    }
}
