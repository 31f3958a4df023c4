//! Finds the causes of late cycles while a loop runs, and keeps the worst cycles for the report.

use super::accounting::{Accounting, UsageSince};
use super::late_cycle::{LateCycle, RanInstead, StolenTime};
use luna_core::current::{ProcessId, User};
use luna_core::{Interference, Turn};
use luna_events::{
    self as events,
    code::{self, late},
};
use luna_platform::clock::{Clock, Instant, nanos};
use std::time::Duration;

/// How many late cycles of a loop are kept: the worst ones.
pub(crate) const KEPT: usize = 8;

/// Unless stated otherwise a cycle is late from this part of its period on, but not below the
/// shortest lateness.
const PART_OF_PERIOD: u64 = 10;
const SHORTEST: u64 = 50_000;

/// What is noted of a late cycle on the path.
#[derive(Debug, Clone, Copy)]
struct Note {
    number: u64,
    slot: Instant,
    began: Instant,
    own_overrun: u64,
    previous_run: Option<u64>,
    interference: Option<Interference>,
    /// `own` is the loop's process.
    own: User,
    usage: Option<UsageSince>,
    core: Option<usize>,
}

impl Note {
    fn lateness(&self) -> u64 {
        self.began.nanos_since(self.slot)
    }

    /// The second argument of the event: the cause that explains most, if it explains enough to be
    /// named, its share, and the core.
    fn in_event(&self) -> u64 {
        let other = self.interference.map_or((late::UNKNOWN, 0), |turns| {
            let code = match self.own == User::Process(turns.process) {
                true => late::LOOP_ITSELF,
                false => late::OTHER_PROCESS,
            };
            (code, nanos(turns.held))
        });
        let queued = self.usage.and_then(|usage| usage.queued_since(self.slot));
        let causes = [
            (late::LOOP_ITSELF, self.own_overrun),
            other,
            (late::OTHER_THREAD, queued.map_or(0, nanos)),
        ];
        // Of equals the first.
        let longest = causes
            .into_iter()
            .rev()
            .max_by_key(|(_, explained)| *explained);
        let named = longest.and_then(|(cause, explained)| {
            Some((cause, late::named_percent(explained, self.lateness())?))
        });
        let (cause, percent) = named.unwrap_or((late::UNKNOWN, 0));
        late::argument(cause, percent, self.core)
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
    /// When the loop requested the cycle that is to begin, and how long the one before ran.
    asked: Instant,
    previous_run: Option<u64>,
    /// The second argument of the last late cycle's event.
    in_event: u64,
}

/// What is known to the report and was not known on the path.
pub(crate) struct Witness<'a> {
    /// A process' name.
    pub(crate) name_of: &'a dyn Fn(ProcessId) -> Option<String>,
    /// What was stolen from a core between two instants.
    pub(crate) stolen: &'a dyn Fn(usize, Instant, Instant) -> Option<StolenTime>,
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

    /// It was made elsewhere, and begins here now: the kernel's counts so far do not belong to the
    /// loop.
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

    /// The loop requests its next cycle; the one before ran so many nanoseconds.
    pub(crate) fn asked(&mut self, now: Instant, previous_run: Option<u64>) {
        self.asked = now;
        // A future that was dropped, and another that requests again: the cycle before is still the
        // same.
        self.previous_run = previous_run.or(self.previous_run);
    }

    /// A cycle begins that was to at `slot`. O(1); three system calls if it is late, or each is
    /// accounted for.
    #[inline]
    pub(crate) fn cycle_begins(&mut self, number: u64, slot: Instant, now: Instant) -> bool {
        luna_core::look_at_clock(now);
        let is_late = now.nanos_since(slot) > self.threshold;
        if is_late {
            self.note(number, slot, now);
        } else if self.accounted {
            self.accounting.begin(now);
        }
        is_late
    }

    /// Records the event of the late cycle that has just begun, with its cause.
    #[cold]
    pub(crate) fn report(&self, number: u32, slot: Instant, began: Instant) {
        events::report(code::LATE, number, || {
            [began.nanos_since(slot), self.in_event]
        });
    }

