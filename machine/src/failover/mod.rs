//! Runs jobs in order, each at most once; another worker takes over when one hangs.
//!
//! All workers of a group, its members, use the same [`FailoverSequence`]. It makes one of them
//! [run](Leg::Run) the next job, and the others [watch](Leg::Watch) that one. If the job takes too
//! long, a watcher [leaves the runner behind](FailoverSequence::leave_behind), and any member may
//! run the next job. The state is one word, changed by compare-and-swap. So a job is run once, by
//! one member, and either its runner has finished it or was left behind, never both.
//!
//! ```
//! use luna_machine::failover::{Leg, FailoverSequence};
//!
//! let failover = FailoverSequence::new();
//! let (brakes, lamp) = (failover.add().unwrap(), failover.add().unwrap());
//! assert_eq!(failover.take(0), Leg::Rest); // not yet
//! assert!(failover.begin() && !failover.begin());
//! let Leg::Run(turn) = failover.take(0) else { panic!("it is free") };
//! assert_eq!((turn.job(), failover.take(1)), (brakes, Leg::Watch(turn)));
//! assert!(failover.leave_behind(turn)); // member 0 hangs
//! let Leg::Run(turn) = failover.take(1) else { panic!("it is free") };
//! assert_eq!(turn.job(), lamp);
//! assert!(failover.finish(turn) && failover.is_done());
//! ```

use core::fmt;
use luna_platform::sync::atomic::{AtomicU64, Ordering};

/// The maximum number of jobs.
pub const MAX_JOBS: usize = 1 << 12;

/// The state in one word: `{ round: 24, runner: 8, next: 14, jobs: 14, phase: 4 }`, the lowest bits
/// last.
///
/// Phases go only from ready to begun to done, or from ready or done to closed; done goes to ready
/// as a new round.
pub struct FailoverSequence {
    word: AtomicU64,
}

/// One member's run of one job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn {
    round: u32,
    job: u16,
    member: u8,
}

impl Turn {
    /// The number of the job.
    pub fn job(self) -> usize {
        self.job.into()
    }

    /// The member that runs it.
    pub fn member(self) -> u8 {
        self.member
    }
}

/// The duty of a member.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Leg {
    /// Run this job, and then [`finish`](FailoverSequence::finish) it.
    Run(Turn),
    /// Watch that this run does not take too long.
    Watch(Turn),
    /// Nothing: the sequence has not begun, or is over.
    Rest,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Ready,
    Begun,
    Done,
    Closed,
}

/// The word, unpacked.
#[derive(Debug, Clone, Copy)]
struct State {
    round: u32,
    /// The member plus one, 0 if none.
    runner: u8,
    next: u16,
    jobs: u16,
    phase: Phase,
}

impl State {
    fn of(word: u64) -> Self {
        Self {
            round: (word >> 40) as u32,
            runner: (word >> 32) as u8,
            next: (word >> 18) as u16 & 0x3fff,
            jobs: (word >> 4) as u16 & 0x3fff,
            phase: match word & 0xf {
                0 => Phase::Ready,
                1 => Phase::Begun,
                2 => Phase::Done,
                _ => Phase::Closed,
            },
        }
    }

    fn word(self) -> u64 {
        u64::from(self.round & 0xff_ffff) << 40
            | u64::from(self.runner) << 32
            | u64::from(self.next) << 18
            | u64::from(self.jobs) << 4
            | self.phase as u64
    }

    fn turn(self) -> Option<Turn> {
        Some(Turn {
            round: self.round,
            job: self.next,
            member: self.runner.checked_sub(1)?,
        })
    }

    /// The job is over, whatever its result.
    fn pass(&mut self) {
        self.runner = 0;
        self.next += 1;
        if self.next >= self.jobs {
            self.phase = Phase::Done;
        }
    }
}

impl FailoverSequence {
    /// No jobs yet.
    pub fn new() -> Self {
        Self {
            word: AtomicU64::new(0),
        }
    }

    /// Adds a job; returns its number: 0, 1 and so on. It runs behind the others, also if they run
    /// already. None if it would never be run: all have been, or the sequence is closed, or there
    /// are [`MAX_JOBS`].
    pub fn add(&self) -> Option<usize> {
        let before = self.change(
            |state| {
                let is_over = matches!(state.phase, Phase::Done | Phase::Closed);
                !is_over && usize::from(state.jobs) < MAX_JOBS
            },
            |state| state.jobs += 1,
        );
        before.ok().map(|state| state.jobs.into())
    }

    /// Removes the last number, if no job has been run: the caller, which numbers the jobs, closes
    /// the gap. Returns whether it did.
    pub fn remove(&self) -> bool {
        let can = |state: State| state.phase == Phase::Ready && state.jobs > 0;
        self.change(can, |state| state.jobs -= 1).is_ok()
    }

