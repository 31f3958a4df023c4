//! Having memory fetched into the cache before it is needed.

/// Asks the processor to fetch the lines that lie so many bytes behind `start`. A hint: nothing is accessed, so nothing need be there, and a processor that is not known here is asked for
/// nothing.
#[inline(always)]
pub(crate) fn lines<const N: usize>(start: *const u8, distances: [usize; N]) {
    for distance in distances {
        line(start.wrapping_add(distance));
    }
}

#[cfg(all(target_arch = "x86_64", not(miri)))]
#[inline(always)]
fn line(address: *const u8) {
    use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
    // SAFETY: every processor of this architecture has the instruction, which fails at no address.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(address.cast()) };
}

#[cfg(not(all(target_arch = "x86_64", not(miri))))]
#[inline(always)]
fn line(_: *const u8) {}
