//! Signals that ask the program to end, as an event that threads can wait for.
//!
//! The handler does no more than a handler may: it stores the signal's number, counts an event, and
//! wakes the threads that wait for one; none if it runs on a waiting thread itself. Other triggers,
//! such as a panic, count events too with [`announce_event`], so one waiting thread is notified of
//! all.
//!
//! ```
//! use luna_platform::clock::Instant;
//! use luna_machine::signals;
//! use std::time::Duration;
//!
//! let seen = signals::event_count();
//! std::thread::spawn(signals::announce_event);
//! assert_ne!(signals::wait_for_event(seen, Instant::now() + Duration::from_secs(10)), seen);
//! ```

use crate::backend::signals as backend;
use crate::event_count::EventCount;
use crate::forked;
use luna_platform::clock::Instant;
use std::fmt;
use std::sync::atomic::{AtomicI32, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// A second signal this long after the first ends the program at once; an earlier one is taken for
/// the same request.
///
/// Some senders deliver twice: coreutils' `timeout` signals its child and then the child's group,
/// both within a millisecond. A human is slower than this.
pub const SAME_REQUEST: Duration = Duration::from_millis(50);

/// The event count: a waiting thread sees a change or is woken.
static EVENTS: EventCount = EventCount::new();

/// The threads that wait for events, as far as there is room: a handler that interrupts one of them
/// has notified it already.
static WAITING: [AtomicUsize; 16] = [const { AtomicUsize::new(0) }; 16];

/// The number of the signal received, 0 for none. Written by the handler (0 to a number) and by the
/// last watch's drop (back to 0).
static RECEIVED: AtomicI32 = AtomicI32::new(0);

/// When it was received, in nanoseconds of the monotonic clock. Written by the handler just after
/// `RECEIVED`, so it may be one signal late for a second handler on another thread: 0 until then,
/// which counts as the same request.
static RECEIVED_AT: AtomicU64 = AtomicU64::new(0);

/// A signal that can be watched for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Signal {
    /// SIGINT: Ctrl-C.
    Interrupt,
    /// SIGTERM: what `kill` sends.
    Terminate,
    /// SIGHUP: the terminal has gone. Left alone where it is ignored already, as under `nohup`, or
    /// where the program has a handler of its own.
    Hangup,
    /// SIGUSR1.
    User1,
    /// SIGUSR2.
    User2,
}

impl Signal {
    /// The signal's number on this system.
    pub fn number(self) -> i32 {
        backend::number(self)
    }
}

impl fmt::Display for Signal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        name(self.number()).fmt(f)
    }
}

/// Shows the signal `number` by its name, such as `SIGTERM` or `SIGRTMIN+3`; by its number if it
/// has none here.
///
/// ```
/// assert_eq!(luna_machine::signals::name(999).to_string(), "signal 999");
/// ```
pub fn name(number: i32) -> impl fmt::Display {
    fmt::from_fn(move |f| {
        if let Some(name) = backend::name(number) {
            return f.write_str(name);
        }
        match backend::real_time_number(number) {
            Some(0) => f.write_str("SIGRTMIN"),
            Some(above) => write!(f, "SIGRTMIN+{above}"),
            None => write!(f, "signal {number}"),
        }
    })
}

/// The handlers that are installed in this process, and the number of watches.
struct Installed {
    /// The process that installed them.
    process: u32,
    watches: usize,
    before: Vec<backend::Before>,
}

static INSTALLED: Mutex<Installed> = Mutex::new(Installed {
    process: 0,
    watches: 0,
    before: Vec::new(),
});

impl Installed {
    /// Forgets the installations of a parent process, which has its watches in another process.
    fn enter_process(&mut self) {
        let process = std::process::id();
        if self.process == process {
            return;
        }
        self.before.drain(..).for_each(backend::restore);
        RECEIVED_AT.store(0, Ordering::Relaxed);
        RECEIVED.store(0, Ordering::Relaxed);
        for place in &WAITING {
            place.store(0, Ordering::Relaxed);
        }
        (self.process, self.watches) = (process, 0);
        forked::remember_process();
    }
}

/// While it lives, signals are events instead of ending the program.
///
/// The first signal is an event: [`received`] returns its number, and the threads
/// that wait for events are woken. A second one, at least [`SAME_REQUEST`] later, ends the program
/// at once with `_exit(128 + number)`: nothing is flushed or dropped.
///
/// Several may live in one process, from several systems: all are notified of a signal. When the
/// last is dropped, the former handlers are restored, and the signal is forgotten. In the child of
/// a bare `fork` a signal has its default effect.
///
/// ```
/// use luna_machine::signals::{Signal, SignalWatch};
///
/// match SignalWatch::install(&[Signal::Interrupt, Signal::Terminate]) {
///     Ok(_watch) => assert_eq!(luna_machine::signals::received(), None),
///     Err(error) => eprintln!("{error}"),
/// }
/// ```
#[derive(Debug)]
#[must_use = "signals end the program again when the last watch is dropped"]
pub struct SignalWatch {
    _private: (),
}

