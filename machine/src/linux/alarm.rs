//! A POSIX timer of one thread, with a handler of its signal that announces an event.
//!
//! The signal is a real-time signal that had no handler when the first alarm was made: the highest
//! such number below `SIGRTMAX`. The handler stays for the program's life. System calls that can be
//! restarted are restarted (`SA_RESTART`).

use super::signals::{action_of, action_of_handler, exchange_action};
use luna_platform::clock::Instant;
use luna_platform::lock::PiLock;
use nix::errno::Errno;
use nix::libc::{self, c_int, c_void, siginfo_t, timer_t};
use nix::unistd::gettid;
use std::mem::MaybeUninit;
use std::ptr;

/// A timer that announces an [event](crate::signals::announce_event), by interrupting the thread
/// that made it.
#[derive(Debug)]
pub struct EventAlarm {
    timer: Timer,
}

impl EventAlarm {
    /// An alarm that interrupts the calling thread, which hears its signal from now on. Nothing if
    /// the kernel refuses. Not for the real-time path.
    ///
    /// ```
    /// use luna_machine::alarm::EventAlarm;
    /// use luna_platform::clock::Instant;
    /// use luna_machine::signals;
    ///
    /// let seen = signals::event_count();
    /// if let Some(alarm) = EventAlarm::here() {
    ///     assert!(alarm.arm(Instant::now()));
    ///     assert_ne!(signals::wait_for_event(seen, Instant::NEVER), seen);
    /// }
    /// ```
    pub fn here() -> Option<EventAlarm> {
        let number = signal_number()?;
        let timer = Timer::new(number)?;
        unblock(number);
        Some(EventAlarm { timer })
    }

    /// Announces an event at `at`, which replaces an earlier instant; at once if it has passed. By
    /// any thread. `false` if the kernel refuses. One system call.
    #[must_use = "without an alarm the event is to be announced now"]
    pub fn arm(&self, at: Instant) -> bool {
        self.timer.arm(at)
    }
}

/// A timer of the kernel.
///
/// # Invariants
///
/// `id` was created, and is deleted when this is dropped.
#[derive(Debug)]
struct Timer {
    id: timer_t,
}

// SAFETY: the kernel's name of a timer; any thread of the program may set and delete it.
unsafe impl Send for Timer {}
// SAFETY: setting it is one system call, which the kernel orders with others.
unsafe impl Sync for Timer {}

impl Timer {
    /// A timer of the calling thread that sends it the signal `number`.
    fn new(number: c_int) -> Option<Timer> {
        // SAFETY: zero is a value of each field.
        let mut event: libc::sigevent = unsafe { MaybeUninit::zeroed().assume_init() };
        event.sigev_notify = libc::SIGEV_THREAD_ID;
        event.sigev_signo = number;
        event.sigev_notify_thread_id = gettid().as_raw();
        let mut id = ptr::null_mut();
        // SAFETY: both live during the call.
        let outcome =
            unsafe { libc::timer_create(libc::CLOCK_MONOTONIC, &raw mut event, &raw mut id) };
        (outcome == 0).then_some(Timer { id })
    }

    /// Sets the instant at which it expires. Returns whether the kernel did.
    fn arm(&self, at: Instant) -> bool {
        let time = libc::itimerspec {
            it_interval: timespec(0),
            // 0 would disarm.
            it_value: timespec(at.as_nanos().max(1)),
        };
        let (flags, none) = (libc::TIMER_ABSTIME, ptr::null_mut());
        // SAFETY: the timer exists by the invariant, and the time lives during the call.
        unsafe { libc::timer_settime(self.id, flags, &raw const time, none) == 0 }
    }
}

impl Drop for Timer {
    fn drop(&mut self) {
        // A child of a bare `fork` has no timers of its parent.
        if !crate::forked::is_child() {
            // SAFETY: by the invariant it exists.
            unsafe { libc::timer_delete(self.id) };
        }
    }
}

/// An instant as the kernel takes absolute ones.
fn timespec(nanos: u64) -> libc::timespec {
    libc::timespec {
        tv_sec: (nanos / 1_000_000_000) as libc::time_t,
        tv_nsec: (nanos % 1_000_000_000) as libc::c_long,
    }
}

/// Lets the signal `number` interrupt the calling thread.
fn unblock(number: c_int) {
    // SAFETY: the set lives during the calls, and the C library writes it before it is read. It
    // fails only for an unknown operation.
    unsafe {
        let mut one = MaybeUninit::uninit();
        libc::sigemptyset(one.as_mut_ptr());
        libc::sigaddset(one.as_mut_ptr(), number);
        libc::pthread_sigmask(libc::SIG_UNBLOCK, one.as_ptr(), ptr::null_mut());
    }
}

/// The signal of all alarms, with the handler. Nothing if all real-time signals have handlers of
/// others. The handlers of signals that end a program are set after it, so that they leave it one.
pub(super) fn signal_number() -> Option<c_int> {
    static CHOSEN: PiLock<Option<c_int>> = PiLock::new(None);
    let own = action_of_handler(ring);
    let mut chosen = CHOSEN.lock();
    // Another part of the program may have taken it since.
    if let Some(number) = *chosen
        && action_of(number)?.sa_sigaction == own.sa_sigaction
    {
        return *chosen;
    }
    // From above, since programs count theirs from `SIGRTMIN`. The last one is Valgrind's.
    *chosen = (libc::SIGRTMIN()..libc::SIGRTMAX()).rev().find(|&number| {
        let is_free = |before: libc::sigaction| before.sa_sigaction == libc::SIG_DFL;
        if !action_of(number).is_some_and(is_free) {
            return false;
        }
        // SAFETY: `ring` is async-signal-safe.
        match unsafe { exchange_action(number, Some(&own)) } {
            Some(before) if !is_free(before) => {
                // Another thread has just taken it.
                // SAFETY: it was set before.
                unsafe { exchange_action(number, Some(&before)) };
                false
            }
            outcome => outcome.is_some(),
        }
    });
    *chosen
}

/// The handler. Async-signal-safe: it announces an event.
extern "C" fn ring(number: c_int, information: *mut siginfo_t, _: *mut c_void) {
    // SAFETY: with SA_SIGINFO the kernel gives it.
    if unsafe { (*information).si_code } != libc::SI_TIMER {
        // Sent by a program.
        super::crash::take_over(number);
        return;
    }
    // What was interrupted may be about to read its `errno`.
    let errno = Errno::last_raw();
    crate::signals::announce_event();
    Errno::set_raw(errno);
}
