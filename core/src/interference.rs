//! Which process held this executor, and when: so that a late process can report which one ran
//! instead.
//!
//! It costs next to nothing. A row of turns ends when the executor does anything else than polling,
//! with one store of the number of the process that was polled last. When a deadline has come the
//! executor looks at the clock before each poll for a while ([`deadlines`](crate::deadlines)): what
//! has passed since its last look was the poll in between.
//! Of the poll in which a busy executor's alarm rang the part from then on is known. Polls
//! before that are not reported.

use crate::current::{self, ProcessId};
use core::cell::Cell;
use core::time::Duration;
use luna_platform::clock::Instant;

/// Polls shorter than this many nanoseconds make no process late, and are not remembered.
const NOTABLE: u64 = 10_000;

/// How many polls are remembered: the last ones.
const REMEMBERED: usize = 16;

/// One turn of a process on an executor, as [`interference`] reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Turn {
    /// The process that was polled; of several between two looks at the clock the last one.
    pub process: ProcessId,
    /// When the executor had looked at the clock before; or, of a turn in which a deadline came
    /// while the executor did not look, that deadline or a little later.
    pub began: Instant,
    /// When it looked again.
    pub ended: Instant,
}

impl Turn {
    /// How much of the time between two instants it took, in nanoseconds.
    fn overlap(&self, from: Instant, until: Instant) -> u64 {
        self.ended.min(until).nanos_since(self.began.max(from))
    }
}

/// A process that held an executor: what [`interference`] gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Interference {
    /// The process.
    pub process: ProcessId,
    /// How much of the time that was asked about its turns took, all together.
    pub held: Duration,
}

/// What an executor's thread remembers.
struct Memory {
    /// When the clock was looked at since the poll before the last; 0 if it was not, or something
    /// else than a poll came in between.
    looked: Cell<u64>,
    /// The process that was polled last since then, as a number; 0 if none was.
    polled: Cell<u32>,
    polls: [Cell<Option<Turn>>; REMEMBERED],
    /// Where the next one goes.
    next: Cell<usize>,
}

luna_platform::local! {
    static MEMORY: Memory = const {
        Memory {
            polled: Cell::new(0),
            looked: Cell::new(0),
            polls: [const { Cell::new(None) }; REMEMBERED],
            next: Cell::new(0),
        }
    };
}

/// Notes that `process` was polled last. One store.
#[inline]
pub(crate) fn polled(process: ProcessId) {
    MEMORY.with(|memory| memory.polled.set(process.get()));
}

/// Notes that the executor looks at the clock, between two polls.
#[inline]
pub(crate) fn look(now: Instant) {
    MEMORY.with(|memory| {
        let before = memory.looked.replace(now.as_nanos());
        if now.as_nanos().saturating_sub(before) >= NOTABLE {
            memory.note(before, now);
        }
        // From here on no process has been polled yet.
        memory.polled.set(0);
    });
}

/// Notes that the clock was looked at in the middle of the poll that has just ended, if it was not
/// between it and the one before.
pub(crate) fn looked(at: Instant) {
    MEMORY.with(|memory| {
        if memory.looked.get() == 0 {
            memory.looked.set(at.as_nanos());
        }
    });
}

/// Notes that the executor does not look between the next polls: their durations will not be known.
pub(crate) fn look_no_more() {
    MEMORY.with(|memory| memory.looked.set(0));
}

/// Whether the clock was looked at since the poll before the last.
pub(crate) fn is_looking() -> bool {
    MEMORY.with(|memory| memory.looked.get() != 0)
}

/// The process that was polled last on this thread, since it looked at the clock.
pub(crate) fn last_polled() -> Option<ProcessId> {
    MEMORY.with(|memory| ProcessId::from_number(memory.polled.get()))
}

/// Notes that the thread does something else than polling: the time since the last look belongs to
/// no process.
pub(crate) fn rest() {
    MEMORY.with(|memory| {
        memory.polled.set(0);
        memory.looked.set(0);
    });
}

impl Memory {
    #[cold]
    fn note(&self, before: u64, now: Instant) {
        if let Some(poll) = self.poll_since(before, now) {
            let next = self.next.get();
            self.polls[next].set(Some(poll));
            self.next.set((next + 1) % REMEMBERED);
        }
    }

    /// The poll that went on from `before`, a look at the clock, until now.
    fn poll_since(&self, before: u64, now: Instant) -> Option<Turn> {
        let process = ProcessId::from_number(self.polled.get())?;
        (before != 0).then_some(Turn {
            process,
            began: Instant::from_nanos(before),
            ended: now,
        })
    }
}

