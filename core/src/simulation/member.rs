//! One executor of a simulation.

use crate::current::{self, Cpu};
use crate::events;
use crate::executor::{Phase, Shared};
use crate::process::{self, Enrolled, turns};
use crate::timer_queue::TimerQueue;
use luna_platform::clock::Instant;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

/// How many turns an executor has before the others get theirs.
const TURNS: u64 = 256;

/// An executor, on the simulation's thread.
pub(super) struct Member {
    pub(super) shared: Arc<Shared>,
    timers: Arc<TimerQueue>,
    cpu: Cpu,
    events: events::Kept,
    /// Whether its name was recorded.
    is_named: bool,
    /// Whether no process could run when its last turns ended.
    rests: bool,
    /// How many turns it has left until all have had theirs.
    left: u64,
    /// It accepts no more processes, and its processes are cancelled.
    is_closed: bool,
    _enrolled: Enrolled,
    /// Last, so that a thread that waits for this end waits for all of the above.
    _end: End,
}

/// Marks the executor as stopped when it is dropped.
struct End(Arc<Shared>);

impl Drop for End {
    fn drop(&mut self) {
        self.0.set_stopped();
    }
}

impl Member {
    pub(super) fn new(shared: Arc<Shared>) -> Self {
        let timers = Arc::new(TimerQueue::new());
        let enrolled = shared.registry.enroll(shared.executor_id, shared.clone());
        Self {
            cpu: Cpu::sharing(shared.executor_id, timers.clone()),
            timers,
            _end: End(shared.clone()),
            shared,
            events: events::Kept::default(),
            is_named: false,
            rests: false,
            left: TURNS,
            is_closed: false,
            _enrolled: enrolled,
        }
    }

    pub(super) fn outranks(&self, other: &Member) -> bool {
        self.shared.thread_priority() > other.shared.thread_priority()
    }

    pub(super) fn next_deadline(&self) -> Instant {
        self.timers.next_deadline()
    }

    fn is_running(&self) -> bool {
        self.shared.phase() != Phase::HELD
    }

    /// Whether there is anything to do for it at `now`; processes run only once all are `released`.
    #[inline]
    pub(super) fn has_work(&self, now: Instant, released: bool) -> bool {
        self.shared.inbound.is_signalled()
            || released
                && self.is_running()
                && (self.cpu.ready_levels() != 0 || self.next_deadline() <= now)
    }

    #[inline]
    pub(super) fn has_turns(&self) -> bool {
        self.left > 0
    }

    #[inline]
    pub(super) fn give_turns(&mut self) {
        self.left = TURNS;
    }

    fn enter(&mut self) {
        self.cpu.enter();
        self.events.exchange();
    }

    fn leave(&mut self) {
        self.events.exchange();
        self.cpu.leave();
    }

    /// Polls its processes until none is ready, its turns are up, `most` have been taken, or
    /// `is_outdone`. Returns how many turns were taken, and whether the executor goes on: not after
    /// a panic outside of any process.
    pub(super) fn serve(
        &mut self,
        now: Instant,
        released: bool,
        most: u64,
        is_outdone: impl Fn(&Member) -> bool,
    ) -> (u64, bool) {
        self.enter();
        let (mut taken, most) = (0, most.min(self.left));
        let runs = released && self.is_running();
        let rested = std::mem::take(&mut self.rests);
        let lived = catch_unwind(AssertUnwindSafe(|| {
            turns(|| {
                loop {
                    // SAFETY: this is between two polls.
                    unsafe { process::end_turns() };
                    self.shared.take_in();
                    if !runs {
                        break;
                    }
                    if self.timers.next_deadline() <= now {
                        self.timers.expire(now);
                    }
                    // SAFETY: each dequeued process is given a turn below, before anything else is
                    // done, or retired.
                    let Some(process) = (unsafe { current::next_ready() }) else {
                        break;
                    };
                    if rested && taken == 0 {
                        events::report_executor(events::code::AWAKE);
                    }
                    taken += 1;
                    // SAFETY: it was just popped from this thread's queue, where only live
                    // processes are: those of this executor, which is entered.
                    unsafe {
                        if let Some(next) = process::run(process) {
                            current::put_back(next);
                        }
                    }
                    if taken >= most || is_outdone(self) {
                        break;
                    }
                }
            });
        }));
        // SAFETY: this is after the last poll.
        unsafe { process::end_turns() };
        current::set_on_path(false);
        // A turn that ended in a panic counts too.
        self.left = self.left.saturating_sub(taken);
        let goes_on = lived.is_ok();
        if let Err(payload) = lived {
            self.give_up(payload);
        }
        if events::is_on() {
            self.report(rested && taken == 0);
        }
        self.leave();
        (taken, goes_on)
    }

    /// Records its name, and whether it rests now. Nothing is recorded for a member that `rested`
    /// before and polled nothing, since that depends on other threads.
    #[cold]
    fn report(&mut self, rested: bool) {
        if !std::mem::replace(&mut self.is_named, true) {
            events::name_executor(|| self.shared.name().to_owned());
        }
        self.rests = current::ready_levels() == 0;
        if self.rests && !rested {
            events::report_executor(events::code::ASLEEP);
        }
    }

    /// Accepts no more processes, and cancels those it has; does nothing the second time. Returns
    /// whether all of them have ended.
    pub(super) fn close(&mut self) -> bool {
        if !std::mem::replace(&mut self.is_closed, true) {
            self.shared.advance(Phase::STOPPING);
            self.shared.close();
            self.enter();
            for record in process::records() {
                record.cancel();
            }
            self.leave();
        }
        self.cpu.process_count() == 0
    }

    pub(super) fn is_closed(&self) -> bool {
        self.is_closed
    }

    /// Its processes end as panicked with this payload: see the executors of real threads.
    fn give_up(&mut self, payload: Box<dyn Any + Send>) {
        self.is_closed = true;
        self.shared.give_up(payload);
    }
}
