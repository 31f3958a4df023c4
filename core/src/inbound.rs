//! Wakes from other threads: how they notify an executor, and how the executor goes to sleep
//! without missing a wake.
//!
//! [RemoteWakes](crate::remote_wakes) hold which process was woken at which level. One word of
//! signals holds the levels that have a woken process, so that a high wake never waits behind low
//! ones:
//!
//! ```text
//!   waker                               owner
//!   1 mark the slot                     a take what the signals ask for; queue empty?
//!   2 set the level's bit      <----->  b add ASLEEP to its own bits in one step: fails if any
//!                                         other bit is set
//!   3 it was ASLEEP? ring               c wait for the bell
//!                                       d clear ASLEEP; a again
//! ```
//!
//! The owner's own bits, `DEADLINE` and `FILES`, prevent no sleep.
//!
//! All of 2, b and d are read-modify-write operations on the one word, so they have one order:
//! either 2 comes before b, which then fails, or the waker sees `ASLEEP` and rings. Every waker
//! that sees it rings, not only the first: the first may be preempted before it rings, and a more
//! urgent one must not have to wait for it. While the owner is awake no waker makes a system call.
//! [`Bell`] documents how it wakes a sleeper.

use crate::quiescence::Quiescence;
use crate::remote_wakes::{FirstSlots, RemoteWakes, WakeSlot};
use crate::spin;
use core::time::Duration;
use luna_platform::bell::Bell;
use luna_platform::clock::Instant;
use luna_platform::sync::atomic::{AtomicU64, Ordering};

/// Set while the owner sleeps or is about to. Bits 0 to 31 are the levels.
const ASLEEP: u64 = 1 << 32;
/// Set to make the owner look beyond its queues: at processes to start, or at the request to stop.
const ATTENTION: u64 = 1 << 33;
/// Set to make the owner look at its deadlines: by the owner itself, or by its alarm's thread. It
/// does not prevent the owner from sleeping; its sleep ends at the next deadline anyway.
const DEADLINE: u64 = 1 << 34;
/// Set from the owner's first wait for a file on: it looks at its files between two polls. As
/// `DEADLINE`, it prevents no sleep.
const FILES: u64 = 1 << 35;
/// What the owner sets for itself.
const OWN: u64 = DEADLINE | FILES;

/// What waits outside, as read at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Signals(u64);

impl Signals {
    /// The highest level that has a woken process.
    #[inline]
    pub(crate) fn highest_level(self) -> Option<u8> {
        let levels = self.0 as u32;
        (levels != 0).then(|| (31 - levels.leading_zeros()) as u8)
    }

    /// Whether attention was requested.
    #[inline]
    pub(crate) fn attention(self) -> bool {
        self.0 & ATTENTION != 0
    }

    /// Whether the owner is to look at its deadlines.
    #[inline]
    pub(crate) fn deadline(self) -> bool {
        self.0 & DEADLINE != 0
    }

    /// Whether no bit is set. Never again once the owner has waited for a file: `FILES` stays set.
    #[inline]
    pub(crate) fn is_empty(self) -> bool {
        self.0 == 0
    }
}

/// The signals, the first wake slots, and the bell: what a wake from another core changes, on one
/// line of memory that holds nothing else. (A line is 64 bytes; two that lie side by side are
/// fetched together on many processors.)
#[derive(Debug)]
#[repr(C, align(128))]
pub(crate) struct Inbound {
    signals: AtomicU64,
    bell: Bell,
    pub(crate) first: FirstSlots,
}

// The portable futex is larger than a word.
#[cfg(all(target_os = "linux", not(luna_portable), not(loom)))]
const _: () = assert!(core::mem::offset_of!(Inbound, first) + size_of::<FirstSlots>() <= 64);

impl Inbound {
    pub(crate) fn new() -> Self {
        Self {
            signals: AtomicU64::new(0),
            bell: Bell::new(),
            first: FirstSlots::new(),
        }
    }

    /// Wakes the process that has `slot`, a wake slot of this executor, at `level`, from any
    /// thread. Wait-free: two or three instructions; a system call only if the owner sleeps.
    #[inline]
    pub(crate) fn wake(&self, slot: &WakeSlot, level: u8) {
        slot.mark(&self.first, level);
        self.signal(1 << level);
    }

    /// Makes the owner look at what is beside its queues.
    pub(crate) fn ask_attention(&self) {
        self.signal(ATTENTION);
    }

    #[inline]
    fn signal(&self, bit: u64) {
        if self.signals.fetch_or(bit, Ordering::AcqRel) & ASLEEP != 0 {
            self.bell.ring();
        }
    }

    /// What the owner sleeps in.
    #[inline]
    pub(crate) fn bell(&self) -> &Bell {
        &self.bell
    }

