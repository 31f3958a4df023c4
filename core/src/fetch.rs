//! Prefetching memory into the cache.

/// Asks the processor to prefetch the lines at these distances in bytes from `start`. A hint:
/// nothing is accessed, so the memory need not exist; on an unknown architecture it does nothing.
#[inline(always)]
pub(crate) fn lines<const N: usize>(start: *const u8, distances: [usize; N]) {
    for distance in distances {
        line(start.wrapping_add(distance));
    }
}

#[cfg(all(target_arch = "x86_64", not(miri)))]
#[inline(always)]
fn line(address: *const u8) {
    use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
    // SAFETY: every processor of this architecture has the instruction, which faults at no address.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(address.cast()) };
}

#[cfg(not(all(target_arch = "x86_64", not(miri))))]
#[inline(always)]
fn line(_: *const u8) {}
