//! The threads that wait for an emergency, and run the functions: the workers.
//!
//! | role | thread | file |
//! | --- | --- | --- |
//! | runs the next function | any worker | [`functions`](super::functions) |
//! | leaves behind a worker that hangs | any other on duty | [`functions`](super::functions) |
//! | keeper: takes signals from the emergency's end to the run's | the first that finds the end | [`member`] |
//! | on duty: sleeps until there is an event, such as a signal | two, then more | [`member`] |
//! | in reserve: takes over a core, or the place of one that hangs | the rest | [`member`] |
//! | wakes the watcher when a function may have taken too long | none: the kernel | here |
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
mod threads;

use super::Emergency;
use luna_core::park::Parker;
use luna_machine::alarm::EventAlarm;
use luna_machine::crash::{CrashSlot, MAX_MEMBERS};
use luna_machine::facts::{PreemptionModel, Source};
use luna_machine::signals;
use luna_machine::threads::{ThreadNumber, demote, promote};
use luna_platform::clock::Instant;
use luna_platform::lock::PiLock;
use luna_platform::thread::Policy;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU16, AtomicU32, Ordering};
use std::time::Duration;

pub(crate) use threads::EmergencyThread;

/// How many are on duty from the start: one that runs a function, and one that watches it.
const ON_DUTY: usize = 2;

/// The members. Seven may hang, and the functions of the emergency run on: one runs, and one
/// watches. If that one hangs too, the last worker runs nothing, since nothing would notice that it
/// hangs.
const MAX: usize = MAX_MEMBERS;

/// How much longer a crash waits than the functions may take.
const CRASH_MARGIN: Duration = Duration::from_millis(200);

/// How often a thread that is in no hurry looks whether the functions have run, or the members have
/// ended.
pub(super) const LOOKS_EVERY: Duration = Duration::from_micros(200);

/// What the workers know of each other.
#[derive(Debug, Default)]
pub(super) struct EmergencyWorkers {
    /// How many members were brought on duty, in the order of their numbers, beside those that are
    /// [on duty](ON_DUTY) from the start.
    brought: AtomicU32,
    /// A third was brought on duty for the functions of the safe state.
    has_third: AtomicBool,
    /// What those of the reserve sleep in until they are called. A call that comes before is taken
    /// then.
    parkers: [Parker; MAX],
    /// The core on which each worker of the reserve waits. None for a worker that would not preempt
    /// a core.
    cores: [OnceLock<usize>; MAX],
    /// The policy of the workers on duty.
    policy: OnceLock<Policy>,
    /// The members' numbers in the kernel.
    numbers: [OnceLock<ThreadNumber>; MAX],
    /// Held while a worker takes a function, for a bounded number of steps.
    assigns: PiLock<()>,
    /// A bit for each member that was left behind.
    left_behind: AtomicU16,
    /// How many there are.
    members: AtomicU32,
    hears_signals: AtomicBool,
    /// The member that takes signals when the others have ended, plus one; 0 before.
    keeper: AtomicU32,
    /// The run is over: so is the keeper's work.
    is_released: AtomicBool,
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

    /// Whether `member` is the keeper.
    fn keeps_signals(&self, member: u8) -> bool {
        self.keeper.load(Ordering::Acquire) == u32::from(member) + 1
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
            demote(*number);
        }
        self.bring_on_duty();
    }

    fn is_on_duty(&self, member: u8) -> bool {
        u32::from(member) < ON_DUTY as u32 + self.brought.load(Ordering::Acquire)
    }

    /// The next of the reserve comes on duty, if there is one, and gets the priority for it. Two
    /// system calls.
    fn bring_on_duty(&self) {
        let next = ON_DUTY as u32 + self.brought.fetch_add(1, Ordering::AcqRel);
        let number = self.numbers.get(next as usize).and_then(OnceLock::get);
        // One that took over its core, and was left behind there, was none of those on duty.
        if let Some(number) = number.filter(|_| !self.is_left_behind(next as u8)) {
            // First its priority, so that it runs as soon as it is woken.
            if let Some(policy) = self.policy.get() {
                promote(*number, *policy);
            }
            self.parkers[next as usize].unpark();
        }
    }

    /// Functions of the safe state begin: one more is on duty from now on.
    fn bring_a_third(&self) {
        if !self.has_third.swap(true, Ordering::AcqRel) {
            self.bring_on_duty();
        }
    }
}

/// Whether a timer expires on the core on which a function computes. With PREEMPT_RT a kernel
/// thread of priority 1 handles it, which waits for the function. If the model is not known, it is
/// taken for PREEMPT_RT.
fn wakes_beside_a_function(source: &Source) -> bool {
    PreemptionModel::read(source).is_ok_and(|model| model != PreemptionModel::RealTime)
}

impl EmergencyWorkers {
    /// Makes the alarm of `member`, the calling thread, which is on duty from the start.
    fn make_watch_alarm(&self, member: u8) {
        if let Some(alarm) = EventAlarm::here() {
            // Each member is made once.
            let _ = self.watch_alarms[usize::from(member)].set(alarm);
        }
    }
}

impl Emergency {
    /// `member` is about to call the first function since the trigger; the others may not know of
    /// it. Those on duty are woken at `at`, when one is to check it, or now if they cannot be woken
    /// then.
    ///
    /// Waking a thread on another core costs its waker about 20 µs on a virtual machine, and woken
    /// threads contend for the same locks. So only one worker is woken, by a signal that is handled
    /// on its thread or by a call on its core, and it runs the first function at once. A watcher
    /// has nothing to do before the shortest limit has passed. By then the first worker may compute
    /// for ever, or be stuck in the kernel. So the kernel's timer interrupts a watcher. Where the
    /// timer needs a kernel thread of lower priority than the function, the watchers are woken
    /// before the function begins.
    fn wake_watchers(&self, member: u8, at: Instant) {
        let workers = &self.workers;
        // One that runs a function of the safe state may hang, and one that was left behind may
        // never run again.
        let all_wait = !self.at_safe_state.failover.is_under_way()
            && workers.left_behind.load(Ordering::Acquire) == 0;
        // The alarm of a thread that is stuck in the kernel does not ring.
        let other = &workers.watch_alarms[usize::from(member == 0)];
        if !(all_wait && other.get().is_some_and(|alarm| alarm.arm(at))) {
            signals::announce_event();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn the_alarm_is_left_to_kernels_whose_timers_need_no_thread() {
        let folder = std::env::temp_dir().join(format!("luna-watch-alarm-{}", std::process::id()));
        let source = Source::folder(&folder);
        assert!(!wakes_beside_a_function(&source), "nothing is known");
        for part in ["proc/sys/kernel", "sys/kernel"] {
            fs::create_dir_all(folder.join(part)).unwrap();
        }
        let version = folder.join("proc/sys/kernel/version");
        fs::write(&version, "#1 SMP PREEMPT_DYNAMIC Debian\n").unwrap();
        assert!(wakes_beside_a_function(&source));
        // Either file is enough.
        fs::write(folder.join("sys/kernel/realtime"), "1\n").unwrap();
        assert!(!wakes_beside_a_function(&source));
        fs::write(folder.join("sys/kernel/realtime"), "0\n").unwrap();
        fs::write(&version, "#1 SMP PREEMPT_RT Debian\n").unwrap();
        assert!(!wakes_beside_a_function(&source));
        fs::remove_dir_all(folder).unwrap();
    }
}
