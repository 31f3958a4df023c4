use super::*;
use std::cell::{Cell, RefCell};

const MS: u64 = 1_000_000;

/// Timers that remember how they are armed, and a clock that is set.
#[derive(Default)]
struct Fake(RefCell<Vec<(usize, u64, u64)>>, Cell<u64>);

impl Arm for Fake {
    fn arm(&self, base: usize, first: Instant, period: u64) {
        self.disarm(base);
        self.0.borrow_mut().push((base, first.as_nanos(), period));
    }

    fn now(&self) -> Instant {
        Instant::from_nanos(self.1.get())
    }

    fn disarm(&self, base: usize) {
        self.0.borrow_mut().retain(|&(other, ..)| other != base);
    }
}

impl Fake {
    /// The periods that tick, in milliseconds.
    fn periods(&self) -> Vec<u64> {
        let mut periods: Vec<u64> = self
            .0
            .borrow()
            .iter()
            .map(|&(.., period)| period / MS)
            .collect();
        periods.sort_unstable();
        periods
    }

    /// Whether the timer of the group `base` expires at `at`.
    fn ticks_at(&self, base: usize, at: u64) -> bool {
        let armed = self.0.borrow();
        armed.iter().any(|&(other, first, period)| {
            other == base && at >= first && (at - first).is_multiple_of(period)
        })
    }
}

/// A loop: its place, and its next slot.
struct Loop(Place, u64);

impl Loop {
    fn new(period: u64, first: u64) -> Self {
        Loop(Place::new(period), first)
    }

    /// Waits for its next slot: a tick comes then, if it has a place.
    fn next(&mut self, timer_groups: &TimerGroups, timers: &Fake) -> Option<usize> {
        timer_groups.settle(&mut self.0, Instant::from_nanos(self.1), timers);
        if let Some(base) = self.0.base() {
            assert!(timers.ticks_at(base, self.1), "no tick at {}", self.1);
        }
        self.1 += self.0.period;
        self.0.base()
    }
}

#[test]
fn multiples_in_phase_ride_on_one_timer() {
    let (timer_groups, timers) = (TimerGroups::new(4), Fake::default());
    let mut loops = [(1, 7), (2, 7), (10, 7), (10, 12)]
        .map(|(period, first)| Loop::new(period * MS, first * MS));
    for a_loop in &mut loops {
        assert_eq!(a_loop.next(&timer_groups, &timers), Some(0));
    }
    assert_eq!(timers.periods(), [1]);
    // Out of phase, and no multiple.
    let mut shifted = Loop::new(2 * MS, 7 * MS + 1);
    assert_eq!(shifted.next(&timer_groups, &timers), Some(1));
    let mut other = Loop::new(1_500_000, 8 * MS);
    assert_eq!(other.next(&timer_groups, &timers), Some(2));
}

#[test]
fn a_finer_period_takes_the_coarser_ones_along() {
    let (timer_groups, timers) = (TimerGroups::new(4), Fake::default());
    let mut coarse = [10, 15].map(|period| Loop::new(period * MS, 30 * MS));
    for a_loop in &mut coarse {
        a_loop.next(&timer_groups, &timers);
    }
    assert_eq!(timers.periods(), [10, 15]);
    let mut fine = Loop::new(5 * MS, 30 * MS);
    fine.next(&timer_groups, &timers);
    assert_eq!(timers.periods(), [5, 10, 15], "until they wait again");
    let moved = coarse
        .each_mut()
        .map(|a_loop| a_loop.next(&timer_groups, &timers));
    assert_eq!(moved, [fine.0.base(); 2]);
    assert_eq!(timers.periods(), [5]);
    // And without it they have timers of their own again.
    timer_groups.vacate(&mut fine.0, &timers);
    for a_loop in &mut coarse {
        a_loop.next(&timer_groups, &timers);
    }
    assert_eq!(timers.periods(), [10, 15]);
    for a_loop in &mut coarse {
        timer_groups.vacate(&mut a_loop.0, &timers);
    }
    assert_eq!(timers.periods(), [0; 0]);
}

