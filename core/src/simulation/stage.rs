//! The thread of a simulation, and the state that it shares with other threads.

use super::calls::{CallsUnderWay, Delivery, Oldest};
use super::drive::{DrivenClock, Order};
use super::member::Member;
use super::{Pace, SimulationHandle, Standstill};
use crate::call_count;
use crate::deferred_free::{self, Shared};
use crate::executor::{Phase, Shared as ExecutorShared};
use crate::file_watch;
use crate::interference;
use crate::park::Parker;
use crate::process::{ProcessRegistry, prepare_thread};
use crate::quiescence::Quiescence;
use luna_platform::bell::Watch;
use luna_platform::clock::{Clock, Instant, VirtualClock};
use luna_platform::futex::Waited;
use luna_platform::lock::PiLock;
use luna_platform::panics;
use std::cell::Cell;
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// The longest pause of all processes, in the machine's time, while ends are handled. The handler
/// may itself wait for processes: then they go on.
const LONGEST_ATTENDANCE: Duration = Duration::from_secs(1);

/// Number of turns after a request to stop until it is followed although a process can still run.
const TURNS_TO_STOP: u64 = 100_000;

/// The state that a simulation's thread shares with other threads. Each change is followed by a
/// wake of the thread.
pub(crate) struct Stage {
    clock: Arc<VirtualClock>,
    driven: Option<DrivenClock>,
    parker: Shared<Parker>,
    pub(crate) quiescence: Arc<Quiescence>,
    pub(crate) registry: Arc<ProcessRegistry>,
    /// Executors that the thread has yet to add; `None` once the thread has ended.
    arrivals: PiLock<Option<Vec<Arc<ExecutorShared>>>>,
    is_released: AtomicBool,
    is_stopping: AtomicBool,
    time_stands: AtomicBool,
    /// Number of ends that have been handled; all there will be, if there is no handler.
    attended: AtomicU64,
    calls: CallsUnderWay,
    most_turns: u64,
    standstill: PiLock<Option<Standstill>>,
}

luna_platform::local! {
    /// The stage that this thread runs.
    static HERE: Cell<*const Stage> = const { Cell::new(ptr::null()) };
}

/// Whether the calling thread is that of `stage`.
pub(crate) fn is_stage(stage: &Stage) -> bool {
    ptr::eq(HERE.get(), stage)
}

/// Replaces an executor's own bell: rings the simulation's thread.
#[derive(Debug)]
struct Forward(Shared<Parker>);

impl Watch for Forward {
    fn sleep(&self, deadline: Instant) -> Waited {
        if self.0.park(deadline) {
            Waited::Woken
        } else {
            Waited::TimedOut
        }
    }

    fn ring(&self) {
        self.0.unpark();
    }

    fn glance(&self) {}
}

impl Stage {
    pub(super) fn new(pace: Pace, registry: Arc<ProcessRegistry>, most_turns: u64) -> Arc<Self> {
        let driven = match pace {
            Pace::Jumping => None,
            Pace::Driven(clock) => Some(clock),
        };
        let (clock, parker) = match &driven {
            None => (Arc::new(VirtualClock::new()), Shared::new(Parker::new())),
            Some(driven) => (driven.0.clock.clone(), driven.0.parker.clone()),
        };
        Arc::new(Self {
            clock,
            driven,
            parker,
            quiescence: Arc::new(Quiescence::new()),
            registry,
            arrivals: PiLock::new(Some(Vec::new())),
            is_released: AtomicBool::new(false),
            is_stopping: AtomicBool::new(false),
            time_stands: AtomicBool::new(false),
            attended: AtomicU64::new(u64::MAX),
            calls: CallsUnderWay::default(),
            most_turns,
            standstill: PiLock::new(None),
        })
    }

    pub(crate) fn clock(&self) -> Clock {
        Clock::from(self.clock.clone())
    }