    /// Begins; returns whether this was the first to do so. Does nothing if it has begun, is done
    /// or closed. Async-signal-safe, as are all methods.
    pub fn begin(&self) -> bool {
        let begun = self.change(
            |state| state.phase == Phase::Ready,
            |state| {
                state.phase = match state.jobs {
                    0 => Phase::Done,
                    _ => Phase::Begun,
                };
            },
        );
        begun.is_ok()
    }

    /// Prevents it from beginning; returns whether that is guaranteed.
    pub fn close(&self) -> bool {
        let can = |state: State| matches!(state.phase, Phase::Ready | Phase::Closed);
        self.change(can, |state| state.phase = Phase::Closed)
            .is_ok()
    }

    /// As [`close`](Self::close), and if it is done it stays so: it does not begin
    /// [`again`](Self::again), and is no longer [done](Self::is_done).
    pub fn retire(&self) -> bool {
        let can = |state: State| state.phase != Phase::Begun;
        self.change(can, |state| state.phase = Phase::Closed)
            .is_ok()
    }

    /// Resets it to the state before it began, if it is done, with all its jobs. Returns whether it
    /// did.
    pub fn again(&self) -> bool {
        let again = self.change(
            |state| state.phase == Phase::Done,
            |state| {
                state.phase = Phase::Ready;
                state.next = 0;
                state.round = state.round.wrapping_add(1);
            },
        );
        again.is_ok()
    }

    /// The present duty of `member`, at most 254. O(1), repeated only if another thread changed the
    /// state meanwhile.
    pub fn take(&self, member: u8) -> Leg {
        let taken = self.change(
            |state| state.phase == Phase::Begun && state.runner == 0,
            |state| state.runner = member + 1,
        );
        match taken {
            Ok(mut state) => {
                state.runner = member + 1;
                state.turn().map_or(Leg::Rest, Leg::Run)
            }
            Err(state) if state.phase == Phase::Begun => state.turn().map_or(Leg::Rest, Leg::Watch),
            Err(_) => Leg::Rest,
        }
    }

    /// The present duty of a member that may begin no job: as [`take`](Self::take), but a job
    /// that is free stays so, and is no duty.
    pub fn look(&self) -> Leg {
        match self.state() {
            state if state.phase == Phase::Begun => state.turn().map_or(Leg::Rest, Leg::Watch),
            _ => Leg::Rest,
        }
    }

    /// Gives up the jobs that have not begun, if none runs: it is done. Returns the number of the
    /// first of them; `None` if a job runs, or there is none left.
    pub fn give_up(&self) -> Option<usize> {
        let before = self.change(
            |state| state.phase == Phase::Begun && state.runner == 0,
            |state| {
                state.next = state.jobs;
                state.phase = Phase::Done;
            },
        );
        before.ok().map(|state| state.next.into())
    }

    /// The runner has run its job. Returns whether that counts; if not, the runner was left behind,
    /// and is no member any more.
    pub fn finish(&self, turn: Turn) -> bool {
        self.pass(turn)
    }

    /// Leaves the runner of `turn` behind: any member may run the next job. Returns whether this
    /// call did it; if not, the runner has finished, or another watcher was faster.
    pub fn leave_behind(&self, turn: Turn) -> bool {
        self.pass(turn)
    }

    fn pass(&self, turn: Turn) -> bool {
        let can = |state: State| state.phase == Phase::Begun && state.turn() == Some(turn);
        self.change(can, State::pass).is_ok()
    }

    /// Whether it has begun, done or not.
    pub fn has_begun(&self) -> bool {
        matches!(self.state().phase, Phase::Begun | Phase::Done)
    }

    /// Whether a member runs a job.
    pub fn is_running(&self) -> bool {
        let state = self.state();
        state.phase == Phase::Begun && state.runner != 0
    }

    /// Whether it has begun, and is not done.
    pub fn is_under_way(&self) -> bool {
        self.state().phase == Phase::Begun
    }

    /// Whether all jobs have been run or left behind.
    pub fn is_done(&self) -> bool {
        self.state().phase == Phase::Done
    }

    fn state(&self) -> State {
        // Acquire: a thread that sees a job done sees what the job has written.
        State::of(self.word.load(Ordering::Acquire))
    }

    /// Makes a step if it `can`. Returns the state before it, or the present state if it cannot.
    fn change(
        &self,
        can: impl Fn(State) -> bool,
        step: impl Fn(&mut State),
    ) -> Result<State, State> {
        let mut word = self.word.load(Ordering::Acquire);
        loop {
            let state = State::of(word);
            if !can(state) {
                return Err(state);
            }
            let mut next = state;
            step(&mut next);
            match self
                .word
                .compare_exchange(word, next.word(), Ordering::AcqRel, Ordering::Acquire)
            {
                Ok(_) => return Ok(state),
                Err(other) => word = other,
            }
        }
    }
}

impl fmt::Debug for FailoverSequence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.state().fmt(f)
    }
}

#[cfg(all(test, not(loom)))]
mod tests;

#[cfg(all(test, loom))]
mod event_count_loom_tests;
#[cfg(all(test, loom))]
mod loom_tests;
