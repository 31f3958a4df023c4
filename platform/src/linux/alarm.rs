//! A POSIX timer of one thread, with a handler of its signal that sets a bit.

use super::clock::timespec;
use super::lock::PiLock;
use super::signals::{action_of, action_of_handler, exchange_action};
use crate::clock::Instant;
use crate::path::{self, Call};
use libc::{c_int, c_void, siginfo_t, timer_t};
use nix::errno::Errno;
use nix::unistd::gettid;
use std::any::Any;
use std::cell::Cell;
use std::marker::PhantomData;
use std::mem::MaybeUninit;
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// What the handler sets.
#[derive(Debug)]
struct Target {
    word: *const AtomicU64,
    bit: u64,
    /// When the handler ran last, in nanoseconds; 0 once that was taken.
    rung: AtomicU64,
}

thread_local! {
    /// What the handler sets on this thread, null without an alarm. It has no destructor, so a
    /// handler can read it at any time; and a thread with a timer has touched it, so reading it
    /// allocates nothing.
    static HERE: Cell<*const Target> = const { Cell::new(ptr::null()) };
}

/// The alarm of the thread that made it.
///
/// # Invariants
///
/// `HERE` of that thread points to `target` as long as this lives; the word is a part of `owner`.
#[derive(Debug)]
pub struct Alarm {
    timer: Timer,
    target: Box<Target>,
    /// Which signals the thread blocked before.
    blocked: libc::sigset_t,
    _owner: Arc<dyn Any + Send + Sync>,
    _stays_on_its_thread: PhantomData<*const ()>,
}

impl Alarm {
    /// An alarm for the calling thread that sets `bit` of a word of `owner`. Nothing if the thread
    /// has one, or the kernel refuses. Not for the real-time path.
    ///
    /// ```
    /// use luna_platform::alarm::Alarm;
    /// use luna_platform::clock::Instant;
    /// use std::sync::Arc;
    /// use std::sync::atomic::{AtomicU64, Ordering};
    ///
    /// let word = Arc::new(AtomicU64::new(0));
    /// if let Some(alarm) = Alarm::new(word.clone(), |word| word, 1) {
    ///     alarm.arm(Instant::now());
    ///     while word.load(Ordering::Relaxed) == 0 {}
    /// }
    /// ```
    pub fn new<T: Send + Sync + 'static>(
        owner: Arc<T>,
        word: impl FnOnce(&T) -> &AtomicU64,
        bit: u64,
    ) -> Option<Alarm> {
        if !HERE.get().is_null() {
            return None;
        }
        let number = signal_number()?;
        let target = Box::new(Target {
            word: word(&owner),
            bit,
            rung: AtomicU64::new(0),
        });
        let timer = Timer::new(number, ptr::null_mut())?;
        let blocked = unblock(number);
        HERE.set(&raw const *target);
        Some(Alarm {
            timer,
            target,
            blocked,
            _owner: owner,
            _stays_on_its_thread: PhantomData,
        })
    }

    /// Sets the bit at `deadline`, which replaces an earlier one; at once if it has passed. `false`
    /// if the kernel refuses. Real-time path: yes; one system call.
    #[must_use = "without an alarm the clock is to be read"]
    pub fn arm(&self, deadline: Instant) -> bool {
        self.timer.arm(deadline)
    }

    /// Disarms the timer: the bit is not set any more. Real-time path: yes; one system call.
    pub fn disarm(&self) {
        // It fails for no timer that exists.
        self.timer.set(0);
    }

    /// When the bit was set last, if that was not taken before. Real-time path: yes; a load and a
    /// store.
    pub fn take_rung(&self) -> Option<Instant> {
        let rung = self.target.rung.load(Ordering::Relaxed);
        (rung != 0).then(|| {
            self.target.rung.store(0, Ordering::Relaxed);
            Instant::from_nanos(rung)
        })
    }
}

