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

use super::Emergency;
use super::panics;
use super::watchdog_timer::{self, RouserThread, WatchdogTimer};
use crate::error::{Error, Result};
use crate::safety::state::Cause;
use luna_core::parker::Parker;
use luna_core::path::{self, Call};
use luna_executors::ProcessRegistry;
use luna_platform::crash::{CrashSlot, CrashWatch, MOST_MEMBERS};
use luna_platform::facts::Source;
use luna_platform::shortfall::Shortfall;
use luna_platform::signals::{Listeners, Signal, SignalError, SignalWatch};
use luna_platform::thread::{
    self, Attributes, EMERGENCY_PRIORITY, MINIMUM_STACK_SIZE, Policy, Thread, ThreadNumber,
};
use std::convert::Infallible;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU16, AtomicU32, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

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

/// The workers, as the system sees it. Dropping it ends it.
pub(crate) struct EmergencyThread {
    emergency: Arc<Emergency>,
    living: Arc<ProcessRegistry>,
    policy: Policy,
    threads: Vec<Thread<()>>,
    watchdog_timer: Option<RouserThread>,
    listeners: Option<Listeners>,
    signals: Option<SignalWatch>,
    crash: Option<CrashWatch>,
    /// The machine may move, and it is not confirmed that it came to rest.
    is_armed: bool,
}

impl EmergencyThread {
    /// Starts the workers, at the highest priority if the system is a `real_time` one. They handle
    /// crashes and the signals that ask the program to end. `cores` are those of real-time threads.
    pub(crate) fn start(
        emergency: Arc<Emergency>,
        living: Arc<ProcessRegistry>,
        real_time: bool,
        cores: &[usize],
    ) -> Result<Self> {
        // A platform without signals has the functions all the same, for panics.
        let signals = supported(SignalWatch::install(&[
            Signal::Interrupt,
            Signal::Terminate,
            Signal::Hangup,
        ]))?;
        let crash = supported(CrashWatch::install())?;
        panics::install_hook();
        let workers = &emergency.workers;
        workers
            .hears_signals
            .store(signals.is_some(), Ordering::Relaxed);
        if let Some(crash) = &crash {
            // A system is started once.
            let _ = workers.crash.set(crash.slot());
            emergency.bound_crashes();
        }
        let has_one_core = thread::available_cores().len() == 1;
        let policy = match real_time {
            false => Policy::Other,
            // A function that computes for ever would keep the watching worker from the only core;
            // at equal priority, round robin lets them take turns.
            true if has_one_core => Policy::round_robin(EMERGENCY_PRIORITY),
            true => Policy::fifo(EMERGENCY_PRIORITY),
        };
        let mut all = Self {
            emergency,
            living,
            policy,
            threads: Vec::with_capacity(MOST),
            watchdog_timer: None,
            listeners: Some(Listeners::new()),
            signals,
            crash,
            is_armed: false,
        };
        // All, also where few functions are known: drivers register theirs while the system runs.
        for member in 0..MOST {
            all.add_member(
                member
                    .checked_sub(ON_DUTY as usize)
                    .and_then(|place| cores.get(place)),
            )?;
        }
        let workers = &all.emergency.workers;
        let reserve = all.threads[ON_DUTY as usize..].iter();
        let cores = reserve.map(|thread| {
            let obtained = thread.obtained();
            core_to_take_over(policy, obtained.policy, obtained.core)
        });
        let _ = workers.cores.set(cores.collect());
        // Behind the members, so that the kernel chooses it last for signals.
        let hears_signals = workers.hears_signals.load(Ordering::Relaxed);
        all.watchdog_timer = RouserThread::start(policy, hears_signals)?;
        // To wake others on the same core takes no time, and later they would wait for their turns
        // behind the function.
        let is_better_late =
            !has_one_core && watchdog_timer::wakes_beside_a_function(&Source::machine());
        if let Some(watchdog_timer) = all.watchdog_timer.as_ref().filter(|_| is_better_late) {
            let _ = workers.watchdog_timer.set(watchdog_timer.watchdog_timer());
        }
        Ok(all)
    }

    /// From now on something may move: dropping this without [`stop`](Self::stop) is an emergency.
    pub(crate) fn arm(&mut self) {
        self.is_armed = true;
    }

