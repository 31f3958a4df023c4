//! Work before a signal ends the program: the threads that wait for it are woken, and get a bounded
//! time.
//!
//! The signals are all that end a program by default, except SIGKILL and the
//! [requests](crate::signals) for an orderly end:
//!
//! - SIGSEGV, SIGBUS, SIGFPE, SIGILL and SIGABRT, by which a program crashes;
//! - SIGQUIT, SIGTRAP, SIGSYS, SIGXCPU, SIGXFSZ, SIGALRM, SIGVTALRM, SIGPROF, SIGPIPE, SIGIO,
//!   SIGPWR, SIGUSR1, SIGUSR2, SIGSTKFLT and the real-time signals, where the program neither
//!   ignores them nor has a handler of its own when the first watch is made.
//!
//! They are handled on the [alternate stack](luna_platform::thread) of the thread that crashes, or
//! that the kernel has chosen. The handler is async-signal-safe: it notes the signal, counts an
//! [event](crate::signals::announce_event), and waits until all watches are
//! [done](CrashSlot::announce_done), or their time is over. Then the former handler runs: the
//! standard library's, which reports a stack overflow, or the default, so that the program ends by
//! the signal as it would have without this, with its core dump. If a thread crashes in the work
//! that the others wait for, [`has_crashed`](CrashSlot::has_crashed) reports it.
//!
//! A second signal that is sent to the program while it ends by one has no effect.
//!
//! In the child of a bare `fork` the handler waits for nothing: the threads are the parent's.
//!
//! ```
//! use luna_machine::crash::CrashWatch;
//!
//! match CrashWatch::install() {
//!     Ok(watch) => assert_eq!(watch.slot().signal(), None),
//!     Err(error) => eprintln!("{error}"),
//! }
//! ```

use crate::backend::crash as backend;
use crate::forked;
#[cfg(all(target_os = "linux", not(luna_portable)))]
use crate::signals;
use crate::signals::SignalError;
use crate::threads::ThreadNumber;
#[cfg(all(target_os = "linux", not(luna_portable)))]
use luna_platform::clock::Instant;
use luna_platform::clock::nanos;
use luna_platform::futex::Futex;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// The most watches at a time in one program.
pub const MAX_WATCHES: usize = 64;

/// The maximum number of members of a watch.
pub const MAX_MEMBERS: usize = 9;

/// The signal by which the program ends, 0 for none. Written by handlers; reset only if a former
/// handler has repaired the cause.
static CRASHED: AtomicI32 = AtomicI32::new(0);

/// Counts what handlers wait for.
static DONE: Futex = Futex::new(0);

static SLOTS: [Slot; MAX_WATCHES] = [const { Slot::new() }; MAX_WATCHES];

/// The shared state of one watch and the handlers. Static, so that a handler may read it at any
/// time.
#[derive(Debug)]
struct Slot {
    is_taken: AtomicBool,
    /// Whether a handler is to wait for it. Written by the watch alone.
    is_awaited: AtomicBool,
    bound: AtomicU64,
    /// For each member, the number of the thread that does the awaited work, 0 while it does
    /// nothing; negated if that thread has crashed. Written by the member, and by the handler on
    /// its thread.
    members: [AtomicI32; MAX_MEMBERS],
}

impl Slot {
    const fn new() -> Self {
        Self {
            is_taken: AtomicBool::new(false),
            is_awaited: AtomicBool::new(false),
            bound: AtomicU64::new(0),
            members: [const { AtomicI32::new(0) }; MAX_MEMBERS],
        }
    }
}

/// The number of watches, and the process that they are in.
struct Installed {
    process: u32,
    watches: usize,
}

static INSTALLED: Mutex<Installed> = Mutex::new(Installed {
    process: 0,
    watches: 0,
});

impl Installed {
    /// Forgets the watches of a parent process, which are not in this one.
    fn enter_process(&mut self) {
        let process = std::process::id();
        if self.process == process {
            return;
        }
        if self.watches > 0 {
            backend::restore();
        }
        for slot in &SLOTS {
            slot.is_awaited.store(false, Ordering::Relaxed);
            slot.is_taken.store(false, Ordering::Relaxed);
        }
        CRASHED.store(0, Ordering::Relaxed);
        *self = Installed {
            process,
            watches: 0,
        };
        forked::remember_process();
    }
}

/// While it lives, a crash waits for its holder. Several may live in one program: a crash waits for
/// all, each with its own bound.
#[derive(Debug)]
#[must_use = "a crash ends the program at once again when it is dropped"]
pub struct CrashWatch {
    slot: CrashSlot,
}

