//! The real-time path, as a test can watch it: where a thread leaves it on purpose, and how the
//! guard in tests (the crate `luna-path-guard`) is notified.
//!
//! [`current::on_path`] says whether a thread is on the path. [`off_path`] leaves it for a while.
//! [`name_process`] reports the name of a process to the guard. [`expected`] names the reason of a
//! system call. The guard is there in builds with `--cfg luna_path_guard` alone; in others these
//! are inlined away.

pub use luna_platform::path::*;

#[cfg(all(luna_path_guard, not(loom)))]
pub use watched::{Watcher, name_process, process_name, watch};

#[cfg(all(luna_path_guard, not(loom)))]
pub(crate) use watched::switched;

use crate::current;
use luna_platform::on_drop::OnDrop;

/// Calls `f` off the real-time path: until it returns, this thread does not count as being on it.
///
/// For intended exceptions to the path's rules: to allocate what it needs before its first cycle,
/// or to print from a process that is alone on a thread without a deadline. It changes nothing
/// about the time that `f` takes: the processes of the same executor wait for it. Memory that is
/// released meanwhile is freed at once. Outside of the path it is a plain call.
///
/// Real-time path: this is how it is left; O(1) apart from `f`. If `f` panics, the thread is on the
/// path again.
///
/// ```
/// use luna_core::{current, path};
///
/// current::set_on_path(true);
/// let room = path::off_path(|| Vec::<u64>::with_capacity(1000));
/// assert!(current::on_path());
/// # current::set_on_path(false);
/// # drop(room);
/// ```
pub fn off_path<R>(f: impl FnOnce() -> R) -> R {
    let before = current::set_on_path(false);
    let _restore = OnDrop::new(|| {
        current::set_on_path(before);
    });
    f()
}

/// Reports a process' name to the guard; without a guard it does nothing.
#[cfg(not(all(luna_path_guard, not(loom))))]
#[inline(always)]
pub fn name_process(_: current::ProcessId, _: &str) {}

/// Notifies the guard that this thread enters or leaves the path; without a guard it does nothing.
#[cfg(not(all(luna_path_guard, not(loom))))]
#[inline(always)]
pub(crate) fn switched(_: bool) {}

#[cfg(all(luna_path_guard, not(loom)))]
mod watched {
    //! The hooks of a path guard: in builds with `--cfg luna_path_guard`.

    use crate::current::{self, ProcessId};
    use alloc::borrow::ToOwned;
    use alloc::collections::BTreeMap;
    use alloc::string::String;
    use luna_platform::lock::PiLock;
    use luna_platform::sync::OnceLock;

    /// A watcher of the path.
    pub trait Watcher: Sync {
        /// This thread enters or leaves the path. Called on the thread itself, while it counts as
        /// off the path.
        fn switched(&self, on_path: bool);
    }

    static WATCHER: OnceLock<&'static dyn Watcher> = OnceLock::new();
    /// Locked off the path alone.
    static NAMES: PiLock<BTreeMap<u32, String>> = PiLock::new(BTreeMap::new());

    /// From now on `watcher` is notified of each thread that enters or leaves the path. The first
    /// watcher stays for good.
    ///
    /// ```
    /// use luna_core::path::{self, Watcher};
    ///
    /// struct Printing;
    /// impl Watcher for Printing {
    ///     fn switched(&self, on_path: bool) {
    ///         println!("on the path: {on_path}");
    ///     }
    /// }
    /// path::watch(&Printing);
    /// luna_core::current::set_on_path(true);
    /// luna_core::current::set_on_path(false);
    /// ```
    pub fn watch(watcher: &'static dyn Watcher) {
        // A second one is ignored: there is one guard.
        let _ = WATCHER.set(watcher);
    }

    /// Notifies the watcher, if there is one.
    pub(crate) fn switched(on_path: bool) {
        if let Some(watcher) = WATCHER.get() {
            watcher.switched(on_path);
        }
    }

    /// Records the name of a process, for reports that know only its id. Allocates, off the path.
    pub fn name_process(process: ProcessId, name: &str) {
        super::off_path(|| NAMES.lock().insert(process.get(), name.to_owned()));
    }

    /// The name of a process. Not for the real-time path.
    ///
    /// ```
    /// use luna_core::{current::ProcessId, path};
    ///
    /// let process = ProcessId::new();
    /// path::name_process(process, "pump");
    /// assert_eq!(path::process_name(process).as_deref(), Some("pump"));
    /// ```
    pub fn process_name(process: ProcessId) -> Option<String> {
        debug_assert!(!current::on_path());
        NAMES.lock().get(&process.get()).cloned()
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use std::panic::catch_unwind;

    #[test]
    fn the_path_is_left_for_a_while_and_found_again() {
        assert!(!off_path(current::on_path));
        assert!(
            !current::on_path(),
            "a thread that was off the path is off it again"
        );
        current::set_on_path(true);
        assert!(!off_path(
            || off_path(current::on_path) || current::on_path()
        ));
        assert!(current::on_path());
        assert!(catch_unwind(|| off_path(|| panic!("on purpose"))).is_err());
        assert!(current::set_on_path(false));
    }
}
