//! The C library's memory: allocations and frees of C code, and of the C library itself, which do
//! not use Rust's allocator.
//!
//! glibc lets a program replace these functions, and then calls the replacements too: for example,
//! when the first use of a thread-local with a destructor registers that. These check the call, and
//! pass it on to glibc's own. Aligned allocations are not checked.

use crate::Kind;
use crate::watch::noting;
use libc::{c_void, size_t};

unsafe extern "C" {
    fn __libc_malloc(size: size_t) -> *mut c_void;
    fn __libc_calloc(count: size_t, size: size_t) -> *mut c_void;
    fn __libc_realloc(pointer: *mut c_void, size: size_t) -> *mut c_void;
    fn __libc_free(pointer: *mut c_void);
}

/// # Safety
///
/// That of malloc(3).
#[unsafe(no_mangle)]
unsafe extern "C" fn malloc(bytes: size_t) -> *mut c_void {
    // SAFETY: malloc(3) may be called with any size.
    noting(Kind::Allocation { bytes }, || unsafe {
        __libc_malloc(bytes)
    })
}

/// # Safety
///
/// That of calloc(3).
#[unsafe(no_mangle)]
unsafe extern "C" fn calloc(count: size_t, size: size_t) -> *mut c_void {
    let bytes = count.saturating_mul(size);
    // SAFETY: calloc(3) may be called with any count and size.
    noting(Kind::Allocation { bytes }, || unsafe {
        __libc_calloc(count, size)
    })
}

/// # Safety
///
/// That of realloc(3).
#[unsafe(no_mangle)]
unsafe extern "C" fn realloc(pointer: *mut c_void, bytes: size_t) -> *mut c_void {
    // How much it was only the C library knows.
    // SAFETY: the caller promises null or a live block of the C library's, as realloc(3) requires.
    noting(Kind::Allocation { bytes }, || unsafe {
        __libc_realloc(pointer, bytes)
    })
}

/// # Safety
///
/// That of free(3).
#[unsafe(no_mangle)]
unsafe extern "C" fn free(pointer: *mut c_void) {
    if pointer.is_null() {
        return;
    }
    // SAFETY: the caller promises a live block of the C library's; null has returned above.
    let bytes = unsafe { libc::malloc_usable_size(pointer) };
    // SAFETY: the caller promises a live block of the C library's that it does not use any more.
    noting(Kind::Free { bytes }, || unsafe { __libc_free(pointer) });
}
