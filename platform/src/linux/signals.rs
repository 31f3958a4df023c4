//! Handlers of signals.

use crate::signals::{Noted, Signal, SignalError, note};
use nix::errno::Errno;
use nix::sys::signal as sys;

/// What a signal did before it was watched for.
pub(crate) struct Before {
    signal: Signal,
    action: sys::SigAction,
}

impl Before {
    pub(crate) fn signal(&self) -> Signal {
        self.signal
    }
}

fn sys_signal(signal: Signal) -> sys::Signal {
    match signal {
        Signal::Interrupt => sys::Signal::SIGINT,
        Signal::Terminate => sys::Signal::SIGTERM,
        Signal::Hangup => sys::Signal::SIGHUP,
        Signal::Quit => sys::Signal::SIGQUIT,
        Signal::User1 => sys::Signal::SIGUSR1,
        Signal::User2 => sys::Signal::SIGUSR2,
    }
}

pub(crate) fn number(signal: Signal) -> i32 {
    sys_signal(signal) as i32
}

/// Which signals a thread blocks.
pub(crate) type Mask = sys::SigSet;

fn requests() -> sys::SigSet {
    sys::SigSet::from_iter([
        sys::Signal::SIGINT,
        sys::Signal::SIGTERM,
        sys::Signal::SIGHUP,
    ])
}

/// These fail only for an unknown `how`.
pub(crate) fn accept_here() {
    let _ = sys::pthread_sigmask(sys::SigmaskHow::SIG_UNBLOCK, Some(&requests()), None);
}

pub(crate) fn hold_back() -> Mask {
    let mut before = sys::SigSet::empty();
    let blocks = sys::SigmaskHow::SIG_BLOCK;
    let _ = sys::pthread_sigmask(blocks, Some(&requests()), Some(&mut before));
    before
}

pub(crate) fn set_mask(mask: &Mask) {
    let _ = sys::pthread_sigmask(sys::SigmaskHow::SIG_SETMASK, Some(mask), None);
}

/// A number that no other living thread has, without a system call: where its `errno` is.
pub(crate) fn current_thread() -> usize {
    // SAFETY: it has no precondition. The place is set aside with the thread, so a handler of signals may ask.
    unsafe { nix::libc::__errno_location() }.addr()
}

pub(crate) fn send_to_this_process(number: i32) {
    if let Ok(signal) = sys::Signal::try_from(number) {
        let _ = sys::kill(nix::unistd::getpid(), signal);
    }
}

/// Sets the handler of `signal`.
pub(crate) fn install(signal: Signal) -> Result<Before, SignalError> {
    // Other system calls go on after the handler where they can; the handler runs on an alternative stack if the thread has one.
    let flags = sys::SaFlags::SA_RESTART | sys::SaFlags::SA_ONSTACK;
    let action = sys::SigAction::new(sys::SigHandler::Handler(handle), flags, sys::SigSet::all());
    // SAFETY: `handle` does only what is async-signal-safe.
    let before = unsafe { sys::sigaction(sys_signal(signal), &action) };
    let before = before.map_err(|error| SignalError::Refused {
        signal,
        message: error.to_string(),
    })?;
    let before = Before {
        signal,
        action: before,
    };
    if signal == Signal::Hangup && matches!(before.action.handler(), sys::SigHandler::SigIgn) {
        // `nohup` asked that the program outlive its terminal.
        restore(before);
        return Ok(Before {
            signal,
            action: sys::SigAction::new(sys::SigHandler::SigIgn, flags, sys::SigSet::empty()),
        });
    }
    Ok(before)
}

/// Sets what the signal did before.
pub(crate) fn restore(before: Before) {
    // SAFETY: the action was in place before, so whoever set it answers for it.
    let outcome = unsafe { sys::sigaction(sys_signal(before.signal), &before.action) };
    debug_assert!(
        outcome.is_ok(),
        "a signal that was handled can be handled otherwise: {outcome:?}"
    );
}

/// Runs on whatever thread the kernel picked, in the middle of anything.
extern "C" fn handle(number: i32) {
    // What was interrupted may be about to read its `errno`, which the system call in here changes.
    let errno = Errno::last_raw();
    match note(number) {
        Noted::Event => Errno::set_raw(errno),
        // SAFETY: ends the process without running anything of it.
        Noted::EndNow => unsafe { libc::_exit(128 + number) },
    }
}
