//! The hooks of a path guard: in builds with `--cfg luna_path_guard`.

use crate::current::{self, ProcessId};
use alloc::borrow::ToOwned;
use alloc::collections::BTreeMap;
use alloc::string::String;
use luna_platform::lock::PiLock;
use luna_platform::sync::OnceLock;

/// A watcher of the path.
pub trait Watcher: Sync {
    /// This thread enters or leaves the path. Called on the thread itself, while it counts as off
    /// the path.
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
