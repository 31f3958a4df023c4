//! What the tests share.

#![allow(dead_code, unused_imports, reason = "each test file uses some of it")]

#[path = "../../../../tests/shared/mod.rs"]
mod shared;
#[path = "../../../../tests/shared/spawn.rs"]
mod spawn;

use luna::devices::{DeviceManager, DeviceState};
use luna::{End, System};
pub(crate) use shared::{Random, seed, skip};
pub(crate) use spawn::SpawnOk;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Once};

/// Whether the complete platform layer is in use: the portable one cannot wait for files.
pub(crate) const COMPLETE: bool = cfg!(not(luna_portable));

/// The shared watchdog. Panics of emergency functions are not reported.
pub(crate) fn watchdog() -> shared::Watchdog {
    static QUIET: Once = Once::new();
    QUIET.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            // Some functions fail here on purpose, and a backtrace takes longer than their limit.
            if std::thread::current().name() != Some("luna-emergency") {
                before(panic);
            }
        }));
    });
    shared::watchdog()
}

/// A watchdog; none where the platform layer cannot wait for files, which is reported.
pub(crate) fn with_files() -> Option<shared::Watchdog> {
    if !COMPLETE {
        skip("the portable layer cannot wait for files");
        return None;
    }
    Some(watchdog())
}

/// A function for emergencies, and how often it ran.
pub(crate) fn counter() -> (Arc<AtomicU32>, impl FnMut() + Send + 'static) {
    let count = Arc::new(AtomicU32::new(0));
    let own = count.clone();
    (count, move || {
        own.fetch_add(1, Ordering::Relaxed);
    })
}

/// Runs the system to the loss of its only device: an emergency, after which the device is closed.
/// Returns the error.
#[track_caller]
pub(crate) fn run_to_loss(system: &System, devices: &DeviceManager) -> String {
    let error = system.run().unwrap_err().to_string();
    assert_eq!(system.report().unwrap().end, End::Emergency, "{error}");
    let about = &devices.list()[0];
    assert!(about.loss.is_some(), "{about:?}");
    assert_eq!((about.state, about.users), (DeviceState::Closed, 0));
    error
}