/// The process that held this executor longest between the two instants, by all its turns that
/// took 10 µs or more of that time and that `counts`. Called in a poll.
///
/// The last 16 such turns are known. The executor reads the clock between polls for 32 polls after
/// it has slept, after a deadline and after a loop's cycle has begun; a turn in which a deadline
/// comes later than that counts from the deadline on. `None` on a thread that is no executor's.
/// Real-time path: yes; O(1), no system call.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use luna_core::{Executor, ProcessSpec, interference};
/// use luna_core::timer_queue::Sleep;
/// use luna_platform::{clock::Instant, thread::Attributes};
/// use std::time::Duration;
///
/// let executor = Executor::start(Attributes::new("main"))?;
/// let hog = ProcessSpec::new("hog").level(20);
/// let hog_id = hog.id();
/// let late = executor.spawn(ProcessSpec::new("late"), move || async move {
///     let slot = Instant::now() + Duration::from_millis(50);
///     Sleep::until(slot).await;
///     let culprit = interference(slot, Instant::now(), |_| true).map(|turn| turn.process);
///     assert_eq!(culprit, Some(hog_id));
/// });
/// executor.spawn(hog, || async {
///     Sleep::until(Instant::now() + Duration::from_millis(10)).await;
///     let end = Instant::now() + Duration::from_millis(60);
///     while Instant::now() < end {}
/// });
/// executor.release();
/// assert_eq!(late.wait(), luna_core::Exit::Completed);
/// # Ok(()) }
/// ```
pub fn interference(
    from: Instant,
    until: Instant,
    counts: impl Fn(&Turn) -> bool,
) -> Option<Interference> {
    MEMORY.with(|memory| {
        // The calling process has not been noted as polled yet, so this is the one before it.
        let last = memory.poll_since(memory.looked.get(), until);
        let turns = || {
            let turns = memory.polls.iter().filter_map(Cell::get).chain(last);
            turns.filter(|turn| turn.overlap(from, until) >= NOTABLE && counts(turn))
        };
        let held = |process: ProcessId| -> u64 {
            let of_process = turns().filter(|turn| turn.process == process);
            of_process.map(|turn| turn.overlap(from, until)).sum()
        };
        let all = turns().map(|turn| (turn.process, held(turn.process)));
        let longest = all.max_by_key(|(_, held)| *held);
        longest.map(|(process, held)| Interference {
            process,
            held: Duration::from_nanos(held),
        })
    })
}

/// Notes that a process of this executor looks at the clock at the begin of its poll: what has
/// passed since the last look was the poll before. To be called before anything else of the poll
/// has taken time. Real-time path: yes; O(1), no system call. Does nothing where a process is alone
/// on its thread.
///
/// The executor looks too between the polls that follow, so that the end of this one is known:
/// loops that wake together, and are the only ones that wait for the clock, are separated by this.
#[inline]
pub fn look_at_clock(now: Instant) {
    // A process alone on its thread delays only itself.
    if !current::may_block() {
        look(now);
        current::ask_look();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(micros: u64) -> Instant {
        Instant::from_nanos(micros * 1000)
    }

    fn turn(process: ProcessId, from: u64, until: u64) {
        look(at(from));
        polled(process);
        look(at(until));
    }

    fn culprit(from: u64, until: u64) -> Option<ProcessId> {
        interference(at(from), at(until), |_| true).map(|turn| turn.process)
    }

    #[test]
    fn the_longest_overlap_is_the_culprit() {
        rest();
        let (long_ago, long, short) = (ProcessId::new(), ProcessId::new(), ProcessId::new());
        turn(long_ago, 1000, 2000);
        turn(long, 2000, 2100);
        turn(short, 2100, 2150);
        assert_eq!(culprit(2010, 2160), Some(long));
        assert_eq!(
            culprit(2090, 2160),
            Some(short),
            "before the slot does not count"
        );
        assert_eq!(culprit(1890, 2160), Some(long_ago));
        assert_eq!(culprit(2149, 2160), None, "too short to matter");
        let other = interference(at(2010), at(2160), |turn| turn.process != long);
        assert_eq!(other.map(|turn| turn.process), Some(short));
    }

    #[test]
    fn the_turns_of_a_process_are_added_up() {
        rest();
        let (often, once) = (ProcessId::new(), ProcessId::new());
        turn(often, 1000, 1060);
        turn(once, 1060, 1160);
        turn(often, 1160, 1230);
        let found = interference(at(1010), at(1240), |_| true);
        let held = Duration::from_micros(120);
        assert_eq!(
            found,
            Some(Interference {
                process: often,
                held
            })
        );
    }

    #[test]
    fn one_that_was_polled_since_the_last_look_counts_too() {
        rest();
        let before = ProcessId::new();
        look(at(5000));
        polled(before);
        assert_eq!(culprit(5000, 5100), Some(before));
        look(at(5100));
        assert_eq!(culprit(5000, 5200), Some(before), "noted by the look");
    }

    #[test]
    fn rest_is_nobodys() {
        rest();
        let polled_before = ProcessId::new();
        turn(polled_before, 100, 105);
        rest();
        look(at(9000));
        assert_eq!(culprit(105, 9000), None);
        polled(ProcessId::new());
        rest();
        assert_eq!(culprit(9000, 9900), None);
    }

    #[test]
    fn the_oldest_are_forgotten() {
        rest();
        let old = ProcessId::new();
        turn(old, 100, 1000);
        let last = ProcessId::new();
        for n in 0..REMEMBERED as u64 {
            turn(last, 1000 + 20 * n, 1020 + 20 * n);
        }
        assert_eq!(culprit(100, 1000), None);
        assert_eq!(culprit(100, 1020), Some(last));
    }
}
