//! Ctrl-C ends it, with whole files.

use std::sync::mpsc::Sender;

/// Calls `end` when the program is asked to end. To be called before threads are made.
#[cfg(unix)]
pub(crate) fn notify(end: Sender<()>) {
    use nix::sys::signal::{SigSet, Signal};
    let mut signals = SigSet::empty();
    for signal in [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP] {
        signals.add(signal);
    }
    // Without it a signal ends the program at once, and a file may end in the middle of a block.
    if signals.thread_block().is_err() {
        std::mem::forget(end);
        return;
    }
    std::thread::spawn(move || {
        let _ = signals.wait();
        let _ = end.send(());
        // A second signal means that the disk stalls: exit at once.
        let _ = signals.wait();
        std::process::exit(1);
    });
}

/// Not known on this system: the program ends at once, and a file may end in the middle of a block.
#[cfg(not(unix))]
pub(crate) fn notify(end: Sender<()>) {
    std::mem::forget(end);
}
