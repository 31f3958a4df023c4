//! Late cycles, and why they were late as far as it can be known.

use super::accounting::{Accounting, UsageSince, short};
use luna_executors::Interference;
use luna_platform::clock::{Instant, nanos};
use luna_platform::current::{ProcessId, User};
use luna_platform::events::{
    self,
    code::{self, late},
};
use std::fmt;
use std::time::Duration;

/// How many late cycles of a loop are kept: the worst ones.
pub(crate) const KEPT: usize = 8;

/// Unless stated otherwise a cycle is late from this part of its period on, but not below the shortest lateness.
const PART_OF_PERIOD: u64 = 10;
const SHORTEST: u64 = 50_000;

/// A cycle of a loop that began late, and what is known of the cause.
///
/// Several causes may come together, and none need be found: a cycle that is late though nobody ran instead, without a switch or fault, was held up
/// below the program, by an interrupt, the core's sleep, or a hypervisor. Its `Display` is one line.
///
/// ```
/// use luna::prelude::*;
/// use std::time::Duration;
///
/// let mut system = System::new("machine");
/// let main = system.executor("main").build()?;
/// main.process("hog").priority(20).spawn(async {
///     luna::after(Duration::from_millis(15)).await;
///     let end = luna::now() + Duration::from_millis(200);
///     while luna::now() < end {} // past the slot at 20 ms, and more
///     Ok(())
/// })?;
/// main.process("servo").priority(30).spawn(async {
///     let mut tick = luna::periodic("servo", Duration::from_millis(10))?;
///     while tick.next().await.number < 3 {}
///     Ok(())
/// })?;
/// let report = system.run()?;
/// let worst = &report.loops["servo"].late_cycles[0];
/// assert_eq!(worst.ran_instead.as_ref().unwrap().process, "hog");
/// println!("{worst}");
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct LateCycle {
    /// The number of the slot that was served, on its grid.
    pub number: u64,
    /// When the cycle should have begun: the slot that the loop waited for.
    pub slot: Instant,
    /// From then until it did.
    pub lateness: Duration,
    /// How long the loop itself was still busy with the cycle before when the slot came; zero if it waited in time.
    pub own_overrun: Duration,
    /// How long the cycle before ran, if there was one.
    pub previous_run: Option<Duration>,
    /// The process of the same executor that held it longest while this one should have run; for a process on a thread of its own nobody.
    pub ran_instead: Option<RanInstead>,
    /// What the kernel counted of the thread: time in the queue for a core says that another thread ran instead, an involuntary switch that it took
    /// the core away.
    pub usage: Option<UsageSince>,
    /// The core that the cycle began on.
    pub core: Option<usize>,
    /// What a hypervisor took from that core in the samples around, an upper bound: a sample is about a tenth of a second long. `None` where it is
    /// not told, or no sample was taken.
    pub stolen: Option<Duration>,
}

/// Who held an executor while another process should have run: part of [`LateCycle`].
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct RanInstead {
    /// The process.
    pub process: String,
    /// How long its turn was, from begin to end; from the slot on, if the executor was busy and did not look at the clock before that turn.
    pub took: Duration,
}

impl fmt::Display for LateCycle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "slot {}: {} late", self.number, short(self.lateness))?;
        if !self.own_overrun.is_zero() {
            write!(
                f,
                "; the cycle before overran by {}",
                short(self.own_overrun)
            )?;
        }
        if let Some(RanInstead { process, took }) = &self.ran_instead {
            write!(f, "; `{process}` ran instead, for {}", short(*took))?;
        }
        if let Some(stolen) = self.stolen.filter(|stolen| !stolen.is_zero()) {
            write!(f, "; the hypervisor took up to {}", short(stolen))?;
        }
        if let Some(usage) = &self.usage {
            write!(f, "; {usage}")?;
        }
        Ok(())
    }
}

/// What is noted of a late cycle on the path.
#[derive(Debug, Clone, Copy)]
struct Note {
    number: u64,
    slot: Instant,
    began: Instant,
    own_overrun: u64,
    previous_run: Option<u64>,
    interference: Option<Interference>,
    usage: Option<UsageSince>,
    core: Option<usize>,
}