    /// Hands an executor to the thread, which adds it at its next round; `false` if the thread has
    /// ended.
    pub(crate) fn admit(&self, executor: Arc<ExecutorShared>) -> bool {
        let bell = executor.inbound.bell();
        // An executor is admitted once.
        let _ = bell.hook().set(Arc::new(Forward(self.parker.clone())));
        match &mut *self.arrivals.lock() {
            None => return false,
            Some(arrivals) => arrivals.push(executor),
        }
        self.parker.unpark();
        true
    }

    pub(super) fn release(&self) {
        self.is_released.store(true, Ordering::Release);
        self.parker.unpark();
    }

    pub(super) fn request_stop(&self) {
        self.is_stopping.store(true, Ordering::Release);
        self.parker.unpark();
    }

    /// Whether there were more hurried ends than those that have been handled and those up to
    /// `given_up`.
    #[inline]
    fn is_to_be_attended(&self, given_up: u64) -> bool {
        let ends = self.registry.hurried();
        ends > given_up && ends > self.attended.load(Ordering::Acquire)
    }

    /// Reports once why nothing goes on.
    fn stand_still(&self, why: Standstill) {
        let mut standstill = self.standstill.lock();
        if standstill.is_none() {
            *standstill = Some(why);
            drop(standstill);
            self.registry.announce();
        }
    }

    /// A process of this simulation begins a call on the pool.
    pub(crate) fn begin_call(&self) -> u64 {
        self.calls.begin()
    }

    /// It is done: `delivery` is made by the simulation's thread when its turn has come.
    pub(crate) fn call_done(&self, number: u64, delivery: Delivery) {
        self.calls.done(number, delivery);
        self.parker.unpark();
    }
}

impl SimulationHandle {
    /// Its clock.
    pub fn clock(&self) -> Clock {
        self.0.clock()
    }

    /// Time stands from now on: for an emergency, in which only what happens at this instant is of
    /// use. From any thread; one atomic operation.
    pub fn stop_time(&self) {
        self.0.time_stands.store(true, Ordering::Release);
    }

    /// Declares that the caller handles processes that end in a hurry
    /// ([`ProcessRegistry::hurried`]), as those with ends that others are to see: time waits until
    /// that was [done](Self::attended).
    pub fn attend(&self) {
        self.0.attended.store(0, Ordering::Release);
    }

    /// The first `ends` of those were handled.
    pub fn attended(&self, ends: u64) {
        if self.0.attended.fetch_max(ends, Ordering::AcqRel) < ends {
            self.0.parker.unpark();
        }
    }

    /// Why it does not go on, if it does not.
    pub fn standstill(&self) -> Option<Standstill> {
        *self.0.standstill.lock()
    }
}

/// The life of the thread.
pub(super) fn run(stage: &Arc<Stage>) {
    let _clock = stage.clock().enter();
    let _files = file_watch::enter(stage.parker.bell(), None);
    let (quiescence, registry) = (stage.quiescence.clone(), stage.registry.clone());
    let _calls = call_count::enter(quiescence, Some(registry), Some(stage.clone()));
    HERE.set(Arc::as_ptr(stage));
    prepare_thread();
    Play {
        stage,
        members: Vec::new(),
        turns: 0,
        turns_to_stop: 0,
        given_up: 0,
    }
    .play();
    // What arrives now is refused.
    let late = stage.arrivals.lock().take();
    for executor in late.into_iter().flatten() {
        executor.refuse_all();
    }
    if let Some(driven) = &stage.driven {
        driven.0.end();
    }
    HERE.set(ptr::null());
    deferred_free::collect();
}

/// The state of the thread itself.
struct Play<'a> {
    stage: &'a Arc<Stage>,
    /// The most urgent first, of equals the first added.
    members: Vec<Member>,
    /// Number of turns taken at this instant.
    turns: u64,
    /// Number of turns since a request to stop was seen.
    turns_to_stop: u64,
    /// The number of the last end that is no longer waited for although it was not handled.
    given_up: u64,
}

