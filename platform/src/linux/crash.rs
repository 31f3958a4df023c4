//! Handlers of the signals by which a program crashes.

use crate::crash::{forget, handle};
use crate::signals::SignalError;
use nix::errno::Errno;
use nix::libc;
use std::cell::UnsafeCell;
use std::mem::MaybeUninit;
use std::ptr;

const SIGNALS: [libc::c_int; 5] = [
    libc::SIGSEGV,
    libc::SIGBUS,
    libc::SIGFPE,
    libc::SIGILL,
    libc::SIGABRT,
];

/// The place of SIGABRT among them.
const ABORT: usize = 4;

/// What each signal did before.
///
/// # Invariants
///
/// Written only by `install`, which one thread at a time calls, before the handler of that signal is set; read from then on.
struct Before([UnsafeCell<MaybeUninit<libc::sigaction>>; SIGNALS.len()]);

// SAFETY: the invariant: writes come before the system call that sets the handler, which alone reads.
unsafe impl Sync for Before {}

static BEFORE: Before = Before([const { UnsafeCell::new(MaybeUninit::zeroed()) }; SIGNALS.len()]);

type Handler = extern "C" fn(libc::c_int, *mut libc::siginfo_t, *mut libc::c_void);

const HANDLER: Handler = crashed;

pub(crate) fn current_thread() -> i32 {
    nix::unistd::gettid().as_raw()
}

/// Sets the handlers. Called by one thread at a time, when none is set.
pub(crate) fn install() -> Result<(), SignalError> {
    for (index, &signal) in SIGNALS.iter().enumerate() {
        let before = BEFORE.0[index].get().cast::<libc::sigaction>();
        // SAFETY: what was before is read first, into a place that nobody reads before the handler is set.
        let known = Errno::result(unsafe { libc::sigaction(signal, ptr::null(), before) });
        if let Err(error) = known.and_then(|_| set_handler(signal)) {
            SIGNALS[..index].iter().enumerate().for_each(restore_one);
            return Err(SignalError::NoCrashHandler {
                number: signal,
                message: error.to_string(),
            });
        }
    }
    Ok(())
}

fn set_handler(signal: libc::c_int) -> Result<(), Errno> {
    let mut action = MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: all zeros is an action, whose fields are then set.
    let outcome = unsafe {
        let action = action.assume_init_mut();
        action.sa_sigaction = HANDLER as *const () as libc::sighandler_t;
        // On a stack of its own, since the thread's may be used up. A fault while its own signal is blocked ends the program by default.
        action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
        libc::sigemptyset(&raw mut action.sa_mask);
        libc::sigaction(signal, action, ptr::null_mut())
    };
    Errno::result(outcome).map(drop)
}

/// Sets what the signals did before, where nobody has set something else since.
pub(crate) fn restore() {
    SIGNALS.iter().enumerate().for_each(restore_one);
}

fn restore_one((index, &signal): (usize, &libc::c_int)) {
    let mut now = MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: the place is valid to write to; the action of before was in place before, so whoever set it answers for it.
    unsafe {
        let is_known = libc::sigaction(signal, ptr::null(), now.as_mut_ptr()) == 0;
        if is_known && now.assume_init().sa_sigaction == HANDLER as *const () as usize {
            libc::sigaction(signal, BEFORE.0[index].get().cast(), ptr::null_mut());
        }
    }
}

/// Runs on the thread that crashes, in the middle of anything.
extern "C" fn crashed(number: libc::c_int, info: *mut libc::siginfo_t, context: *mut libc::c_void) {
    let errno = Errno::last_raw();
    handle(number);
    Errno::set_raw(errno);
    let Some(index) = SIGNALS.iter().position(|&signal| signal == number) else {
        return;
    };
    // Whoever handled it before may abort, and there may be no room for one more of these on a small stack; what it is for has been done.
    restore_one((ABORT, &SIGNALS[ABORT]));
    // SAFETY: it was written before this handler was set. The kernel's arguments are passed on to whoever would have been given them.
    unsafe {
        let before = *BEFORE.0[index].get().cast::<libc::sigaction>();
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
        if !is_default(number) {
            // Who handled it before has, and the program goes on.
            let _ = set_handler(SIGNALS[ABORT]);
            forget();
            return;
        }
        // What the processor refused is refused again when this returns, now by default. What somebody sent, as `abort` does, is sent again.
        if (*info).si_code <= 0 {
            libc::syscall(
                libc::SYS_tgkill,
                libc::getpid(),
                libc::syscall(libc::SYS_gettid),
                number,
            );
        }
    }
}

fn set_default(number: libc::c_int) {
    // SAFETY: all zeros is the default action without flags.
    unsafe {
        let action = MaybeUninit::<libc::sigaction>::zeroed().assume_init();
        libc::sigaction(number, &raw const action, ptr::null_mut());
    }
}

fn is_default(number: libc::c_int) -> bool {
    let mut now = MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: the place is valid to write to.
    unsafe {
        libc::sigaction(number, ptr::null(), now.as_mut_ptr()) == 0
            && now.assume_init().sa_sigaction == libc::SIG_DFL
    }
}
