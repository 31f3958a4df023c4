//! What a worker does: run the functions, watch the worker that runs one, and take signals.

use super::super::functions::{Assignment, Functions, Moment, Task};
use super::{Emergency, EmergencyWorkers};
use crate::safety::state::Cause;
use luna_core::ProcessRegistry;
use luna_core::path::{self, Call};
use luna_machine::failover::{FailoverSequence, Leg};
use luna_machine::signals;
use luna_platform::clock::Instant;
use luna_platform::thread::{self, EMERGENCY_PRIORITY, Obtained, Policy};
use std::sync::atomic::Ordering;

impl EmergencyWorkers {
    /// The kernel may choose the calling thread for signals, which waits on duty.
    fn accept_signals(&self) {
        if self.hears_signals.load(Ordering::Relaxed) {
            signals::accept_here();
        }
    }

    /// The kernel may not choose the calling thread any more: one that runs a function may hang, or
    /// be left behind with the lowest priority, and the user's code need not know of interrupted
    /// calls. One that watches takes them; there always is one.
    fn refuse_signals(&self) {
        if self.hears_signals.load(Ordering::Relaxed) {
            signals::refuse_here();
        }
    }
}

impl EmergencyWorkers {
    /// The emergency's work is over. The first member that comes here takes signals on, until the
    /// run is over: a sink that stalls may hold up the run, which looks for them, and a second one
    /// ends the program.
    fn keep_signals(&self, member: u8) {
        let own = u32::from(member) + 1;
        let taken = self
            .keeper
            .compare_exchange(0, own, Ordering::AcqRel, Ordering::Relaxed);
        if taken.is_err() {
            return;
        }
        self.accept_signals();
        loop {
            let seen = signals::event_count();
            if self.is_released.load(Ordering::Acquire) {
                return;
            }
            signals::wait_for_event(seen, Instant::NEVER);
        }
    }
}

/// The life of a member.
pub(super) fn serve(emergency: &Emergency, member: u8, registry: &ProcessRegistry) {
    let workers = &emergency.workers;
    let _clock = emergency.clock().enter();
    let is_wanted = || workers.is_on_duty(member) || emergency.is_to_end.load(Ordering::Acquire);
    while !is_wanted() {
        workers.parkers[usize::from(member)].park(Instant::NEVER);
        // Called on its core: what is there to be run. Those on duty see that it does not take too
        // long.
        if work(emergency, member, registry).is_none() {
            return;
        }
    }
    // A watching worker must not wait for the core of a function that computes for ever.
    thread::unpin_current();
    workers.accept_signals();
    loop {
        let seen = signals::event_count();
        let Some(until) = work(emergency, member, registry) else {
            return;
        };
        if emergency.may_end() {
            return workers.keep_signals(member);
        }
        signals::wait_for_event(seen, until);
    }
}

/// Does what there is to do now. Returns the instant until which there is nothing more to do. None:
/// another worker has taken over, and this thread has a low priority by now.
fn work(emergency: &Emergency, member: u8, registry: &ProcessRegistry) -> Option<Instant> {
    let workers = &emergency.workers;
    loop {
        emergency.hear();
        if emergency.is_safe() {
            announce(emergency, registry);
        }
        match step(emergency, member) {
            Task::Ran(true) if workers.is_on_duty(member) => workers.accept_signals(),
            Task::Ran(true) => {}
            Task::Ran(false) => return None,
            Task::LeftBehind(other) => workers.leave_behind(other),
            Task::Until(until) => {
                // The rest may have been given up.
                if emergency.is_safe() {
                    announce(emergency, registry);
                }
                return Some(until);
            }
        }
    }
}

/// Announces once that the functions have run.
fn announce(emergency: &Emergency, registry: &ProcessRegistry) {
    let workers = &emergency.workers;
    let is_first = !workers.has_announced.swap(true, Ordering::AcqRel);
    if let Some(crash) = workers.crash.get().filter(|_| is_first) {
        crash.announce_done();
    }
    let crash = workers.heard_crash.load(Ordering::Relaxed);
    if crash != 0 && !workers.has_noted.swap(true, Ordering::AcqRel) {
        // The crashed thread may hold the journal, and releases it only now, if at all.
        emergency.note_crash(crash);
    }
    if is_first {
        registry.announce();
    }
}

