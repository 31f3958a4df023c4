//! Handlers of signals.

use super::crash;
use crate::forked;
use crate::signals::{Signal, SignalError, note};
use nix::errno::Errno;
use nix::libc;
use nix::sys::signal as sys;
use std::mem::MaybeUninit;
use std::ptr;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether a system takes SIGHUP and SIGQUIT. Written when a thread begins to hold requests back.
static TAKES: [(sys::Signal, AtomicBool); 2] = [
    (sys::Signal::SIGHUP, AtomicBool::new(true)),
    (sys::Signal::SIGQUIT, AtomicBool::new(true)),
];

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
        Signal::User1 => sys::Signal::SIGUSR1,
        Signal::User2 => sys::Signal::SIGUSR2,
    }
}

pub(crate) fn number(signal: Signal) -> i32 {
    sys_signal(signal) as i32
}

/// Which signals a thread blocks.
pub(crate) type Mask = sys::SigSet;

/// The signals that ask a program to end, as far as a system handles them.
fn requests() -> sys::SigSet {
    let mut requests = sys::SigSet::from_iter([sys::Signal::SIGINT, sys::Signal::SIGTERM]);
    for (signal, takes) in &TAKES {
        if takes.load(Ordering::Relaxed) {
            requests.add(*signal);
        }
    }
    requests
}

/// Leaves out of the requests what the program ignores or handles itself.
pub(crate) fn find_requests() {
    for (signal, takes) in &TAKES {
        takes.store(is_free(*signal as i32), Ordering::Relaxed);
    }
}

/// The handler of signals that say more than their number.
pub(super) type Handler = extern "C" fn(libc::c_int, *mut libc::siginfo_t, *mut libc::c_void);

/// The default action, without flags.
pub(super) fn default_action() -> libc::sigaction {
    // SAFETY: zeros are a value of each field, and together this action.
    unsafe { MaybeUninit::zeroed().assume_init() }
}

/// Runs `handler`, on the thread's alternative stack if it has one. System calls that can go on
/// after it do.
pub(super) fn action_of_handler(handler: Handler) -> libc::sigaction {
    libc::sigaction {
        sa_sigaction: handler as *const () as libc::sighandler_t,
        sa_flags: libc::SA_SIGINFO | libc::SA_RESTART | libc::SA_ONSTACK,
        ..default_action()
    }
}

/// What `signal` does, or did before it does `new`. `None` if the kernel does not know the signal,
/// or keeps it for itself. Async-signal-safe.
///
/// # Safety
///
/// The handler of `new` is async-signal-safe and has the signature that the flags ask for, or it
/// was set before.
pub(super) unsafe fn exchange_action(
    signal: libc::c_int,
    new: Option<&libc::sigaction>,
) -> Option<libc::sigaction> {
    let mut before = default_action();
    let new = new.map_or(ptr::null(), ptr::from_ref);
    // SAFETY: both live during the call. The caller promises that the handler is async-signal-safe,
    // with the signature that its flags ask for.
    (unsafe { libc::sigaction(signal, new, &raw mut before) } == 0).then_some(before)
}

/// What `signal` does. `None` if the kernel does not know it, or keeps it for itself.
pub(super) fn action_of(signal: libc::c_int) -> Option<libc::sigaction> {
    // SAFETY: it changes nothing.
    unsafe { exchange_action(signal, None) }
}

pub(super) fn set_default(signal: libc::c_int) {
    // SAFETY: the default action runs nothing.
    unsafe { exchange_action(signal, Some(&default_action())) };
}

/// Sends `signal` to the calling thread. Async-signal-safe.
pub(super) fn send_here(signal: libc::c_int) {
    // SAFETY: plain system calls. The thread is there.
    unsafe {
        let thread = libc::syscall(libc::SYS_gettid);
        libc::syscall(libc::SYS_tgkill, libc::getpid(), thread, signal);
    }
}

/// Whether neither the program ignores `signal` nor it has a handler of its own.
fn is_free(signal: libc::c_int) -> bool {
    action_of(signal).is_some_and(|action| {
        action.sa_sigaction == libc::SIG_DFL || is_own(&action) || crash::is_own(&action)
    })
}

/// Whether it is this module's handler that is set.
fn is_own(action: &libc::sigaction) -> bool {
    let own: extern "C" fn(libc::c_int) = handle;
    action.sa_sigaction == own as *const () as usize
}

pub(crate) fn name(number: i32) -> Option<&'static str> {
    let signal = sys::Signal::try_from(number).ok();
    signal.map(sys::Signal::as_str)
}