/// A watch, for the threads that act on it.
#[derive(Debug, Clone, Copy)]
pub struct CrashSlot(&'static Slot);

impl CrashWatch {
    /// Watches for crashes. Not for the real-time path.
    ///
    /// # Errors
    ///
    /// [`SignalError`] if the system does not let a signal be handled, or has none, or if there are
    /// [`MAX_WATCHES`] watches.
    pub fn install() -> Result<CrashWatch, SignalError> {
        let mut installed = INSTALLED.lock().unwrap_or_else(PoisonError::into_inner);
        installed.enter_process();
        let free = SLOTS
            .iter()
            .find(|slot| !slot.is_taken.load(Ordering::Relaxed));
        let Some(slot) = free else {
            return Err(SignalError::TooMany { most: MAX_WATCHES });
        };
        if installed.watches == 0 {
            backend::install()?;
        }
        installed.watches += 1;
        slot.is_taken.store(true, Ordering::Relaxed);
        slot.bound.store(0, Ordering::Relaxed);
        for member in &slot.members {
            member.store(0, Ordering::Relaxed);
        }
        slot.is_awaited.store(true, Ordering::Release);
        Ok(CrashWatch {
            slot: CrashSlot(slot),
        })
    }

    /// The slot, for the threads that act on a crash.
    pub fn slot(&self) -> CrashSlot {
        self.slot
    }
}

impl Drop for CrashWatch {
    fn drop(&mut self) {
        let mut installed = INSTALLED.lock().unwrap_or_else(PoisonError::into_inner);
        if installed.process != std::process::id() {
            // The watch is a parent's.
            return;
        }
        self.slot.announce_done();
        self.slot.0.is_taken.store(false, Ordering::Relaxed);
        installed.watches -= 1;
        if installed.watches == 0 {
            backend::restore();
        }
    }
}

impl CrashSlot {
    /// The signal by which the program crashes, if it does. An atomic load.
    pub fn signal(self) -> Option<i32> {
        Some(CRASHED.load(Ordering::Acquire)).filter(|&number| number != 0)
    }

    /// The longest time that a crash waits.
    pub fn set_bound(self, bound: Duration) {
        self.0.bound.store(nanos(bound), Ordering::Relaxed);
    }

    /// `member`, which is the calling thread with the number `thread`, begins the work that a crash
    /// waits for. O(1).
    ///
    /// # Panics
    ///
    /// Panics if `member` is not below [`MAX_MEMBERS`].
    pub fn enter(self, member: u8, thread: ThreadNumber) {
        self.0.members[usize::from(member)].store(thread.get(), Ordering::Relaxed);
    }

    /// `member` has ended the work on the calling thread, with the number `thread`. Has no effect
    /// if `member` is another thread by now: a thread that comes after the watch was dropped
    /// changes nothing of a later one. O(1).
    ///
    /// # Panics
    ///
    /// Panics if `member` is not below [`MAX_MEMBERS`].
    pub fn leave(self, member: u8, thread: ThreadNumber) {
        let own = &self.0.members[usize::from(member)];
        // Negated: the thread has gone on after a fault, because of a former handler.
        for number in [thread.get(), -thread.get()] {
            let _ = own.compare_exchange(number, 0, Ordering::Relaxed, Ordering::Relaxed);
        }
    }

    /// Whether `member` has crashed in its work: it will not finish it.
    pub fn has_crashed(self, member: u8) -> bool {
        let thread = self.0.members.get(usize::from(member));
        thread.is_some_and(|thread| thread.load(Ordering::Acquire) < 0)
    }

    /// There is nothing to wait for any more. One system call. Async-signal-safe.
    pub fn announce_done(self) {
        self.0.is_awaited.store(false, Ordering::Release);
        DONE.word().fetch_add(1, Ordering::AcqRel);
        DONE.wake_all();
    }
}

/// Forgets the crash: after [`handle`] the program goes on.
#[cfg(all(target_os = "linux", not(luna_portable)))]
pub(crate) fn forget() {
    CRASHED.store(0, Ordering::Release);
}

/// The handler's work on the thread that crashes, or that the kernel has chosen for a signal that
/// `is_sent`: async-signal-safe, and it returns after a bounded time. Returns whether the program
/// is to end by the signal.
#[cfg(all(target_os = "linux", not(luna_portable)))]
pub(crate) fn handle(number: i32, is_sent: bool) -> bool {
    let began = Instant::now_real();
    // The first crash is the one that is reported; the others wait as it does.
    let noted = CRASHED.compare_exchange(0, number, Ordering::AcqRel, Ordering::Relaxed);
    if noted.is_err() && is_sent {
        // The program ends already, and this thread has not crashed: it may be the one that does
        // the awaited work.
        return false;
    }
    let me = backend::current_thread();
    for member in SLOTS.iter().flat_map(|slot| &slot.members) {
        let _ = member.compare_exchange(me, -me, Ordering::AcqRel, Ordering::Relaxed);
    }
    signals::announce_event();
    for slot in &SLOTS {
        let until = began.plus_nanos(slot.bound.load(Ordering::Relaxed));
        loop {
            let seen = DONE.word().load(Ordering::Acquire);
            if !slot.is_awaited.load(Ordering::Acquire) || Instant::now_real() >= until {
                break;
            }
            DONE.wait(seen, until);
        }
    }
    true
}

// A platform without thread numbers has no crash handling either.
#[cfg(all(test, target_os = "linux", not(luna_portable), not(loom)))]
mod tests {
    use super::*;
    use crate::threads::current_number;

    /// A detached thread ends after its watch, and another watch has the slot.
    #[test]
    fn only_that_has_entered_leaves() {
        static SLOT: Slot = Slot::new();
        let slot = CrashSlot(&SLOT);
        let late = current_number();
        std::thread::spawn(move || {
            let own = current_number();
            slot.enter(0, own);
            slot.leave(0, late);
            assert_eq!(SLOT.members[0].load(Ordering::Relaxed), own.get());
            SLOT.members[0].store(-own.get(), Ordering::Relaxed);
            slot.leave(0, late);
            assert!(slot.has_crashed(0));
            slot.leave(0, own);
            assert!(!slot.has_crashed(0));
            slot.enter(0, own);
            slot.leave(0, own);
            assert_eq!(SLOT.members[0].load(Ordering::Relaxed), 0);
        })
        .join()
        .unwrap();
    }
}
