//! The reason of the system call that a thread is about to make: in builds with `--cfg
//! luna_path_guard`.

use super::Call;
use std::cell::Cell;

thread_local! {
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
