//! Handlers of the signals that end the program by the signal itself.

use super::signals::{
    Handler, action_of, action_of_handler, default_action, exchange_action, send_here, set_default,
};
use crate::crash::{forget, handle};
use crate::forked;
use crate::signals::SignalError;
use nix::errno::Errno;
use nix::libc;
use std::cell::UnsafeCell;
use std::mem::MaybeUninit;
use std::ptr;

/// The faults of a program. A former handler runs afterwards.
const FAULTS: [libc::c_int; 5] = [
    libc::SIGSEGV,
    libc::SIGBUS,
    libc::SIGFPE,
    libc::SIGILL,
    libc::SIGABRT,
];

/// The other signals that end a program by default: they are handled where they would, and left
/// alone where the program ignores them or has a handler of its own. The real-time signals belong
/// to them. SIGINT, SIGTERM and SIGHUP ask for an orderly end, and are handled elsewhere.
const OTHERS: &[libc::c_int] = &[
    libc::SIGQUIT,
    libc::SIGTRAP,
    libc::SIGSYS,
    libc::SIGXCPU,
    libc::SIGXFSZ,
    libc::SIGALRM,
    libc::SIGVTALRM,
    libc::SIGPROF,
    libc::SIGPIPE,
    libc::SIGIO,
    libc::SIGPWR,
    libc::SIGUSR1,
    libc::SIGUSR2,
    #[cfg(not(any(
        target_arch = "mips",
        target_arch = "mips64",
        target_arch = "mips32r6",
        target_arch = "mips64r6",
        target_arch = "sparc",
        target_arch = "sparc64"
    )))]
    libc::SIGSTKFLT,
];

/// One more than the highest signal's number, on all of Linux' processors.
const NUMBERS: usize = 129;

/// What each signal did before, by its number.
///
/// # Invariants
///
/// Written only by `install`, which one thread at a time calls, before the handler of that signal
/// is set; read from then on.
struct Before([UnsafeCell<MaybeUninit<libc::sigaction>>; NUMBERS]);

// SAFETY: by the invariant writes come before the system call that sets the handler, which alone
// reads.
unsafe impl Sync for Before {}

static BEFORE: Before = Before([const { UnsafeCell::new(MaybeUninit::zeroed()) }; NUMBERS]);

const HANDLER: Handler = crashed;

pub(crate) fn current_thread() -> i32 {
    nix::unistd::gettid().as_raw()
}

/// All that may be handled here.
fn signals() -> impl Iterator<Item = libc::c_int> {
    let others = OTHERS.iter().copied().chain(real_time());
    FAULTS.into_iter().chain(others)
}

/// Without those that the C library keeps for itself.
fn real_time() -> impl Iterator<Item = libc::c_int> {
    libc::SIGRTMIN()..=libc::SIGRTMAX().min(NUMBERS as i32 - 1)
}

/// Sets the handlers. Called by one thread at a time, when none is set.
pub(crate) fn install() -> Result<(), SignalError> {
    // Without a free signal executors would read the clock before each poll.
    super::alarm::signal_number();
    for signal in signals() {
        if let Err(error) = install_one(signal) {
            // Valgrind and emulators keep real-time signals for themselves: no program sends those.
            if real_time().any(|one| one == signal) {
                continue;
            }
            restore();
            return Err(SignalError::NoCrashHandler {
                number: signal,
                message: error.to_string(),
            });
        }
    }
    Ok(())
}

/// Handles a signal that was sent to the program, and not by a timer, as one that ends it: for the
/// handler of the alarms; their signal is left out above. Async-signal-safe.
pub(super) fn take_over(signal: libc::c_int) {
    // SAFETY: zeros are the default action, which was in place before the alarms' handler. Threads
    // that come here at once write the same.
    unsafe {
        set_default(signal);
        if action_of(libc::SIGSEGV).is_some_and(|action| is_own(&action)) {
            before_of(signal).write(default_action());
            // It fails for no signal that exists.
            let _ = set_handler(signal);
        }
        libc::kill(libc::getpid(), signal);
    }
}