    #[cold]
    fn note(&mut self, number: u64, slot: Instant, began: Instant) {
        self.count += 1;
        let own = luna_core::current::user();
        // The rest of the turn in which the loop asked too late is part of its own overrun.
        let is_rest = |turn: &Turn| {
            self.asked > slot && turn.began < self.asked && own == User::Process(turn.process)
        };
        let waited_from = slot.max(self.asked);
        let interference = luna_core::interference(waited_from, began, |turn| !is_rest(turn));
        // Also of a cycle that is not kept: the next reading counts from here.
        let usage = self.accounting.turn(began);
        // The kernel's counts have no meaning on virtual time, and differ between runs.
        let is_real = !Clock::is_virtual_here();
        let note = Note {
            number,
            slot,
            began,
            own_overrun: self.asked.nanos_since(slot),
            previous_run: self.previous_run,
            interference,
            own,
            usage: usage.filter(|_| is_real),
            core: luna_platform::thread::current_core().filter(|_| is_real),
        };
        self.in_event = note.in_event();
        let of = |note: &Option<Note>| note.as_ref().map_or(0, Note::lateness);
        // The least of those that are kept makes room: an empty place first.
        let least = self.worst.iter_mut().min_by_key(|note| of(note));
        if let Some(place) = least.filter(|place| of(place) < note.lateness()) {
            *place = Some(note);
        }
    }

    /// How many there were, and from which lateness on.
    pub(crate) fn summary(&self) -> (u64, Duration) {
        (self.count, Duration::from_nanos(self.threshold))
    }

    /// The worst first. Not for the real-time path.
    pub(crate) fn reports(&self, witness: &Witness<'_>) -> Vec<LateCycle> {
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
                    process: (witness.name_of)(turn.process)
                        .unwrap_or_else(|| format!("process {}", turn.process)),
                    is_own: note.own == User::Process(turn.process),
                    took: turn.held,
                }),
                usage: note.usage,
                core: note.core,
                stolen: note
                    .core
                    .and_then(|core| (witness.stolen)(core, note.slot, note.began)),
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Knows no name, and of each time that half of it was stolen at least.
    const NOBODY: Witness<'static> = Witness {
        name_of: &|_| None,
        stolen: &|_, from, until| {
            Some(StolenTime {
                at_least: (until - from) / 2,
                at_most: until - from,
            })
        },
    };

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
        let reports = late.reports(&NOBODY);
        let lateness: Vec<u128> = reports.iter().map(|one| one.lateness.as_micros()).collect();
        assert_eq!(lateness, [1000, 990, 980, 970, 960, 950, 940, 930]);
        assert!(reports.iter().all(|one| one.own_overrun.is_zero()));
        assert_eq!(reports[0].previous_run, Some(Duration::from_nanos(7)));
        if reports[0].core.is_some() {
            let stolen = reports[0].stolen.unwrap();
            assert_eq!(stolen.at_least, Duration::from_micros(500));
        }
    }

    #[test]
    fn a_loop_that_was_busy_itself_says_so() {
        let mut cycles = LateCycles::default();
        cycles.begin(Duration::from_millis(1), at(0));
        cycles.asked(at(1300), None);
        cycles.cycle_begins(1, at(1000), at(1310));
        let one = &cycles.reports(&NOBODY)[0];
        assert_eq!(
            (one.own_overrun, one.lateness),
            (Duration::from_micros(300), Duration::from_micros(310))
        );
        let text = one.to_string();
        assert!(
            text.starts_with("slot 1: 310.0 µs late; the cycle before overran by 300.0 µs (96 %)"),
            "{text}"
        );
        assert_eq!(
            (late::cause(cycles.in_event), late::percent(cycles.in_event)),
            (late::LOOP_ITSELF, 96)
        );
    }

    #[test]
    fn the_event_names_no_cause_that_explains_little() {
        let mut cycles = LateCycles::default();
        cycles.begin(Duration::from_millis(1), at(0));
        cycles.asked(at(1040), None);
        cycles.cycle_begins(1, at(1000), at(1900));
        let reported = cycles.in_event;
        assert_eq!(
            (late::cause(reported), late::percent(reported)),
            (late::UNKNOWN, 0)
        );
        let text = cycles.reports(&NOBODY)[0].to_string();
        assert!(!text.contains("overran"), "{text}");
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