impl SignalWatch {
    /// Watches for `signals`, besides those that other watches asked for. Not for the real-time
    /// path.
    ///
    /// # Errors
    ///
    /// [`SignalError`] if the system does not let a signal be handled, or has none. Nothing has
    /// changed then.
    pub fn install(signals: &[Signal]) -> Result<SignalWatch, SignalError> {
        let mut installed = INSTALLED.lock().unwrap_or_else(PoisonError::into_inner);
        installed.enter_process();
        let already = installed.before.len();
        for &signal in signals {
            if installed
                .before
                .iter()
                .any(|before| before.signal() == signal)
            {
                continue;
            }
            match backend::install(signal) {
                Ok(before) => installed.before.extend(before),
                Err(error) => {
                    installed.before.drain(already..).for_each(backend::restore);
                    return Err(error);
                }
            }
        }
        installed.watches += 1;
        Ok(SignalWatch { _private: () })
    }

    /// Ends the watch. If it was the last, and `again`, a received signal is sent to this process
    /// once more where the program has a handler of its own for it: for a caller that has not acted
    /// on it, since it came too late. Without a handler it would end the program, and what the
    /// caller is about to report would be lost: the caller reports the signal, which is returned.
    /// Not for the real-time path.
    pub fn give_back(self, again: bool) -> Option<i32> {
        let received = self.end();
        std::mem::forget(self);
        if again
            && let Some(number) = received
            && backend::has_handler(number)
        {
            backend::send_to_this_process(number);
        }
        received
    }

    /// Returns the signal that was received, if this was the last watch.
    fn end(&self) -> Option<i32> {
        let mut installed = INSTALLED.lock().unwrap_or_else(PoisonError::into_inner);
        if installed.process != std::process::id() {
            // The watch is a parent's.
            return None;
        }
        installed.watches -= 1;
        if installed.watches > 0 {
            return None;
        }
        // Handlers first: one that still runs then finds the signal taken, or is forgotten with it.
        installed.before.drain(..).for_each(backend::restore);
        RECEIVED_AT.store(0, Ordering::Relaxed);
        Some(RECEIVED.swap(0, Ordering::AcqRel)).filter(|&number| number != 0)
    }
}

impl Drop for SignalWatch {
    fn drop(&mut self) {
        self.end();
    }
}

/// The number of the signal received since the first [`SignalWatch`] was installed, if one was. An
/// atomic load.
pub fn received() -> Option<i32> {
    Some(RECEIVED.load(Ordering::Acquire)).filter(|&number| number != 0)
}

/// Lets SIGINT, SIGTERM, SIGHUP and SIGQUIT be handled on the calling thread, which blocked them
/// since it was [made here](luna_platform::thread): for a thread of high priority that is to hear
/// of them at once. One system call. It leaves out SIGHUP and SIGQUIT where the program handled or
/// ignored them when [`HeldBack`] was made last.
pub fn accept_here() {
    backend::accept_here();
}

/// Blocks them again, so that the kernel chooses another thread. One system call.
pub fn refuse_here() {
    backend::hold_back();
}

/// Blocks what a write can raise on the calling thread, for good: SIGXFSZ (a file beyond
/// `RLIMIT_FSIZE`), SIGPIPE (no reader is left) and SIGTTOU (a terminal that a background program
/// may not write to, which would stop the whole program). The write fails then, or is done
/// (SIGTTOU), and the caller counts the loss. For threads that only look: what they write must not
/// end control. One system call.
///
/// ```
/// luna_machine::signals::refuse_write_signals_here();
/// ```
pub fn refuse_write_signals_here() {
    let _ = backend::refuse_write_signals();
}

/// As [`refuse_write_signals_here`] while `write` runs; what it raised is forgotten. For a thread
/// that is not the framework's own. Some three system calls; not for the real-time path.
///
/// ```
/// use std::io::Write;
/// let written = luna_machine::signals::without_write_signals(|| std::io::stderr().write_all(b""));
/// assert!(written.is_ok());
/// ```
pub fn without_write_signals<T>(write: impl FnOnce() -> T) -> T {
    let before = backend::refuse_write_signals();
    let _back = luna_platform::on_drop::OnDrop::new(|| backend::forget_write_signals(&before));
    write()
}

/// While it lives, the thread that made it blocks SIGINT, SIGTERM, SIGHUP and SIGQUIT, so that
/// another thread takes them: the kernel prefers the main thread to all others, even if it has to
/// wait long for a core. SIGHUP and SIGQUIT stay as they are where the program ignores them or has
/// a handler of its own.
///
/// ```
/// let held = luna_machine::signals::HeldBack::here();
/// drop(held); // one that came meanwhile, and that nobody took, comes now
/// ```
#[derive(Debug)]
#[must_use = "the signals are taken again when it is dropped"]
pub struct HeldBack {
    before: backend::Mask,
    stays_on_its_thread: std::marker::PhantomData<*const ()>,
}