fn install_one(signal: libc::c_int) -> Result<(), Errno> {
    let before = action_of(signal).ok_or_else(Errno::last)?;
    let is_free = before.sa_sigaction == libc::SIG_DFL || is_own(&before);
    if !is_free && !FAULTS.contains(&signal) {
        return Ok(());
    }
    // It may be set already: a library found it as the former action and has put it back since.
    // Then what was before it is known.
    if !is_own(&before) {
        // SAFETY: the handler of this signal is not set, so by the invariant no handler reads the
        // place.
        unsafe { before_of(signal).write(before) };
    }
    set_handler(signal)
}

/// Where the action of before is kept.
fn before_of(signal: libc::c_int) -> *mut libc::sigaction {
    BEFORE.0[signal as usize].get().cast()
}

fn set_handler(signal: libc::c_int) -> Result<(), Errno> {
    // It runs on a stack of its own, since the thread's may be used up. A fault while its own
    // signal is blocked ends the program by default. SAFETY: it is async-signal-safe up to the
    // former handler, which runs as it would without this one.
    let before = unsafe { exchange_action(signal, Some(&action_of_handler(HANDLER))) };
    before.map(drop).ok_or_else(Errno::last)
}

/// Whether it is this module's handler that is set.
pub(super) fn is_own(action: &libc::sigaction) -> bool {
    action.sa_sigaction == HANDLER as *const () as usize
}

/// Restores the former actions, except where another one was set since.
pub(crate) fn restore() {
    signals().for_each(restore_one);
}

fn restore_one(signal: libc::c_int) {
    if action_of(signal).is_some_and(|now| is_own(&now)) {
        // SAFETY: the former action was in place before, so its validity is up to the code that set
        // it. It was written before the handler was set.
        unsafe { libc::sigaction(signal, before_of(signal), ptr::null_mut()) };
    }
}

/// Whether the signal came from elsewhere, and the thread that handles it is as good as any other.
/// What a thread sends to itself, as `abort` does, is its own.
fn is_sent(number: libc::c_int, code: libc::c_int) -> bool {
    let by_processor = [libc::SIGTRAP, libc::SIGSYS];
    let may_be_own = FAULTS.contains(&number) || by_processor.contains(&number);
    code != libc::SI_TKILL && (code <= 0 || !may_be_own)
}

/// Runs on the thread that crashes, or on the one that the kernel has chosen, in the middle of
/// anything.
extern "C" fn crashed(number: libc::c_int, info: *mut libc::siginfo_t, context: *mut libc::c_void) {
    let errno = Errno::last_raw();
    // In a child the parent's threads are not there, and what they would do is the parent's.
    let is_child = forked::is_child();
    // SAFETY: the kernel gives the handler a valid place.
    let code = unsafe { (*info).si_code };
    let ends = is_child || handle(number, is_sent(number, code));
    Errno::set_raw(errno);
    if !ends {
        return;
    }
    // The former handler may abort, and a small stack may have no room for another frame of this
    // handler; its work is done.
    restore_one(libc::SIGABRT);
    // SAFETY: it was written before this handler was set. The kernel's arguments are passed on
    // unchanged to the former handler.
    unsafe {
        let before = *before_of(number);
        match before.sa_sigaction {
            libc::SIG_DFL | libc::SIG_IGN => set_default(number),
            address if before.sa_flags & libc::SA_SIGINFO != 0 => {
                let handler: Handler = std::mem::transmute::<usize, Handler>(address);
                handler(number, info, context);
            }
            address => {
                let handler = std::mem::transmute::<usize, extern "C" fn(libc::c_int)>(address);
                handler(number);
            }
        }
        if action_of(number).is_none_or(|now| now.sa_sigaction != libc::SIG_DFL) {
            // The former handler has returned, and the program goes on.
            let _ = set_handler(libc::SIGABRT);
            if !is_child {
                forget();
            }
            return;
        }
        // An instruction that the processor refused is refused again when this returns, now by
        // default, and with a core dump. All other signals are sent again, since they would not
        // come again by themselves.
        let is_refused_again = code > 0 && FAULTS.contains(&number);
        if !is_refused_again {
            send_here(number);
        }
    }
}