    fn add_member(&mut self, core: Option<&usize>) -> Result<()> {
        let member = self.threads.len() as u8;
        let mut attributes = Attributes::framework("luna-emergency", self.policy);
        if let Some(&core) = core {
            attributes = attributes.core(core);
        }
        if u32::from(member) >= ON_DUTY {
            attributes = attributes.stack_size(2 * MINIMUM_STACK_SIZE);
        }
        let (emergency, living) = (self.emergency.clone(), self.living.clone());
        let prepared = self.emergency.clone();
        let thread = thread::spawn(
            attributes,
            move |_| {
                let workers = &prepared.workers;
                // Each number is given once.
                let _ = workers.numbers[usize::from(member)].set(thread::current_number());
                workers.members.fetch_add(1, Ordering::Relaxed);
                // A thread's first lock asks the kernel for its number: not in an emergency.
                prepared.bound_crashes();
                Ok::<_, Infallible>(())
            },
            move |()| member::serve(&emergency, member, &living),
        )
        .map_err(|error| Error::not_started("the emergency manager", error))?;
        self.threads.push(thread);
        Ok(())
    }

    /// What was refused to the workers.
    pub(crate) fn shortfalls(&self) -> &[Shortfall] {
        // The others were refused the same.
        let first = self.threads.first();
        first.map_or(&[], |thread| &thread.obtained().shortfalls)
    }

    /// Ends the workers, which run the functions before that if there is an emergency. Returns the
    /// signal that was received, if one came. From then on [`Emergency::is_safe`] is final.
    pub(crate) fn stop(mut self) -> Option<i32> {
        self.is_armed = false;
        self.join();
        self.heard()
    }

    /// The signal that was received before the end was certain.
    fn heard(&self) -> Option<i32> {
        let heard = self.emergency.workers.heard.load(Ordering::Relaxed);
        (heard != 0 && self.emergency.has_begun()).then_some(heard as i32)
    }

    fn join(&mut self) {
        self.emergency.end();
        let workers = &self.emergency.workers;
        workers.call_reserve(0);
        for (member, thread) in self.threads.drain(..).enumerate() {
            // A hung worker is detached: the watching worker may notice only now. No event covers
            // both conditions, and polling is good enough here.
            while !thread.is_finished() && !workers.is_left_behind(member as u8) {
                std::thread::sleep(LOOKS_EVERY);
            }
            if thread.is_finished() {
                // A panic in a function is caught; the thread's own would have been reported by the
                // panic hook.
                let _ = thread.join();
            }
        }
        if let Some(crash) = &self.crash {
            // The program is about to end by the signal, unless the handler that was set before
            // prevents it. It must not exit as if there had been no crash.
            while crash.slot().signal().is_some() {
                std::thread::sleep(LOOKS_EVERY);
            }
        }
        drop(self.listeners.take());
        drop(self.watchdog_timer.take());
        if let Some(signals) = self.signals.take() {
            // A signal that came too late for the functions has the effect that it has after the
            // end.
            signals.give_back(self.heard().is_none());
        }
    }
}

impl Drop for EmergencyThread {
    fn drop(&mut self) {
        if std::mem::take(&mut self.is_armed) {
            // The thread that runs the system panics.
            self.emergency.trigger(Cause::Panic);
        }
        self.join();
    }
}

/// The core that a worker of the reserve can preempt. None if it was refused its core, since it
/// then waits on any core, or its policy, since it would then wait for the thread that calls it.
fn core_to_take_over(asked: Policy, obtained: Policy, core: Option<usize>) -> Option<usize> {
    core.filter(|_| asked.is_real_time() && obtained == asked)
}

fn supported<T>(watch: Result<T, SignalError>) -> Result<Option<T>> {
    match watch {
        Ok(watch) => Ok(Some(watch)),
        Err(SignalError::Unsupported) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_who_has_both_its_policy_and_its_core_takes_it_over() {
        let emergency = Policy::fifo(EMERGENCY_PRIORITY);
        assert_eq!(core_to_take_over(emergency, emergency, Some(1)), Some(1));
        assert_eq!(core_to_take_over(emergency, emergency, None), None);
        for refused in [Policy::Other, Policy::fifo(50)] {
            assert_eq!(core_to_take_over(emergency, refused, Some(1)), None);
        }
        assert_eq!(
            core_to_take_over(Policy::Other, Policy::Other, Some(1)),
            None
        );
    }
}