impl HeldBack {
    /// Blocks them here. Not for the real-time path.
    pub fn here() -> HeldBack {
        backend::find_requests();
        HeldBack {
            before: backend::hold_back(),
            stays_on_its_thread: std::marker::PhantomData,
        }
    }
}

impl Drop for HeldBack {
    fn drop(&mut self) {
        backend::set_mask(&self.before);
    }
}

/// Notes the signal `number`. Returns whether it is a second request, which ends the program.
/// Async-signal-safe: atomics, the clock, and one futex wake.
#[cfg(all(target_os = "linux", not(luna_portable)))]
pub(crate) fn note(number: i32) -> bool {
    let now = Instant::now_real();
    // Acquire and release: a thread that sees the number sees what the signal's sender did before,
    // as far as there is an order.
    if RECEIVED
        .compare_exchange(0, number, Ordering::AcqRel, Ordering::Acquire)
        .is_ok()
    {
        RECEIVED_AT.store(now.as_nanos(), Ordering::Relaxed);
        match waits_here() {
            true => EVENTS.announce_here(),
            false => EVENTS.announce(),
        }
        return false;
    }
    match RECEIVED_AT.load(Ordering::Relaxed) {
        0 => false,
        first => now - Instant::from_nanos(first) >= SAME_REQUEST,
    }
}

/// Whether the handler's thread was interrupted while it waits for events. Without thread-local
/// storage, which may allocate if this is part of a library that is loaded late.
#[cfg(all(target_os = "linux", not(luna_portable)))]
fn waits_here() -> bool {
    let me = backend::current_thread();
    let mut waiting = WAITING.iter();
    waiting.any(|thread| thread.load(Ordering::Relaxed) == me)
}

/// Threads that wait for events together. A signal that is handled on one of them while it waits is
/// announced to no other of them: that thread acts on the signal, and wakes the others if they are
/// needed.
#[derive(Debug)]
#[must_use = "its threads may miss signals when it is dropped"]
pub struct Listeners(());

impl Listeners {
    /// Make it before the first of the threads waits, and drop it when the last has. Several may
    /// live at a time, of several systems: then all threads are notified.
    pub fn new() -> Listeners {
        EVENTS.join();
        Listeners(())
    }
}

impl Drop for Listeners {
    fn drop(&mut self) {
        EVENTS.leave();
    }
}

/// The number of events; wraps. Read it before checking the causes of events, and pass it to
/// [`wait_for_event`].
pub fn event_count() -> u32 {
    EVENTS.get()
}

/// Waits until there was an event after `seen` was read, or until `deadline`; returns the present
/// count.
///
/// The same number as `seen` means that the deadline came. One futex wait, and one more for each
/// spurious wake. A signal that is handled on this thread meanwhile is announced to no other thread
/// of its [`Listeners`].
pub fn wait_for_event(seen: u32, deadline: Instant) -> u32 {
    let me = backend::current_thread();
    let free = |place: &&AtomicUsize| {
        let taken = place.compare_exchange(0, me, Ordering::Relaxed, Ordering::Relaxed);
        taken.is_ok()
    };
    let place = WAITING.iter().find(free);
    let count = EVENTS.wait(seen, deadline);
    if let Some(place) = place {
        place.store(0, Ordering::Relaxed);
    }
    count
}

/// Counts an event and wakes the threads that wait for one. One system call. On Linux
/// async-signal-safe.
pub fn announce_event() {
    EVENTS.announce();
}

/// Why a signal cannot be watched for.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SignalError {
    /// The system refused.
    #[error("{signal} cannot be watched for: {message}; see sigaction(2)")]
    Refused {
        /// Which signal.
        signal: Signal,
        /// The system's words.
        message: String,
    },
    /// The system refused the handler of a signal by which programs crash.
    #[error("signal {number} cannot be handled: {message}; see sigaction(2)")]
    NoCrashHandler {
        /// The signal's number.
        number: i32,
        /// The system's words.
        message: String,
    },
    /// There are as many watches for crashes as there may be.
    #[error(
        "there are {most} systems in this program already, which is the most that a crash can wait \
         for: end one first"
    )]
    TooMany {
        /// How many there may be.
        most: usize,
    },
    /// This backend knows no signals.
    #[error(
        "signals cannot be watched for: the portable backend has none; end the system from the \
         program, or run it on Linux, built without `--cfg luna_portable`"
    )]
    Unsupported,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_event_is_seen_by_all_that_wait() {
        let seen = event_count();
        let waiting: Vec<_> = (0..4)
            .map(|_| {
                std::thread::spawn(move || {
                    wait_for_event(seen, Instant::now() + Duration::from_secs(60))
                })
            })
            .collect();
        announce_event();
        for thread in waiting {
            assert_ne!(thread.join().unwrap(), seen);
        }
    }

    #[test]
    fn without_an_event_the_deadline_comes() {
        // Other tests announce events too: then the count has moved.
        let (seen, deadline) = (event_count(), Instant::now() + Duration::from_millis(5));
        let count = wait_for_event(seen, deadline);
        assert!(count != seen || Instant::now() >= deadline);
    }
}
