//! Which system calls belong to the real-time path.
//!
//! [`expected`] surrounds the few system calls that the path's rules allow, each with its reason
//! ([`Call`]). No other one is made there. A guard holds the path to that in tests (the crate
//! `luna-path-guard`), in builds with `--cfg luna_path_guard`; in others `expected` is a plain call
//! that is inlined away.

#[cfg(all(luna_path_guard, not(loom)))]
pub use watched::{expected, expected_call};

/// Why a system call is made on the real-time path: all that the rules allow there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Call {
    /// To wake a thread that sleeps.
    Wake,
    /// To sleep, or to poll files without sleeping.
    Sleep,
    /// To wait for a contended priority-inheriting lock, or to hand it over.
    Lock,
    /// To revoke the bias of a lock: once in the life of a channel, when another thread first uses
    /// it.
    Fence,
    /// To boost a thread, or to end its boost.
    Boost,
    /// To read or write a file without waiting, or to register what is waited for: only for
    /// processes that use files.
    File,
    /// To read what the kernel has counted of the thread, when a loop begins, a cycle is late or a
    /// budget is overrun. None of these calls waits.
    Account,
}

/// Calls `f`, which makes a system call that the rules allow for the reason `call`.
///
/// ```
/// use luna_platform::path::{self, Call};
///
/// assert_eq!(path::expected(Call::Sleep, || 1 + 1), 2);
/// ```
#[cfg(not(all(luna_path_guard, not(loom))))]
#[inline(always)]
pub fn expected<R>(_: Call, f: impl FnOnce() -> R) -> R {
    f()
}

#[cfg(all(luna_path_guard, not(loom)))]
mod watched {
    //! The reason of the system call that a thread is about to make: in builds with `--cfg
    //! luna_path_guard`.

    use super::Call;
    use crate::on_drop::OnDrop;
    use core::cell::Cell;

    crate::local! {
        static EXPECTED: Cell<Option<Call>> = const { Cell::new(None) };
    }

    /// Calls `f`, which makes a system call that the rules allow for the reason `call`.
    ///
    /// ```
    /// use luna_platform::path::{self, Call};
    ///
    /// let reason = path::expected(Call::Sleep, path::expected_call);
    /// assert_eq!((reason, path::expected_call()), (Some(Call::Sleep), None));
    /// ```
    pub fn expected<R>(call: Call, f: impl FnOnce() -> R) -> R {
        let before = EXPECTED.replace(Some(call));
        let _restore = OnDrop::new(|| EXPECTED.set(before));
        f()
    }

    /// Why this thread may make a system call just now, if it may. Async-signal-safe.
    pub fn expected_call() -> Option<Call> {
        EXPECTED.get()
    }
}