/// Does one thing that is to be done now; the emergency comes first.
fn step(emergency: &Emergency, member: u8) -> Task {
    let crash = emergency.workers.crash.get();
    let has_crashed = |member: u8| crash.is_some_and(|crash| crash.has_crashed(member));
    let around = |moment, is_announced: bool| match moment {
        Moment::Begins(look) => {
            if is_announced {
                emergency.workers.bring_a_third();
            }
            emergency.workers.refuse_signals();
            let number = emergency.workers.numbers[usize::from(member)].get();
            if let Some((crash, number)) = crash.zip(number) {
                crash.enter(member, *number);
            }
            // Behind the signals: one that this thread has taken before is soon known to the
            // others.
            if let Some(at) = look.filter(|_| !is_announced) {
                emergency.wake_watchers(member, at);
            }
        }
        Moment::Ended => {
            let number = emergency.workers.numbers[usize::from(member)].get();
            if let Some((crash, number)) = crash.zip(number) {
                crash.leave(member, *number);
            }
        }
    };
    let mut until = Instant::NEVER;
    // The safe state always wakes all workers on duty, so that its functions are watched: the
    // alarms belong to the emergency.
    for (functions, is_announced) in [
        (&emergency.at_emergency, false),
        (&emergency.at_safe_state, true),
    ] {
        let duty = emergency.duty(functions, member);
        match functions.step(duty, has_crashed, |moment| around(moment, is_announced)) {
            Task::Until(at) => until = until.min(at),
            done => return done,
        }
    }
    Task::Until(until)
}

/// Whether a function of the emergency may begin, with so many workers that are `able` to.
fn of_emergency(able: u32, runs_of_safe_state: bool) -> Assignment {
    match able {
        0 | 1 => Assignment::GiveUp,
        // The other one watches, unless it runs a function itself.
        2 if runs_of_safe_state => Assignment::Wait,
        _ => Assignment::Run,
    }
}

/// Whether a function of the safe state may begin: it leaves two workers to an emergency, until
/// that is over.
fn of_safe_state(able: u32, emergency: &FailoverSequence) -> Assignment {
    match able {
        0 | 1 => Assignment::GiveUp,
        2 if emergency.is_under_way() => Assignment::Wait,
        2 if !emergency.is_done() => Assignment::GiveUp,
        _ => Assignment::Run,
    }
}

impl Emergency {
    /// The duty of `member` with `functions`, of either kind. It may run one only if another worker
    /// is left to watch it.
    fn duty(&self, functions: &Functions, member: u8) -> Leg {
        if !functions.failover.is_under_way() {
            return Leg::Rest;
        }
        // One at a time: no two count each other as the one that watches. A worker that is being
        // left behind may still be counted; the one that leaves it behind runs nothing meanwhile.
        let _one_at_a_time = self.workers.assigns.lock();
        let able = self.workers.able();
        let assignment = if std::ptr::eq(functions, &self.at_emergency) {
            of_emergency(able, self.at_safe_state.failover.is_running())
        } else {
            of_safe_state(able, &self.at_emergency.failover)
        };
        functions.take(member, assignment)
    }

    /// Begins if a signal has come. It has begun when this returns, also if another worker received
    /// the signal first: else this one would sleep, and not watch that one.
    fn hear(&self) {
        let workers = &self.workers;
        if workers.hears_signals.load(Ordering::Relaxed)
            && let Some(number) = signals::received()
        {
            let is_news = workers.heard.swap(number as u32, Ordering::Relaxed) == 0;
            if is_news || !self.has_begun() {
                self.begin(Cause::Signal(number));
            }
        }
        if let Some(crash) = workers.crash.get()
            && let Some(number) = crash.signal()
        {
            let is_news = workers.heard_crash.swap(number, Ordering::Relaxed) == 0;
            if is_news || !self.has_begun() {
                self.begin_for_crash();
            }
        }
    }
}

impl EmergencyWorkers {
    /// `member` waits on a core, with what it obtained, and takes it over when it is called there.
    pub(super) fn wait_on_core(&self, member: u8, asked: Policy, obtained: &Obtained) {
        if let Some(core) = core_to_take_over(asked, obtained.policy, obtained.core) {
            // Each member is made once.
            let _ = self.cores[usize::from(member)].set(core);
        }
    }

    /// Calls the worker that waits on this core, if there is one. Returns whether it comes.
    pub(in super::super) fn call_here(&self) -> bool {
        let member = thread::current_core().and_then(|here| {
            let mut cores = self.cores.iter();
            cores.position(|core| core.get() == Some(&here))
        });
        member.is_some_and(|member| {
            // One of the same priority, such as a function of another system, does not give way,
            // nor does a thread with a deadline.
            path::expected(Call::Wake, thread::current_policy).rank() < EMERGENCY_PRIORITY
                && self.parkers[member].unpark()
        })
    }
}

/// The core that a worker of the reserve can preempt. None if it was refused its core, since it
/// then waits on any core, or its policy, since it would then wait for the thread that calls it.
fn core_to_take_over(asked: Policy, obtained: Policy, core: Option<usize>) -> Option<usize> {
    core.filter(|_| asked.is_real_time() && obtained == asked)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_that_has_both_its_policy_and_its_core_takes_it_over() {
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
