//! What the tests share.

#![allow(dead_code, reason = "each test file uses some of it")]

use luna::devices::{DeviceManager, DeviceState};
use luna::{End, System};
use std::io::Write;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc;
use std::sync::{Arc, Once};
use std::time::Duration;

/// Whether the complete platform layer is in use: the portable one cannot wait for files.
pub(crate) const COMPLETE: bool = cfg!(not(luna_portable));

/// Ends the whole program if the calling test is not done after two minutes, with the test's name.
pub(crate) fn watchdog() -> impl Drop {
    struct Watchdog(Option<mpsc::Sender<()>>);
    impl Drop for Watchdog {
        fn drop(&mut self) {
            self.0.take();
        }
    }
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
    let (alive, ended) = mpsc::channel::<()>();
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    std::thread::spawn(move || {
        if ended.recv_timeout(Duration::from_secs(120)) == Err(mpsc::RecvTimeoutError::Timeout) {
            eprintln!("`{test}` hangs");
            std::process::abort();
        }
    });
    Watchdog(Some(alive))
}

/// Says that the calling test, or a part of it, cannot run here.
pub(crate) fn skip(why: &str) {
    let current = std::thread::current();
    // Not by a macro: the harness captures its output.
    let _ = writeln!(
        std::io::stderr(),
        "skipped: {}: {why}",
        current.name().unwrap_or("a test")
    );
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