impl Note {
    fn lateness(&self) -> u64 {
        self.began.nanos_since(self.slot)
    }
}

/// A loop's late cycles: the worst ones, in room of fixed size.
#[derive(Debug, Default)]
pub(crate) struct LateCycles {
    /// Later than this many nanoseconds is late.
    threshold: u64,
    /// Whether each cycle is accounted for, and not the late ones alone.
    accounted: bool,
    count: u64,
    accounting: Accounting,
    worst: [Option<Note>; KEPT],
    /// When the loop asked for the cycle that is to begin, and how long the one before ran.
    asked: Instant,
    previous_run: Option<u64>,
    /// Whether the kernel had taken the core away, as far as the last late cycle could tell.
    had_switch: bool,
}

/// What the report knows and the path did not.
pub(crate) trait Witness {
    /// A process' name.
    fn name_of(&self, process: ProcessId) -> Option<String>;
    /// What was stolen from a core.
    fn stolen(&self, core: usize, from: Instant, until: Instant) -> Option<Duration>;
}

impl LateCycles {
    /// A loop of that period begins.
    pub(crate) fn begin(&mut self, period: Duration, now: Instant) {
        *self = Self {
            threshold: (nanos(period) / PART_OF_PERIOD).max(SHORTEST),
            asked: now,
            ..Self::default()
        };
        self.accounting.begin(now);
    }

    /// It was made elsewhere, and begins here now: nothing of what the kernel has counted so far is the loop's.
    pub(crate) fn begin_here(&mut self, now: Instant) {
        self.asked = now;
        if self.threshold != u64::MAX {
            self.accounting.begin(now);
        }
    }

    pub(crate) fn set_threshold(&mut self, threshold: Duration) {
        self.threshold = nanos(threshold);
    }

    pub(crate) fn account_for_each(&mut self) {
        self.accounted = true;
    }

    /// The loop asks for its next cycle; the one before ran so many nanoseconds.
    pub(crate) fn asked(&mut self, now: Instant, previous_run: Option<u64>) {
        self.asked = now;
        // A future that was dropped, and another that asks again: the cycle before is still the same.
        self.previous_run = previous_run.or(self.previous_run);
    }

    /// A cycle begins that was to at `slot`. O(1); three system calls if it is late, or each is accounted for.
    #[inline]
    pub(crate) fn cycle_begins(&mut self, number: u64, slot: Instant, now: Instant) -> bool {
        luna_executors::look_at_clock(now);
        let is_late = now.nanos_since(slot) > self.threshold;
        if is_late {
            self.note(number, slot, now);
        } else if self.accounted {
            self.accounting.begin(now);
        }
        is_late
    }

    /// Tells that the cycle which has just begun is late, with what is known of the cause by now.
    #[cold]
    pub(crate) fn tell(&self, number: u32, slot: Instant, began: Instant) {
        let waited_from = slot.max(self.asked);
        let other = luna_executors::interference(waited_from, began, |turn| {
            luna_platform::current::user() != User::Process(turn.process)
        });
        let cause = if self.asked > slot {
            late::LOOP_ITSELF
        } else if other.is_some() {
            late::OTHER_PROCESS
        } else if self.had_switch {
            late::OTHER_THREAD
        } else {
            late::UNKNOWN
        };
        events::tell(code::LATE, number, || [began.nanos_since(slot), cause]);
    }

    #[cold]
    fn note(&mut self, number: u64, slot: Instant, began: Instant) {
        self.count += 1;
        // Also of one that is not kept: the next is to be counted from here.
        let usage = self.accounting.turn(began);
        self.had_switch = usage.is_some_and(|usage| usage.counted.involuntary_switches > 0);
        let lateness = began.nanos_since(slot);
        let of = |note: &Option<Note>| note.as_ref().map_or(0, Note::lateness);
        // The least of those that are kept makes room: an empty place first.
        let least = self.worst.iter_mut().min_by_key(|note| of(note));
        if let Some(place) = least.filter(|place| of(place) < lateness) {
            let waited_from = slot.max(self.asked);
            let own = luna_platform::current::user();
            // The rest of the turn in which the loop asked too late is nobody else's.
            let is_rest = |turn: &Interference| {
                self.asked > slot && turn.began < self.asked && own == User::Process(turn.process)
            };
            *place = Some(Note {
                number,
                slot,
                began,
                own_overrun: self.asked.nanos_since(slot),
                previous_run: self.previous_run,
                interference: luna_executors::interference(waited_from, began, |turn| {
                    !is_rest(turn)
                }),
                usage,
                core: luna_platform::thread::current_core(),
            });
        }
    }