    /// What waits outside. One load; owner only.
    #[inline]
    pub(crate) fn signals(&self) -> Signals {
        // An owner that looks is awake, so no bit of its sleep is set.
        Signals(self.signals.load(Ordering::Relaxed))
    }

    /// Answers a request for attention: one that comes after this is a new one. Owner only.
    pub(crate) fn take_attention(&self) {
        self.signals.fetch_and(!ATTENTION, Ordering::AcqRel);
    }

    /// Takes all processes of `remote_wakes`, those of this executor, that were woken at `level`.
    /// O(their number); owner only.
    pub(crate) fn take<T: Copy>(
        &self,
        level: u8,
        remote_wakes: &RemoteWakes<T>,
        woken: impl FnMut(T),
    ) {
        // Clear the level's bit first: a waker that marks its slot after the look sets the bit
        // again.
        self.signals.fetch_and(!(1 << level), Ordering::AcqRel);
        remote_wakes.take(&self.first, level, woken);
    }

    /// As [`ask_look`](Self::ask_look), by the thread of the owner's alarm, once the alarm has
    /// noted that it rings. It does not wake an owner that sleeps. An owner that takes the bit back
    /// sees what was noted: so the bit is set also where it seems to be set.
    pub(crate) fn ring(&self) {
        self.signals.fetch_or(DEADLINE, Ordering::AcqRel);
    }

    /// Makes the owner look at its deadlines before it polls. Owner only.
    pub(crate) fn ask_look(&self) {
        if self.signals.load(Ordering::Relaxed) & DEADLINE == 0 {
            self.signals.fetch_or(DEADLINE, Ordering::AcqRel);
        }
    }

    /// Makes the owner look at its files from now on. Owner only.
    pub(crate) fn ask_for_files(&self) {
        self.signals.fetch_or(FILES, Ordering::AcqRel);
    }

    /// The owner looks at its deadlines no more, until it is asked to again. Owner only.
    pub(crate) fn take_look(&self) {
        self.signals.fetch_and(!DEADLINE, Ordering::AcqRel);
    }

    /// Whether another thread has woken a process or made a request that the owner has not taken.
    /// From any thread.
    pub(crate) fn is_signalled(&self) -> bool {
        // Acquire: a thread that sees that the owner has taken it sees what the owner did before.
        self.signals.load(Ordering::Acquire) & !(ASLEEP | OWN) != 0
    }

    /// Polls for `time` until a signal arrives, `deadline` passes, or `also` has something; returns
    /// whether one of them occurred. Owner only, in place of a sleep: other threads see the owner
    /// as awake until then.
    #[inline]
    pub(crate) fn spin(
        &self,
        time: Duration,
        deadline: Instant,
        mut also: impl FnMut() -> bool,
    ) -> bool {
        spin::until(|| self.is_signalled() || also(), time, deadline)
    }

    /// Sleeps until a signal arrives or `deadline` passes; returns at once if a signal is pending.
    /// Owner only. May return without a cause.
    pub(crate) fn sleep(&self, deadline: Instant) {
        self.sleep_between(deadline, || (), || ());
    }

    /// As `sleep`, with nothing that ends it but a signal; the owner is still meanwhile, and
    /// `ring`s if it is watched.
    pub(crate) fn sleep_quiescent(&self, quiescence: &Quiescence, ring: impl FnOnce()) {
        self.sleep_between(
            Instant::NEVER,
            || {
                if quiescence.become_quiescent() {
                    ring();
                }
            },
            || quiescence.wake(),
        );
    }

    /// The owner, which has other event sources beside this, is about to sleep in a wait that each
    /// signalling thread rings. Returns `false` if any bit is set, also one of the owner's own: for
    /// the stage of a simulation, whose executors do not set these. Owner only; an
    /// [`awake`](Self::awake) follows.
    pub(crate) fn fall_asleep(&self) -> bool {
        self.signals
            .compare_exchange(0, ASLEEP, Ordering::AcqRel, Ordering::Relaxed)
            .is_ok()
    }

    /// The owner is awake again. Owner only, after [`fall_asleep`](Self::fall_asleep).
    pub(crate) fn awake(&self) {
        self.signals.fetch_and(!ASLEEP, Ordering::AcqRel);
    }

    /// Sleeps. `before` runs when other threads see the sleep already, and `after` when their
    /// signals are not taken yet.
    #[inline]
    fn sleep_between(&self, deadline: Instant, before: impl FnOnce(), after: impl FnOnce()) {
        self.bell.quiet();
        let own = self.signals.load(Ordering::Relaxed) & OWN;
        if self
            .signals
            .compare_exchange(own, own | ASLEEP, Ordering::AcqRel, Ordering::Relaxed)
            .is_ok()
        {
            before();
            // The owner looks again, for any cause of the end.
            self.bell.wait(deadline);
            after();
            self.signals.fetch_and(!ASLEEP, Ordering::AcqRel);
        }
    }
}
