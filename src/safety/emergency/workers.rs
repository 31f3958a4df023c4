//! The threads that wait for an emergency, and run the functions.
//!
//! Three are on duty: one may run a function of the emergency and one a function of the safe state
//! at the same time, and the third checks that none takes too long. The rest is a reserve: one of
//! it comes on duty for each worker that hangs. All are made before the start, and have a stack
//! that is in memory.
//!
//! Waking a thread on another core takes long on a virtual machine. So the reserve waits on the
//! cores of the system's real-time threads, one worker on each: a trigger on such a core calls that
//! worker, which preempts the core and runs the functions. A signal that is handled on the thread
//! of a worker on duty wakes no other thread. The worker that begins in this way has the others
//! [woken by the timer](super::watchdog_timer) when they are to watch it.

mod member;
mod threads;

use super::Emergency;
use super::watchdog_timer::WatchdogTimer;
use luna_core::parker::Parker;
use luna_core::path::{self, Call};
use luna_platform::crash::{CrashSlot, MOST_MEMBERS};
use luna_platform::thread::{self, EMERGENCY_PRIORITY, ThreadNumber};
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU16, AtomicU32, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

pub(crate) use threads::EmergencyThread;

/// How many are on duty: one for each kind of functions, and one that watches both.
const ON_DUTY: u32 = 3;

/// The members. Seven may hang: before the last of them is left behind, there are two that run and
/// one that watches.
const MOST: usize = MOST_MEMBERS;

/// How much longer a crash waits than the functions may take.
const CRASH_MARGIN: Duration = Duration::from_millis(200);

/// How often a thread that is in no hurry looks whether the functions have run, or the members have
/// ended.
pub(super) const LOOKS_EVERY: Duration = Duration::from_micros(200);

/// What the workers know of each other.
#[derive(Debug)]
pub(super) struct EmergencyWorkers {
    /// Members with a lower number are on duty.
    on_duty: AtomicU32,
    /// What those of the reserve sleep in; of the others' nothing is used.
    parker: [Parker; MOST],
    /// The core on which each worker of the reserve waits. None for a worker that would not preempt
    /// a core.
    cores: OnceLock<Vec<Option<usize>>>,
    /// The members' numbers in the kernel.
    numbers: [OnceLock<ThreadNumber>; MOST],
    /// A bit for each member that was left behind.
    left_behind: AtomicU16,
    /// How many there are.
    members: AtomicU32,
    hears_signals: AtomicBool,
    /// The signal that was received, 0 for none.
    heard: AtomicU32,
    /// The signal by which the program crashes, 0 for none.
    heard_crash: AtomicI32,
    /// The crash was noted.
    has_noted: AtomicBool,
    /// That the functions have run was announced.
    has_announced: AtomicBool,
    crash: OnceLock<CrashSlot>,
    /// Wakes the other workers when the first function has begun. None where they are better woken
    /// before.
    watchdog_timer: OnceLock<Arc<WatchdogTimer>>,
}

impl Default for EmergencyWorkers {
    fn default() -> Self {
        Self {
            on_duty: AtomicU32::new(ON_DUTY),
            parker: [const { Parker::new() }; MOST],
            cores: OnceLock::new(),
            numbers: [const { OnceLock::new() }; MOST],
            left_behind: AtomicU16::new(0),
            members: AtomicU32::new(0),
            hears_signals: AtomicBool::new(false),
            heard: AtomicU32::new(0),
            heard_crash: AtomicI32::new(0),
            has_noted: AtomicBool::new(false),
            has_announced: AtomicBool::new(false),
            crash: OnceLock::new(),
            watchdog_timer: OnceLock::new(),
        }
    }
}

impl EmergencyWorkers {
    /// Whether there is a worker to run the functions.
    pub(super) fn serves(&self) -> bool {
        self.members.load(Ordering::Relaxed) > 0
    }

    /// How long all functions may take together: so long a crash waits for them.
    pub(super) fn bound_crashes(&self, limits: Duration) {
        if let Some(crash) = self.crash.get() {
            crash.set_bound(limits.saturating_add(CRASH_MARGIN));
        }
    }

    fn is_left_behind(&self, member: u8) -> bool {
        self.left_behind.load(Ordering::Acquire) & 1 << member != 0
    }

    /// Another member hangs: it goes on at low priority if it ever does, and one of the reserve
    /// takes its place.
    fn leave_behind(&self, member: u8) {
        self.left_behind.fetch_or(1 << member, Ordering::AcqRel);
        if let Some(number) = self.numbers[usize::from(member)].get() {
            thread::demote(*number);
        }
        self.call_reserve(1);
    }

    fn is_on_duty(&self, member: u8) -> bool {
        u32::from(member) < self.on_duty.load(Ordering::Acquire)
    }

    /// So many more are on duty.
    fn call_reserve(&self, more: u32) {
        self.on_duty.fetch_add(more, Ordering::AcqRel);
        for parker in &self.parker[ON_DUTY as usize..] {
            // A busy worker checks before it sleeps.
            parker.call();
        }
    }

    /// Calls the worker that waits on this core, if there is one. Returns whether it comes.
    pub(super) fn call_here(&self) -> bool {
        let place = self.cores.get().and_then(|cores| {
            let here = Some(thread::current_core()?);
            cores.iter().position(|&core| core == here)
        });
        place.is_some_and(|place| {
            // One of the same priority, such as a function of another system, does not give way,
            // nor does a thread with a deadline.
            path::expected(Call::Wake, thread::current_policy).rank() < EMERGENCY_PRIORITY
                && self.parker[ON_DUTY as usize + place].call()
        })
    }
}