impl Play<'_> {
    fn play(mut self) {
        loop {
            // Before the look for a process that can run: requests made until then are done if none
            // can.
            let asked = self.stage.driven.as_ref().map_or(0, |d| d.0.requests());
            self.take_in();
            if self.is_to_be_attended() {
                self.wait_for_attendance();
                continue;
            }
            let can_go_on = self.turns < self.stage.most_turns;
            if can_go_on
                && self.turns_to_stop < TURNS_TO_STOP
                && let Some(index) = self.pick()
            {
                self.serve(index);
            } else if !self.rest(asked) {
                return;
            }
        }
    }

    /// Adds the executors that were started.
    fn take_in(&mut self) {
        let arrived = self.stage.arrivals.lock().as_mut().map(std::mem::take);
        for executor in arrived.into_iter().flatten() {
            let member = Member::new(executor);
            let place = self.members.partition_point(|one| !member.outranks(one));
            self.members.insert(place, member);
        }
    }

    /// Whether a process has ended that is to be handled before any other process runs: what is
    /// dropped then wakes others, and when it does must not depend on how fast another thread is.
    #[inline]
    fn is_to_be_attended(&self) -> bool {
        self.stage.is_to_be_attended(self.given_up)
    }

    fn wait_for_attendance(&mut self) {
        let ends = self.stage.registry.hurried();
        let latest = self.stage.clock.now() + LONGEST_ATTENDANCE;
        while self.is_to_be_attended() {
            if !self.stage.parker.park(latest) {
                self.given_up = ends;
            }
        }
    }

    fn is_released(&self) -> bool {
        self.stage.is_released.load(Ordering::Acquire)
    }

    /// The first member that has something to do and turns left; if only turns are lacking, all get
    /// new ones.
    fn pick(&mut self) -> Option<usize> {
        let (now, released) = (self.stage.clock.now(), self.is_released());
        let mut is_up = false;
        for (index, member) in self.members.iter().enumerate() {
            if member.has_work(now, released) {
                if member.has_turns() {
                    return Some(index);
                }
                is_up = true;
            }
        }
        if !is_up {
            return None;
        }
        self.members.iter_mut().for_each(Member::give_turns);
        let mut members = self.members.iter();
        members.position(|member| member.has_work(now, released))
    }

    fn serve(&mut self, index: usize) {
        let (now, released) = (self.stage.clock.now(), self.is_released());
        let (above, others) = self.members.split_at_mut(index);
        let above = &*above;
        let (stage, given_up) = (self.stage, self.given_up);
        let is_outdone = |member: &Member| {
            stage.is_to_be_attended(given_up)
                || above.iter().any(|one| {
                    one.has_turns() && one.outranks(member) && one.shared.inbound.is_signalled()
                })
        };
        let most = self.stage.most_turns - self.turns;
        let (taken, goes_on) = others[0].serve(now, released, most, is_outdone);
        self.turns += taken;
        if self.is_to_stop() {
            self.turns_to_stop += taken.max(1);
        }
        if !goes_on {
            self.members.remove(index);
        }
    }

    fn is_to_stop(&self) -> bool {
        self.stage.is_stopping.load(Ordering::Acquire)
            || self.members.iter().any(|one| one.shared.is_stopping())
    }

    /// No process can run, or none is to. `false` if this is the end.
    fn rest(&mut self, asked: u64) -> bool {
        if self.is_to_stop() {
            return self.stop();
        }
        if !self.is_released() {
            self.sleep(false);
            return true;
        }
        if self.turns >= self.stage.most_turns {
            if let Some(process) = interference::last_polled() {
                let turns = self.turns;
                self.stage
                    .stand_still(Standstill::Livelock { process, turns });
            }
            self.sleep(false);
            return true;
        }
        match self.stage.calls.oldest() {
            Oldest::None => {}
            Oldest::UnderWay => {
                self.sleep(false);
                return true;
            }
            Oldest::Done(delivery) => {
                // What it drops may be the user's; a panic in it belongs to no process here.
                if let Err(payload) = panics::catch(delivery) {
                    std::mem::forget(payload);
                }
                return true;
            }
        }
        file_watch::glance(self.stage.parker.bell());
        if self.stage.time_stands.load(Ordering::Acquire) {
            self.sleep(false);
            return true;
        }
        let next = self.members.iter().map(Member::next_deadline).min();
        let next = next.unwrap_or(Instant::NEVER);
        match &self.stage.driven {
            None if next == Instant::NEVER => {
                self.sleep(!file_watch::is_waiting(self.stage.parker.bell()));
            }
            None => self.move_to(next),
            // There is nothing to move time for.
            Some(driven) if self.stage.registry.count() == 0 => {
                driven.0.end();
                self.sleep(false);
            }
            Some(driven) => {
                match driven.0.at_rest(asked, next) {
                    Order::LookAgain => {}
                    Order::MoveTo(instant) => self.move_to(instant),
                    // Its driver may still send input, so this is no deadlock.
                    Order::Rest => self.sleep(false),
                    Order::Undriven => {
                        self.stage.stand_still(Standstill::Undriven);
                        self.sleep(false);
                    }
                }
            }
        }
        true
    }

    fn move_to(&mut self, instant: Instant) {
        self.stage.clock.move_to(instant);
        interference::rest();
        self.turns = 0;
        self.members.iter_mut().for_each(Member::give_turns);
    }

    /// Ends what was requested to end; `false` when that was all. Time stands meanwhile.
    fn stop(&mut self) -> bool {
        let all = self.stage.is_stopping.load(Ordering::Acquire);
        let was_closed = self.closed();
        let mut index = 0;
        while index < self.members.len() {
            let member = &mut self.members[index];
            if (all || member.shared.is_stopping()) && member.close() {
                self.members.remove(index);
            } else {
                index += 1;
            }
        }
        self.turns = 0;
        self.turns_to_stop = 0;
        if all && self.members.is_empty() {
            let arrivals = self.stage.arrivals.lock();
            return arrivals.as_ref().is_some_and(|arrived| !arrived.is_empty());
        }
        // Cancelled processes end at their next turn, also if they were never released; one that
        // does not end has a wake under way from another thread.
        let now = self.stage.clock.now();
        let mut closed = self.members.iter().filter(|one| one.is_closed());
        if closed.any(|one| one.has_work(now, true)) {
            self.serve_cancelled();
        } else if self.closed() == was_closed {
            self.sleep(false);
        }
        true
    }

    fn closed(&self) -> usize {
        self.members.iter().filter(|one| one.is_closed()).count()
    }

    /// Gives every cancelled process a turn, released or not.
    fn serve_cancelled(&mut self) {
        let now = self.stage.clock.now();
        for index in (0..self.members.len()).rev() {
            let member = &mut self.members[index];
            member.give_turns();
            if member.is_closed() && !member.serve(now, true, u64::MAX, |_| false).1 {
                self.members.remove(index);
            }
        }
    }

    /// Sleeps until a signal arrives. If `still`, only other threads can end the sleep; the
    /// observer of quiescence is notified of that.
    fn sleep(&self, still: bool) {
        let asleep = self.members.iter();
        let asleep = asleep.take_while(|one| one.shared.inbound.fall_asleep());
        let asleep = asleep.count();
        if asleep == self.members.len() {
            let stage = self.stage;
            let before = || {
                if still && stage.quiescence.become_quiescent() {
                    stage.registry.announce();
                }
            };
            let after = || {
                if still {
                    stage.quiescence.wake();
                }
            };
            stage.parker.park_between(Instant::NEVER, before, after);
        }
        for member in &self.members[..asleep] {
            member.shared.inbound.awake();
        }
    }
}

impl ExecutorShared {
    fn is_stopping(&self) -> bool {
        self.phase() == Phase::STOPPING
    }
}
