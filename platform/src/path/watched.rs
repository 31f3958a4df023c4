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