    /// How many there were, and from which lateness on.
    pub(crate) fn summary(&self) -> (u64, Duration) {
        (self.count, Duration::from_nanos(self.threshold))
    }

    /// The worst first. Not for the real-time path.
    pub(crate) fn reports(&self, witness: &impl Witness) -> Vec<LateCycle> {
        let mut notes: Vec<Note> = self.worst.iter().flatten().copied().collect();
        notes.sort_by_key(|note| std::cmp::Reverse(note.lateness()));
        notes
            .iter()
            .map(|note| LateCycle {
                number: note.number,
                slot: note.slot,
                lateness: Duration::from_nanos(note.lateness()),
                own_overrun: Duration::from_nanos(note.own_overrun),
                previous_run: note.previous_run.map(Duration::from_nanos),
                ran_instead: note.interference.map(|turn| RanInstead {
                    process: witness
                        .name_of(turn.process)
                        .unwrap_or_else(|| format!("process {}", turn.process)),
                    took: turn.ended - turn.began,
                }),
                usage: note.usage,
                core: note.core,
                stolen: note
                    .core
                    .and_then(|core| witness.stolen(core, note.slot, note.began)),
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Nobody;

    impl Witness for Nobody {
        fn name_of(&self, _: ProcessId) -> Option<String> {
            None
        }
        fn stolen(&self, _: usize, from: Instant, until: Instant) -> Option<Duration> {
            Some((until - from) / 2)
        }
    }

    fn at(micros: u64) -> Instant {
        Instant::from_nanos(micros * 1000)
    }

    #[test]
    fn the_worst_are_kept_and_the_first_of_equals() {
        let mut late = LateCycles::default();
        late.begin(Duration::from_millis(1), at(0));
        for number in 1..=100 {
            // 1 to 100 times ten microseconds, mixed; those up to 100 us are in time.
            let slot = 1000 * number;
            late.asked(at(slot - 500), Some(7));
            late.cycle_begins(number, at(slot), at(slot + 10 * (number * 37 % 101)));
        }
        assert_eq!(late.summary(), (90, Duration::from_micros(100)));
        let reports = late.reports(&Nobody);
        let lateness: Vec<u128> = reports.iter().map(|one| one.lateness.as_micros()).collect();
        assert_eq!(lateness, [1000, 990, 980, 970, 960, 950, 940, 930]);
        assert!(reports.iter().all(|one| one.own_overrun.is_zero()));
        assert_eq!(reports[0].previous_run, Some(Duration::from_nanos(7)));
        if reports[0].core.is_some() {
            assert_eq!(reports[0].stolen, Some(Duration::from_micros(500)));
        }
    }

    #[test]
    fn a_loop_that_was_busy_itself_says_so() {
        let mut late = LateCycles::default();
        late.begin(Duration::from_millis(1), at(0));
        late.asked(at(1300), None);
        late.cycle_begins(1, at(1000), at(1310));
        let one = &late.reports(&Nobody)[0];
        assert_eq!(
            (one.own_overrun, one.lateness),
            (Duration::from_micros(300), Duration::from_micros(310))
        );
        let text = one.to_string();
        assert!(
            text.starts_with("slot 1: 310.0 us late; the cycle before overran by 300.0 us"),
            "{text}"
        );
    }

    #[test]
    fn short_periods_have_a_threshold_of_their_own() {
        let mut late = LateCycles::default();
        late.begin(Duration::from_micros(100), at(0));
        late.cycle_begins(1, at(100), at(150));
        assert_eq!(late.summary(), (0, Duration::from_micros(50)));
        late.set_threshold(Duration::from_micros(10));
        late.cycle_begins(2, at(200), at(211));
        assert_eq!(late.summary(), (1, Duration::from_micros(10)));
    }
}