#[test]
fn without_room_a_loop_has_no_place_until_somebody_goes() {
    let (timer_groups, timers) = (TimerGroups::new(2), Fake::default());
    let mut loops = [2, 3, 5].map(|period| Loop::new(period * MS, 30 * MS));
    let places = loops
        .each_mut()
        .map(|a_loop| a_loop.next(&timer_groups, &timers));
    assert_eq!(places, [Some(0), Some(1), None]);
    assert_eq!(timer_groups.refused(), 1);
    // It does not ask in every cycle.
    assert_eq!(loops[2].next(&timer_groups, &timers), None);
    assert_eq!(timer_groups.refused(), 1);
    timer_groups.vacate(&mut loops[0].0, &timers);
    assert_eq!(loops[2].next(&timer_groups, &timers), Some(0));
    // One that is stale ticks on as long as there is no better place.
    let mut rider = Loop::new(6 * MS, 30 * MS);
    assert_eq!(rider.next(&timer_groups, &timers), Some(1));
    timer_groups.vacate(&mut loops[1].0, &timers);
    assert_eq!(rider.next(&timer_groups, &timers), Some(1));
    assert_eq!(timers.periods(), [3, 5]);
    timer_groups.vacate(&mut loops[2].0, &timers);
    assert_eq!(rider.next(&timer_groups, &timers), Some(0));
    assert_eq!(timers.periods(), [6]);
}

#[test]
fn a_loop_whose_slots_move_finds_a_place_for_them() {
    let (timer_groups, timers) = (TimerGroups::new(4), Fake::default());
    let mut a_loop = Loop::new(2 * MS, 10 * MS);
    a_loop.next(&timer_groups, &timers);
    a_loop.1 += 77;
    a_loop.next(&timer_groups, &timers);
    a_loop.next(&timer_groups, &timers);
    assert_eq!(timers.0.borrow().len(), 1);
}

#[test]
fn any_loops_that_come_and_go_have_their_ticks() {
    let (timer_groups, timers) = (TimerGroups::new(6), Fake::default());
    let now = &timers.1;
    now.set(1_200 * MS);
    let mut loops: Vec<Loop> = Vec::new();
    let mut state = 20_261_122_u64;
    let mut below = |end: u64| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % end
    };
    let mut placed = 0;
    for _ in 0..20_000 {
        now.set(now.get() + below(MS / 2));
        match below(8) {
            0 if loops.len() < 12 => {
                let period = [1, 2, 3, 4, 6, 10, 12][below(7) as usize] * MS;
                let phase = [0, 0, 0, 500_000][below(4) as usize];
                loops.push(Loop::new(period, 1_200 * MS + phase));
            }
            1 if !loops.is_empty() => {
                let mut gone = loops.swap_remove(below(loops.len() as u64) as usize);
                timer_groups.vacate(&mut gone.0, &timers);
            }
            _ if !loops.is_empty() => {
                let one = below(loops.len() as u64) as usize;
                let a_loop = &mut loops[one];
                while a_loop.1 <= now.get() {
                    a_loop.1 += a_loop.0.period;
                }
                // `next` looks whether a tick comes.
                placed += u32::from(a_loop.next(&timer_groups, &timers).is_some());
                a_loop.1 -= a_loop.0.period;
            }
            _ => {}
        }
    }
    assert!(placed > 5_000, "{placed}");
    for a_loop in &mut loops {
        timer_groups.vacate(&mut a_loop.0, &timers);
    }
    assert!(timers.0.borrow().is_empty());
    assert!(
        timer_groups
            .rows
            .lock()
            .iter()
            .all(|row| row.members == 0 && row.own == 0)
    );
}

#[test]
fn a_suspended_manager_reads_all_ticks_at_once() {
    let counted = Counted::default();
    counted.begin(10, 3);
    counted.expired(1, Instant::from_nanos(105));
    counted.expired(1_000, Instant::from_nanos(10_107));
    let [ticks, missed, longest] =
        [&counted.ticks, &counted.missed, &counted.longest].map(|one| one.load(Ordering::Relaxed));
    assert_eq!((ticks, missed, longest), (1_001, 999, 9_994));
}