/// How many places a real-time signal lies above the first one.
pub(crate) fn real_time_number(number: i32) -> Option<i32> {
    let range = libc::SIGRTMIN()..=libc::SIGRTMAX();
    range.contains(&number).then(|| number - libc::SIGRTMIN())
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

/// What a write can raise on the thread that writes.
fn write_signals() -> [sys::Signal; 3] {
    [
        sys::Signal::SIGXFSZ,
        sys::Signal::SIGPIPE,
        sys::Signal::SIGTTOU,
    ]
}

/// Blocks them here; gives the former mask.
pub(crate) fn refuse_write_signals() -> Mask {
    let mut before = sys::SigSet::empty();
    let refused = sys::SigSet::from_iter(write_signals());
    let _ = sys::pthread_sigmask(
        sys::SigmaskHow::SIG_BLOCK,
        Some(&refused),
        Some(&mut before),
    );
    before
}

/// Takes those that are pending for this thread and were not blocked `before`, and sets that mask
/// again.
pub(crate) fn forget_write_signals(before: &Mask) {
    let mut raised = sys::SigSet::empty();
    for signal in write_signals() {
        if !before.contains(signal) {
            raised.add(signal);
        }
    }
    let at_once = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: the set and the time live during the call; no information is asked for. It takes a
    // pending signal, or fails at once.
    while unsafe { libc::sigtimedwait(raised.as_ref(), ptr::null_mut(), &raw const at_once) } > 0 {}
    set_mask(before);
}

/// A number that no other living thread has, without a system call: where its `errno` is.
pub(crate) fn current_thread() -> usize {
    // SAFETY: it has no precondition. The place is allocated with the thread, so a signal handler
    // may call this.
    unsafe { nix::libc::__errno_location() }.addr()
}

/// Whether the program handles it.
pub(crate) fn has_handler(number: i32) -> bool {
    action_of(number)
        .is_some_and(|action| !matches!(action.sa_sigaction, libc::SIG_DFL | libc::SIG_IGN))
}

pub(crate) fn send_to_this_process(number: i32) {
    if let Ok(signal) = sys::Signal::try_from(number) {
        let _ = sys::kill(nix::unistd::getpid(), signal);
    }
}

/// Sets the handler of `signal`; does nothing, and gives nothing, if it is a request that the
/// program ignores or handles itself.
pub(crate) fn install(signal: Signal) -> Result<Option<Before>, SignalError> {
    // SIGINT and SIGTERM are the user's emergency stop: a system takes them in any case.
    let is_needed = matches!(signal, Signal::Interrupt | Signal::Terminate);
    if !is_needed && !is_free(number(signal)) {
        return Ok(None);
    }
    // Other system calls go on after the handler where they can; the handler runs on an alternative
    // stack if the thread has one.
    let flags = sys::SaFlags::SA_RESTART | sys::SaFlags::SA_ONSTACK;
    let action = sys::SigAction::new(sys::SigHandler::Handler(handle), flags, sys::SigSet::all());
    // SAFETY: `handle` does only what is async-signal-safe.
    let before = unsafe { sys::sigaction(sys_signal(signal), &action) };
    match before {
        Ok(action) => Ok(Some(Before { signal, action })),
        Err(error) => Err(SignalError::Refused {
            signal,
            message: error.to_string(),
        }),
    }
}

/// Sets what the signal did before, unless another handler was set since.
pub(crate) fn restore(before: Before) {
    if action_of(number(before.signal)).is_none_or(|action| !is_own(&action)) {
        return;
    }
    // SAFETY: the action was in place before, so its validity is up to the code that set it.
    let outcome = unsafe { sys::sigaction(sys_signal(before.signal), &before.action) };
    debug_assert!(
        outcome.is_ok(),
        "a signal that was handled can be handled otherwise: {outcome:?}"
    );
}

/// Runs on the thread that the kernel picked, at any point of its work.
extern "C" fn handle(number: i32) {
    // What was interrupted may be about to read its `errno`, which the system call in here changes.
    let errno = Errno::last_raw();
    if forked::is_child() {
        // The parent's threads do not exist here: the signal has its default effect as soon as this
        // handler has returned.
        set_default(number);
        send_here(number);
        return Errno::set_raw(errno);
    }
    if note(number) {
        // SAFETY: ends the process without running anything of it.
        unsafe { libc::_exit(128 + number) };
    }
    Errno::set_raw(errno);
}