impl Drop for Alarm {
    fn drop(&mut self) {
        // A signal that is under way finds nothing to set, also if it comes only when the thread
        // unblocks it.
        HERE.set(ptr::null());
        // SAFETY: the mask was given by the kernel. The timer is deleted next.
        unsafe {
            libc::pthread_sigmask(libc::SIG_SETMASK, &raw const self.blocked, ptr::null_mut());
        }
    }
}

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
    /// use luna_platform::alarm::EventAlarm;
    /// use luna_platform::clock::Instant;
    /// use luna_platform::signals;
    ///
    /// let seen = signals::event_count();
    /// if let Some(alarm) = EventAlarm::here() {
    ///     assert!(alarm.arm(Instant::now()));
    ///     assert_ne!(signals::wait_for_event(seen, Instant::NEVER), seen);
    /// }
    /// ```
    pub fn here() -> Option<EventAlarm> {
        let number = signal_number()?;
        let timer = Timer::new(number, event_mark())?;
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

/// What the signal of an [`EventAlarm`] carries; null is that of an [`Alarm`].
fn event_mark() -> *mut c_void {
    static MARK: u8 = 0;
    (&raw const MARK).cast_mut().cast()
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
    /// A timer of the calling thread that sends it the signal `number` with `mark`.
    fn new(number: c_int, mark: *mut c_void) -> Option<Timer> {
        // SAFETY: zero is a value of each field.
        let mut event: libc::sigevent = unsafe { MaybeUninit::zeroed().assume_init() };
        event.sigev_notify = libc::SIGEV_THREAD_ID;
        event.sigev_signo = number;
        event.sigev_value.sival_ptr = mark;
        event.sigev_notify_thread_id = gettid().as_raw();
        let mut id = ptr::null_mut();
        // SAFETY: both live during the call.
        let outcome =
            unsafe { libc::timer_create(libc::CLOCK_MONOTONIC, &raw mut event, &raw mut id) };
        (outcome == 0).then_some(Timer { id })
    }

    fn arm(&self, at: Instant) -> bool {
        // 0 would disarm.
        self.set(at.as_nanos().max(1))
    }

    /// Sets the instant at which it expires, 0 for never. Returns whether the kernel did.
    fn set(&self, nanos: u64) -> bool {
        let time = libc::itimerspec {
            it_interval: timespec(0),
            it_value: timespec(nanos),
        };
        let (flags, none) = (libc::TIMER_ABSTIME, ptr::null_mut());
        path::expected(Call::ArmTimer, || {
            // SAFETY: the timer exists by the invariant, and the time lives during the call.
            unsafe { libc::timer_settime(self.id, flags, &raw const time, none) == 0 }
        })
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

/// Lets the signal `number` interrupt the calling thread. Gives what it blocked before.
fn unblock(number: c_int) -> libc::sigset_t {
    // SAFETY: both sets live during the calls, and the kernel or the C library writes them before
    // they are read. It fails only for an unknown operation.
    unsafe {
        let mut one = MaybeUninit::uninit();
        let mut before = MaybeUninit::zeroed();
        libc::sigemptyset(one.as_mut_ptr());
        libc::sigaddset(one.as_mut_ptr(), number);
        libc::pthread_sigmask(libc::SIG_UNBLOCK, one.as_ptr(), before.as_mut_ptr());
        before.assume_init()
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

/// The handler. Async-signal-safe: it announces an event, or reads the clock and a thread-local
/// without a destructor, and stores to atomics.
extern "C" fn ring(number: c_int, information: *mut siginfo_t, _: *mut c_void) {
    // SAFETY: with SA_SIGINFO the kernel gives it.
    if unsafe { (*information).si_code } != libc::SI_TIMER {
        // Sent by a program.
        super::crash::take_over(number);
        return;
    }
    // SAFETY: a timer's signal has the value that it was created with.
    if unsafe { (*information).si_value().sival_ptr } == event_mark() {
        // What was interrupted may be about to read its `errno`.
        let errno = Errno::last_raw();
        crate::signals::announce_event();
        return Errno::set_raw(errno);
    }
    // SAFETY: by the alarm's invariant it is null or points to a live target; the handler runs on
    // the thread of the alarm, so the target is not dropped meanwhile.
    if let Some(target) = unsafe { HERE.get().as_ref() } {
        let now = Instant::now_real().as_nanos();
        target.rung.store(now, Ordering::Relaxed);
        // SAFETY: by the alarm's invariant the word is a part of the owner, which the alarm keeps.
        unsafe { &*target.word }.fetch_or(target.bit, Ordering::AcqRel);
    }
}
