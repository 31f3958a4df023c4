//! Shared memory that is had before it is used: reserved, touched and, where the system allows it,
//! locked. A file that is only made longer takes its memory at the first access, and where none is
//! left then, that access ends the program by SIGBUS.

use crate::name::Name;
use crate::{IpcError, free};
use memmap2::{Advice, MmapOptions, MmapRaw};
use nix::errno::Errno;
use nix::fcntl::posix_fallocate;
use std::fs::{File, Metadata};
use std::io::{self, ErrorKind};
use std::os::unix::fs::MetadataExt;
use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

/// What one system call reserves: a call that a signal interrupts begins anew.
const STEP: usize = 16 << 20;
/// No page is smaller.
const PAGE: usize = 4096;
/// The unit of `st_blocks`.
const BLOCK: u64 = 512;

/// A mapping of a file, from its first byte on. The memory for it is taken; but for a mapping to
/// [look](Self::look) at, it is touched too.
///
/// # Invariants
///
/// It can be written if it was made by [`reserve`](Self::reserve).
#[derive(Debug)]
pub(crate) struct Segment {
    mapping: MmapRaw,
    is_locked: bool,
}

impl Segment {
    /// Takes memory for the first `size` bytes of a file, which is made so long, and maps them to
    /// be read and written.
    pub(crate) fn reserve(name: &Name, file: &File, size: usize) -> Result<Self, IpcError> {
        let failed = |error: io::Error| refused(name, "reserve", error);
        let found = file.metadata().map_err(failed)?;
        let needed = size as u64;
        let missing = needed.saturating_sub(held(&found));
        let short = |(free, in_folder): (u64, bool)| IpcError::Room {
            name: name.text().to_owned(),
            size: needed,
            free,
            in_folder,
        };
        // Asked before, so that not all of the memory is taken from others until none is left.
        let free = free::here(file).map_err(failed)?;
        if missing > free.0 {
            return Err(short(free));
        }
        fill(file, size).map_err(|error| match error {
            Errno::ENOSPC | Errno::EFBIG | Errno::ENOMEM => short(free),
            error => failed(error.into()),
        })?;
        let mapped = MmapOptions::new().len(size).map_raw(file);
        let mapping = mapped.map_err(|error| refused(name, "map", error))?;
        touch(&mapping).map_err(failed)?;
        Ok(Self::locked(mapping))
    }

    /// Maps the first `size` bytes of a file to be read. Another program has reserved them.
    pub(crate) fn read(name: &Name, file: &File, size: usize) -> Result<Self, IpcError> {
        let mapping = Self::there(name, file, size, MmapOptions::new().populate())?;
        Ok(Self::locked(mapping))
    }

    /// As [`read`](Self::read), to look at some of it once: nothing is touched or locked for that.
    pub(crate) fn look(name: &Name, file: &File, size: usize) -> Result<Self, IpcError> {
        let mapping = Self::there(name, file, size, &mut MmapOptions::new())?;
        let is_locked = false;
        Ok(Self { mapping, is_locked })
    }

    /// Maps what another program has reserved: an access to what it has not may end this one.
    fn there(
        name: &Name,
        file: &File,
        size: usize,
        options: &mut MmapOptions,
    ) -> Result<MmapRaw, IpcError> {
        let failed = |error: io::Error| refused(name, "map", error);
        let found = file.metadata().map_err(failed)?;
        if held(&found) < found.len() || found.len() < size as u64 {
            return Err(IpcError::Protocol {
                name: name.text().to_owned(),
            });
        }
        options.len(size).map_raw_read_only(file).map_err(failed)
    }

    /// The system may refuse it: then the pages stay as long as the computer does not swap.
    fn locked(mapping: MmapRaw) -> Self {
        let is_locked = mapping.lock().is_ok();
        Self { mapping, is_locked }
    }

    pub(crate) fn is_locked(&self) -> bool {
        self.is_locked
    }

    pub(crate) fn base(&self) -> *mut u8 {
        self.mapping.as_mut_ptr()
    }

    pub(crate) fn size(&self) -> usize {
        self.mapping.len()
    }
}

fn refused(name: &Name, what: &'static str, error: io::Error) -> IpcError {
    IpcError::Memory {
        name: name.text().to_owned(),
        what,
        why: error.to_string(),
    }
}

/// The bytes that the file has in memory.
fn held(found: &Metadata) -> u64 {
    found.blocks().saturating_mul(BLOCK)
}

fn fill(file: &File, size: usize) -> Result<(), Errno> {
    let size = libc::off_t::try_from(size).map_err(|_| Errno::EFBIG)?;
    for begin in (0..size).step_by(STEP) {
        let length = size.saturating_sub(begin).min(STEP as libc::off_t);
        while let Err(error) = posix_fallocate(file, begin, length) {
            if error != Errno::EINTR {
                return Err(error);
            }
        }
    }
    Ok(())
}

/// Lets the mapping have its pages, so that no access has to wait for the kernel.
fn touch(mapping: &MmapRaw) -> io::Result<()> {
    match mapping.advise(Advice::PopulateWrite) {
        // Before Linux 5.14.
        Err(error) if error.kind() == ErrorKind::InvalidInput => {
            touch_each(mapping);
            Ok(())
        }
        done => done,
    }
}

fn touch_each(mapping: &MmapRaw) {
    for offset in (0..mapping.len()).step_by(PAGE) {
        // SAFETY: the byte is in the mapping, which may be written and whose pages are reserved.
        // Other programs may use it: so it is exchanged with itself, atomically, and only if it is
        // 0, which is a write for the processor in both cases.
        let byte = unsafe { AtomicU8::from_ptr(mapping.as_mut_ptr().add(offset)) };
        let _ = byte.compare_exchange(0, 0, Relaxed, Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_that_cannot_touch_have_it_done_for_them() {
        let mapping = MmapRaw::from(memmap2::MmapMut::map_anon(3 * PAGE).unwrap());
        touch_each(&mapping);
        // SAFETY: it is one byte for each page.
        let resident = unsafe {
            let mut pages = [0_u8; 3];
            let base = mapping.as_mut_ptr().cast();
            assert_eq!(libc::mincore(base, mapping.len(), pages.as_mut_ptr()), 0);
            pages.iter().all(|page| page & 1 == 1)
        };
        assert!(resident);
    }
}
