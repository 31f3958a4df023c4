//! The workers' threads: their start and end.

use super::super::panics;
use super::{Emergency, LOOKS_EVERY, MAX, ON_DUTY, member, wakes_beside_a_function};
use crate::error::{Error, Result};
use crate::safety::state::Cause;
use luna_core::ProcessRegistry;
use luna_machine::crash::CrashWatch;
use luna_machine::facts::Source;
use luna_machine::signals::{self, Listeners, Signal, SignalError, SignalWatch};
use luna_platform::thread::{
    self, Attributes, EMERGENCY_PRIORITY, MINIMUM_STACK_SIZE, Policy, Refusal, Thread,
};
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// The workers, as the system sees it. Dropping it ends it.
pub(crate) struct EmergencyThread {
    emergency: Arc<Emergency>,
    registry: Arc<ProcessRegistry>,
    policy: Policy,
    /// With their numbers as members; those on duty from the start come last.
    threads: Vec<(u8, Thread<()>)>,
    /// The one that takes signals, when the others have ended.
    keeper: Option<Thread<()>>,
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
        registry: Arc<ProcessRegistry>,
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
            registry,
            policy,
            threads: Vec::with_capacity(MAX),
            keeper: None,
            listeners: Some(Listeners::new()),
            signals,
            crash,
            is_armed: false,
        };
        let workers = &all.emergency.workers;
        // A system is started once.
        let _ = workers.policy.set(policy);
        // To wake others on the same core takes no time, and later they would wait for their turns
        // behind the function.
        let is_watched_late = !has_one_core && wakes_beside_a_function(&Source::machine());
        // All, also where few functions are known: drivers register theirs while the system runs.
        // The reserve first, so that those on duty find it.
        for member in (0..MAX).rev() {
            let place = member.checked_sub(ON_DUTY);
            let core = place.and_then(|place| cores.get(place));
            all.add_member(member as u8, core.copied(), is_watched_late)?;
        }
        Ok(all)
    }

    /// From now on something may move: dropping this without [`stop`](Self::stop) is an emergency.
    pub(crate) fn arm(&mut self) {
        self.is_armed = true;
    }

    fn add_member(&mut self, member: u8, core: Option<usize>, is_watched_late: bool) -> Result<()> {
        let is_on_duty = usize::from(member) < ON_DUTY;
        let policy = match core {
            None if !is_on_duty => Policy::Other,
            _ => self.policy,
        };
        let mut attributes = Attributes::framework("luna-emergency", policy);
        if let Some(core) = core {
            attributes = attributes.core(core);
        }
        if !is_on_duty {
            attributes = attributes.stack_size(2 * MINIMUM_STACK_SIZE);
        }
        let (emergency, registry) = (self.emergency.clone(), self.registry.clone());
        let prepared = self.emergency.clone();
        let thread = thread::spawn(
            attributes,
            move |obtained| {
                let workers = &prepared.workers;
                // Each number is given once.
                let _ = workers.numbers[usize::from(member)]
                    .set(luna_machine::threads::current_number());
                if is_on_duty && is_watched_late {
                    workers.make_watch_alarm(member);
                }
                if !is_on_duty {
                    workers.wait_on_core(member, policy, obtained);
                }
                workers.members.fetch_add(1, Ordering::Relaxed);
                // A thread's first lock asks the kernel for its number: not in an emergency.
                prepared.bound_crashes();
                Ok::<_, Infallible>(())
            },
            move |()| member::serve(&emergency, member, &registry),
        )
        .map_err(|error| Error::not_started("the emergency manager", error))?;
        self.threads.push((member, thread));
        Ok(())
    }

    /// What was refused to the workers.
    pub(crate) fn shortfalls(&self) -> &[Refusal] {
        // The others on duty were refused the same.
        let last = self.threads.last();
        last.map_or(&[], |(_, thread)| &thread.obtained().refusals)
    }

    /// Ends the workers, which run the functions before that if there is an emergency. Returns the
    /// signal that was received, if one came. From then on [`Emergency::is_safe`] is final. One
    /// thread takes signals until this is dropped.
    pub(crate) fn stop(&mut self) -> Option<i32> {
        self.is_armed = false;
        self.join();
        self.heard()
    }

    /// The signal that was received too late for the functions, if one was: the run is to return
    /// soon. [`finish`](Self::finish) has the final one.
    pub(crate) fn late_signal(&self) -> Option<i32> {
        let is_watched = self.signals.is_some() && self.heard().is_none();
        is_watched.then(signals::received).flatten()
    }

    /// The signal that was received before the end was certain.
    fn heard(&self) -> Option<i32> {
        let heard = self.emergency.workers.heard.load(Ordering::Relaxed);
        (heard != 0 && self.emergency.has_begun()).then_some(heard as i32)
    }

    fn join(&mut self) {
        self.emergency.end();
        let workers = &self.emergency.workers;
        for parker in &workers.parkers {
            parker.unpark();
        }
        for (member, thread) in self.threads.drain(..) {
            // A hung worker is detached: the watching worker may notice only now. No event covers
            // all conditions, and polling is good enough here.
            while !thread.is_finished()
                && !workers.is_left_behind(member)
                && !workers.keeps_signals(member)
            {
                std::thread::sleep(LOOKS_EVERY);
            }
            if workers.keeps_signals(member) {
                self.keeper = Some(thread);
            } else if thread.is_finished() {
                // A panic in a function is caught; the thread's own would have been reported by the
                // panic hook.
                let _ = thread.join();
            }
        }
        // From now on there is nothing that a crash would have to wait for.
        if let Some(crash) = self.crash.take() {
            // The program is about to end by the signal, unless the handler that was set before
            // prevents it. It must not exit as if there had been no crash.
            while crash.slot().signal().is_some() {
                std::thread::sleep(LOOKS_EVERY);
            }
        }
    }

    /// Ends all that takes signals. Returns the [late signal](Self::late_signal), which is final.
    pub(crate) fn finish(mut self) -> Option<i32> {
        self.release()
    }

    /// Ends the keeper, and the watch. Returns the late signal, once.
    fn release(&mut self) -> Option<i32> {
        let seen = self.late_signal();
        self.emergency
            .workers
            .is_released
            .store(true, Ordering::Release);
        signals::announce_event();
        if let Some(keeper) = self.keeper.take() {
            let _ = keeper.join();
        }
        drop(self.listeners.take());
        let is_late = self.heard().is_none();
        // A handler of the program's own hears of a signal that came too late.
        let taken = self.signals.take()?.give_back(is_late);
        // Other systems of the program may watch on: then none was taken.
        taken.filter(|_| is_late).or(seen)
    }
}

impl Drop for EmergencyThread {
    fn drop(&mut self) {
        if std::mem::take(&mut self.is_armed) {
            // The thread that runs the system panics.
            self.emergency.trigger(Cause::Panic);
        }
        self.join();
        self.release();
    }
}

fn supported<T>(watch: Result<T, SignalError>) -> Result<Option<T>> {
    match watch {
        Ok(watch) => Ok(Some(watch)),
        Err(SignalError::Unsupported) => Ok(None),
        Err(error) => Err(error.into()),
    }
}
