//! Threads have no numbers and no priorities here, and no thread is pinned.

use luna_platform::on_drop::OnDrop;
use luna_platform::thread::Policy;

pub(crate) fn current_number() -> i32 {
    0
}

/// Threads have no priorities here.
pub(crate) fn promote(_number: i32, _policy: Policy) {}

/// Threads have no priorities here.
pub(crate) fn demote(_number: i32) {}

/// No thread is pinned, and no signal is blocked.
pub(crate) fn ordinary_child(_command: &mut std::process::Command) {}

/// Threads have no priorities here.
pub(crate) fn above_users() -> OnDrop<impl FnMut()> {
    OnDrop::new(|| ())
}
