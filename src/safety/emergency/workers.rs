//! The threads that wait for an emergency, and run the functions: the workers.
//!
//! | role | thread | file |
//! | --- | --- | --- |
//! | runs the next function | any worker | [`functions/runner`](super::functions) |
//! | leaves behind a worker that hangs | any other on duty | [`functions/watcher`](super::functions) |
//! | on duty: sleeps until there is an event, such as a signal | two, then more | [`member`] |
//! | in reserve: takes over a core, or the place of one that hangs | the rest | [`reserve`] |
//! | wakes the watcher when a function may have taken too long | none: the kernel | [`watch_alarm`] |
//! | start and end | the one in `System::run` | [`threads`] |
//!
//! Two are on duty from the start: one runs a function, and the other one checks that it does not
//! take too long. A third comes when functions of the safe state run, so that an emergency finds
//! one; and one for each worker that hangs. All are made before the start and have a stack that is
//! in memory, since a crashed or hung thread may hold the allocator's lock. Only those that must
//! run at once have the highest priority from the start: those on duty, and those of the reserve
//! that wait on the core of a real-time thread. The others are ordinary threads until they come on
//! duty.

mod member;
mod reserve;
mod threads;
mod watch_alarm;

use super::Emergency;
use luna_platform::alarm::EventAlarm;
use luna_platform::crash::{CrashSlot, MAX_MEMBERS};
use luna_platform::thread::{self, ThreadNumber};
use reserve::Reserve;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU16, AtomicU32, Ordering};
use std::time::Duration;

pub(crate) use threads::EmergencyThread;

/// How many are on duty from the start: one that runs a function, and one that watches it.
const ON_DUTY: usize = 2;

/// The members. Seven may hang: before the last of them is left behind, there are two that run and
/// one that watches.
const MAX: usize = MAX_MEMBERS;

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
    /// A third was brought on duty for the functions of the safe state.
    has_third: AtomicBool,
    reserve: Reserve,
    /// The members' numbers in the kernel.
    numbers: [OnceLock<ThreadNumber>; MAX],
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
    /// Those of the members that are on duty from the start; none where the watcher is better woken
    /// before the first function.
    watch_alarms: [OnceLock<EventAlarm>; ON_DUTY],
}

impl Default for EmergencyWorkers {
    fn default() -> Self {
        Self {
            on_duty: AtomicU32::new(ON_DUTY as u32),
            has_third: AtomicBool::new(false),
            reserve: Reserve::default(),
            numbers: [const { OnceLock::new() }; MAX],
            left_behind: AtomicU16::new(0),
            members: AtomicU32::new(0),
            hears_signals: AtomicBool::new(false),
            heard: AtomicU32::new(0),
            heard_crash: AtomicI32::new(0),
            has_noted: AtomicBool::new(false),
            has_announced: AtomicBool::new(false),
            crash: OnceLock::new(),
            watch_alarms: [const { OnceLock::new() }; ON_DUTY],
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

    /// How many do not hang.
    fn able(&self) -> u32 {
        MAX as u32 - self.left_behind.load(Ordering::Acquire).count_ones()
    }

    /// Another member hangs: it goes on at low priority if it ever does, and one of the reserve
    /// takes its place.
    fn leave_behind(&self, member: u8) {
        self.left_behind.fetch_or(1 << member, Ordering::AcqRel);
        if let Some(number) = self.numbers[usize::from(member)].get() {
            thread::demote(*number);
        }
        self.bring_on_duty();
    }

    fn is_on_duty(&self, member: u8) -> bool {
        u32::from(member) < self.on_duty.load(Ordering::Acquire)
    }

    /// The next of the reserve comes on duty, if there is one.
    fn bring_on_duty(&self) {
        let next = self.on_duty.fetch_add(1, Ordering::AcqRel);
        let number = self.numbers.get(next as usize).and_then(OnceLock::get);
        // One that took over its core, and was left behind there, was none of those on duty.
        if let Some(number) = number.filter(|_| !self.is_left_behind(next as u8)) {
            self.reserve.summon(next as usize, *number);
        }
    }

    /// Functions of the safe state begin: one more is on duty from now on.
    fn bring_a_third(&self) {
        if !self.has_third.swap(true, Ordering::AcqRel) {
            self.bring_on_duty();
        }
    }
}
