//! The workers' threads: their start and end.

use super::super::panics;
use super::super::watchdog_timer::{self, RouserThread};
use super::{Emergency, LOOKS_EVERY, MOST, ON_DUTY, member};
use crate::error::{Error, Result};
use crate::safety::state::Cause;
use luna_executors::ProcessRegistry;
use luna_platform::crash::CrashWatch;
use luna_platform::facts::Source;
use luna_platform::shortfall::Shortfall;
use luna_platform::signals::{Listeners, Signal, SignalError, SignalWatch};
use luna_platform::thread::{
    self, Attributes, EMERGENCY_PRIORITY, MINIMUM_STACK_SIZE, Policy, Thread,
};
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::Ordering;

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
