//! Emergencies by panics, before anything is printed.
//!
//! The panic hook prints the message, and with `RUST_BACKTRACE=1` a backtrace, which takes a tenth
//! of a second. So the functions begin before that: a hook around the earlier one triggers the
//! emergency. At that instant it is not known whether the body will catch the panic, so a caught
//! panic triggers it too. Code that means to survive a panic declares it beforehand, by
//! [`luna_platform::panics::catch`].

use super::OF_THREAD;
use crate::safety::state::Cause;
use luna_machine::forked;
use luna_platform::panics;
use std::cell::Cell;
use std::panic::{set_hook, take_hook};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How long the hook of before waits for the functions at most: they may wait for what the body
/// holds, and lets go of when it is unwound.
const WAITS: Duration = Duration::from_millis(100);

/// Whether the hook is there.
static IS_INSTALLED: AtomicBool = AtomicBool::new(false);

thread_local! {
    /// The hook has triggered the emergency for a panic on this thread.
    static HAS_RAISED: Cell<bool> = const { Cell::new(false) };
}

/// Lives in the hook, and goes when the program replaces it.
struct Installed;

impl Drop for Installed {
    fn drop(&mut self) {
        IS_INSTALLED.store(false, Ordering::Relaxed);
    }
}

/// Puts the hook around the one that is set, if it is not there already. It stays: on threads
/// without a system it does nothing, and the program may have put another around it.
pub(super) fn install_hook() {
    if std::thread::panicking() || IS_INSTALLED.swap(true, Ordering::Relaxed) {
        return;
    }
    let (before, installed) = (take_hook(), Installed);
    set_hook(Box::new(move |info| {
        let _installed = &installed;
        raise();
        before(info);
    }));
}

/// Triggers the emergency of the panicking thread's system, and lets its functions run before it
/// returns.
fn raise() {
    if panics::are_caught() {
        return;
    }
    // Not there while the thread ends; nothing in here may panic.
    let emergency = OF_THREAD.try_with(|of_thread| of_thread.try_borrow().ok()?.clone());
    let Ok(Some(emergency)) = emergency else {
        return;
    };
    if forked::is_child() {
        return;
    }
    emergency.trigger(Cause::Panic);
    HAS_RAISED.set(true);
    emergency.wait_for_functions(WAITS);
}

/// Whether the hook has triggered the emergency for the panic that is being handled; asked once.
pub(super) fn take_raised() -> bool {
    HAS_RAISED.take()
}
