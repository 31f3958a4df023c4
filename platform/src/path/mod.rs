//! The real-time path, as a test can watch it: where it is left on purpose, and which system calls belong to it.
//!
//! [`current::on_path`] says whether a thread is on the path. What this room adds is for a guard that holds the path to
//! its rules in tests (the crate `luna-path-guard`):
//!
//! - [`off_path`] leaves the path for a while, on purpose and said so.
//! - [`expected`] surrounds the few system calls that the rules allow, each with its reason ([`Call`]). No other one is made on the path.
//! - [`name_process`] tells the guard how a process is called.
//!
//! The guard is there in builds with `--cfg luna_path_guard` alone. In others `expected` is a plain call and `name_process` nothing: they are
//! inlined away.

#[cfg(all(luna_path_guard, not(loom)))]
mod watched;

#[cfg(all(luna_path_guard, not(loom)))]
pub use watched::{Watcher, expected, expected_call, name_process, process_name, watch};

#[cfg(all(luna_path_guard, not(loom)))]
pub(crate) use watched::switched;

use crate::current;

/// Why a system call is made on the real-time path: all that the rules allow there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Call {
    /// To wake a thread that sleeps.
    Wake,
    /// To sleep, or to look at files without sleeping.
    Sleep,
    /// To arm or disarm a timer: that of a loop, or the [alarm](crate::alarm) of an executor that is busy when its earliest deadline changes.
    ArmTimer,
    /// To wait for a contended priority-inheriting lock, or to hand it over.
    Lock,
    /// To end the favour of a [`HomeLock`](crate::home_lock::HomeLock): once in the life of a channel that another thread comes to.
    Fence,
    /// To lend a thread a priority, or to give it back.
    Boost,
    /// To read or write a file that does not wait, or to say what it is waited for: for those processes alone that work on files.
    File,
    /// To read what the kernel has counted of the thread, when a loop begins, a cycle is late or a budget is overrun. None of these calls waits.
    Account,
}

/// Calls `f` off the real-time path: until it returns, this thread says of itself that it is not on it.
///
/// For what a process does on purpose although the path's rules forbid it: to allocate what it needs before its first cycle, or to print from a
/// process that is alone on a thread without a deadline. It changes nothing about the time that `f` takes: the processes of the same executor wait
/// for it. What is let go of meanwhile is freed at once. Outside of the path it is a plain call.
///
/// Real-time path: this is how it is left; O(1) apart from `f`. If `f` panics, the thread is on the path again.
///
/// ```
/// use luna_platform::{current, path};
///
/// current::set_on_path(true);
/// let room = path::off_path(|| Vec::<u64>::with_capacity(1000));
/// assert!(current::on_path());
/// # current::set_on_path(false);
/// # drop(room);
/// ```
pub fn off_path<R>(f: impl FnOnce() -> R) -> R {
    struct Restore(bool);
    impl Drop for Restore {
        fn drop(&mut self) {
            current::set_on_path(self.0);
        }
    }
    let _restore = Restore(current::set_on_path(false));
    f()
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

/// Tells the guard how a process is called: nothing without one.
#[cfg(not(all(luna_path_guard, not(loom))))]
#[inline(always)]
pub fn name_process(_: current::ProcessId, _: &str) {}

/// Tells the guard that this thread goes on the path or off it: nothing without one.
#[cfg(not(all(luna_path_guard, not(loom))))]
#[inline(always)]
pub(crate) fn switched(_: bool) {}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use std::panic::catch_unwind;

    #[test]
    fn the_path_is_left_for_a_while_and_found_again() {
        assert!(!off_path(current::on_path));
        assert!(!current::on_path(), "who was not on it is not after");
        current::set_on_path(true);
        assert!(!off_path(
            || off_path(current::on_path) || current::on_path()
        ));
        assert!(current::on_path());
        assert!(catch_unwind(|| off_path(|| panic!("on purpose"))).is_err());
        assert!(current::set_on_path(false));
    }
}
