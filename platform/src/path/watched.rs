//! What a guard sees of the path: in builds with `--cfg luna_path_guard`.

use super::Call;
use crate::current::{self, ProcessId};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

/// Who watches the path.
pub trait Watcher: Sync {
    /// This thread goes on the path, or off it. Called on the thread itself, while it counts as off the path.
    fn switched(&self, on_path: bool);
}

static WATCHER: OnceLock<&'static dyn Watcher> = OnceLock::new();
/// A plain lock: taken off the path alone.
static NAMES: Mutex<BTreeMap<u32, String>> = Mutex::new(BTreeMap::new());

thread_local! {
    static EXPECTED: Cell<Option<Call>> = const { Cell::new(None) };
}

/// From now on `watcher` is told of each thread that goes on the path or off it. The first one stays for good.
///
/// ```
/// use luna_platform::path::{self, Watcher};
///
/// struct Printing;
/// impl Watcher for Printing {
///     fn switched(&self, on_path: bool) {
///         println!("on the path: {on_path}");
///     }
/// }
/// path::watch(&Printing);
/// luna_platform::current::set_on_path(true);
/// luna_platform::current::set_on_path(false);
/// ```
pub fn watch(watcher: &'static dyn Watcher) {
    // A second one would be as good as the first: there is one guard.
    let _ = WATCHER.set(watcher);
}

/// Tells the watcher, if there is one.
pub(crate) fn switched(on_path: bool) {
    if let Some(watcher) = WATCHER.get() {
        watcher.switched(on_path);
    }
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
    struct Restore(Option<Call>);
    impl Drop for Restore {
        fn drop(&mut self) {
            EXPECTED.set(self.0);
        }
    }
    let _restore = Restore(EXPECTED.replace(Some(call)));
    f()
}

/// Why this thread may make a system call just now, if it may. Async-signal-safe.
pub fn expected_call() -> Option<Call> {
    EXPECTED.get()
}

/// Says how a process is called, for whoever has its number alone. Allocates, off the path.
pub fn name_process(process: ProcessId, name: &str) {
    super::off_path(|| names().insert(process.get(), name.to_owned()));
}

/// How a process is called. Not for the real-time path.
///
/// ```
/// use luna_platform::{current::ProcessId, path};
///
/// let process = ProcessId::new();
/// path::name_process(process, "pump");
/// assert_eq!(path::process_name(process).as_deref(), Some("pump"));
/// ```
pub fn process_name(process: ProcessId) -> Option<String> {
    debug_assert!(!current::on_path());
    names().get(&process.get()).cloned()
}

fn names() -> MutexGuard<'static, BTreeMap<u32, String>> {
    NAMES.lock().unwrap_or_else(PoisonError::into_inner)
}
