//! Which loops share a timer: timer groups. On the ticks of a group lie the slots of several loops.
//!
//! A timer group (*base* in the code) has the period of a loop of its own. Loops with a multiple of
//! that period, and with slots on its ticks, join it. When a finer group comes that carries another
//! one's ticks, or the last loop of a group's own period goes, that group is *stale*: no loop joins
//! it, and each of its loops looks for another place when it waits for the next time. So at most
//! one timer ticks where one is enough, but for the period in which loops move, and no node is ever
//! moved from list to list.

use luna_core::tick_list::TickList;
use luna_platform::clock::Instant;
use luna_platform::lock::PiLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// The timers of the timer groups.
pub(super) trait Arm {
    /// The timer of the group `base` expires at `first`, which may have passed, and every `period`
    /// nanoseconds from then on.
    fn arm(&self, base: usize, first: Instant, period: u64);
    /// The timer expires no more.
    fn disarm(&self, base: usize);
    /// The time on their clock.
    fn now(&self) -> Instant;
}

pub(super) struct TimerGroups {
    rows: PiLock<Box<[Row]>>,
    timer_groups: Box<[TimerGroup]>,
    /// Changes when a loop that has a place may find a better one.
    generation: AtomicU64,
    /// How often there was no room.
    refused: AtomicU64,
}

/// The state of a timer group under the lock.
#[derive(Debug, Clone, Copy, Default)]
struct Row {
    /// 0 if it was never used.
    period: u64,
    /// Where its ticks lie: the remainder of their instants by the period.
    offset: u64,
    members: u32,
    /// The loops that have its period as their own.
    own: u32,
    is_stale: bool,
}

/// The state of a timer group that the thread and the loops use without the lock.
pub(super) struct TimerGroup {
    pub(super) list: TickList,
    pub(super) counted: Counted,
}

/// The counters of a timer group: written by the manager's thread alone.
#[derive(Debug, Default)]
pub(super) struct Counted {
    pub(super) period: AtomicU64,
    offset: AtomicU64,
    pub(super) ticks: AtomicU64,
    pub(super) missed: AtomicU64,
    pub(super) longest: AtomicU64,
}

/// The place of a loop, or of a periodic callback, in a timer group.
#[derive(Debug)]
pub(super) struct Place {
    period: u64,
    offset: u64,
    base: Option<usize>,
    generation: u64,
    /// Whether it was ever looked for.
    is_settled: bool,
}

impl Place {
    /// Not in a group yet, for slots that are `period` nanoseconds apart.
    pub(super) fn new(period: u64) -> Self {
        Self {
            period,
            offset: 0,
            base: None,
            generation: 0,
            is_settled: false,
        }
    }

    /// The number of its timer group.
    pub(super) fn base(&self) -> Option<usize> {
        self.base
    }
}

impl Row {
    /// Whether a tick comes at each slot of a loop.
    fn carries(&self, period: u64, offset: u64) -> bool {
        period.is_multiple_of(self.period) && offset % self.period == self.offset
    }

    fn is_open(&self) -> bool {
        self.members > 0 && !self.is_stale
    }

    fn is_of(&self, period: u64, offset: u64) -> bool {
        self.period == period && self.offset == offset
    }
}

impl TimerGroups {
    pub(super) fn new(most: usize) -> Self {
        let base = |_| TimerGroup {
            list: TickList::new(),
            counted: Counted::default(),
        };
        Self {
            rows: PiLock::new(vec![Row::default(); most].into()),
            timer_groups: (0..most).map(base).collect(),
            generation: AtomicU64::new(0),
            refused: AtomicU64::new(0),
        }
    }

    pub(super) fn base(&self, number: usize) -> &TimerGroup {
        &self.timer_groups[number]
    }

    /// All groups that were ever used.
    pub(super) fn used(&self) -> impl Iterator<Item = &TimerGroup> {
        let is_used = |base: &&TimerGroup| base.counted.period.load(Ordering::Relaxed) > 0;
        self.timer_groups.iter().filter(is_used)
    }

    /// How often a loop or callback found no room.
    pub(super) fn refused(&self) -> u64 {
        self.refused.load(Ordering::Relaxed)
    }

    pub(super) fn list(&self, place: &Place) -> Option<&TickList> {
        Some(&self.timer_groups[place.base?].list)
    }

    /// No timer fires any more.
    pub(super) fn close(&self) {
        self.timer_groups.iter().for_each(|base| base.list.close());
    }

    /// Ensures that a tick comes at `at`, the next slot of the loop that has `place`, if there is
    /// room. O(1) where nothing has changed.
    #[inline]
    pub(super) fn settle(&self, place: &mut Place, at: Instant, timers: &impl Arm) {
        let generation = self.generation.load(Ordering::Acquire);
        let offset = at.as_nanos() % place.period;
        if !(place.is_settled && place.generation == generation && place.offset == offset) {
            self.look_for_place(place, at, offset, timers);
        }
    }

    #[cold]
    fn look_for_place(&self, place: &mut Place, at: Instant, offset: u64, timers: &impl Arm) {
        let mut rows = self.rows.lock();
        let has_moved = place.offset != offset;
        place.is_settled = true;
        place.offset = offset;
        if let Some(base) = place.base {
            if !has_moved && !rows[base].is_stale {
                place.generation = self.generation.load(Ordering::Relaxed);
                return;
            }
            if has_moved {
                self.leave(&mut rows, base, place.period, timers);
                place.base = None;
            }
        }
        let joined = self.join(&mut rows, place.period, at, timers);
        if let Some(joined) = joined {
            if let Some(former) = place.base.replace(joined) {
                self.leave(&mut rows, former, place.period, timers);
            }
        } else if place.base.is_none() {
            self.refused.fetch_add(1, Ordering::Relaxed);
        }
        // Also for a loop that stays where it is for want of room: it looks again when something
        // has changed.
        place.generation = self.generation.load(Ordering::Relaxed);
    }

    /// Leaves the place.
    pub(super) fn vacate(&self, place: &mut Place, timers: &impl Arm) {
        place.is_settled = false;
        if let Some(base) = place.base.take() {
            self.leave(&mut self.rows.lock(), base, place.period, timers);
        }
    }

    fn join(&self, rows: &mut [Row], period: u64, at: Instant, timers: &impl Arm) -> Option<usize> {
        let offset = at.as_nanos() % period;
        let open = |row: &Row| row.is_open() && row.carries(period, offset);
        if let Some(base) = rows.iter().position(open) {
            rows[base].members += 1;
            rows[base].own += u32::from(rows[base].period == period);
            return Some(base);
        }
        let free = |wanted: &dyn Fn(&Row) -> bool| {
            let fits = |row: &Row| row.members == 0 && wanted(row);
            rows.iter().position(fits)
        };
        // First a group that had the same ticks: its counters continue. Then an unused one, then
        // any.
        let base = free(&|row| row.is_of(period, offset))
            .or_else(|| free(&|row| row.period == 0))
            .or_else(|| free(&|_| true))?;
        if !rows[base].is_of(period, offset) {
            self.timer_groups[base].counted.begin(period, offset);
        }
        let own = Row {
            period,
            offset,
            members: 1,
            own: 1,
            is_stale: false,
        };
        let mut others_move = false;
        for row in rows.iter_mut().filter(|row| row.is_open()) {
            if own.carries(row.period, row.offset) {
                row.is_stale = true;
                others_move = true;
            }
        }
        rows[base] = own;
        if others_move {
            self.generation.fetch_add(1, Ordering::Release);
        }
        // From the next tick on, which may come before this loop's next slot: other loops with
        // slots there join.
        let ahead = at.nanos_since(timers.now()) / period;
        let first = Instant::from_nanos(at.as_nanos() - ahead * period);
        timers.arm(base, first, period);
        Some(base)
    }

    fn leave(&self, rows: &mut [Row], base: usize, period: u64, timers: &impl Arm) {
        let row = &mut rows[base];
        row.members -= 1;
        row.own -= u32::from(row.period == period);
        let others_look = if row.members == 0 {
            row.is_stale = false;
            timers.disarm(base);
            // A loop that found no room may find some.
            self.refused() > 0
        } else {
            row.own == 0 && !std::mem::replace(&mut row.is_stale, true)
        };
        if others_look {
            self.generation.fetch_add(1, Ordering::Release);
        }
    }
}

impl Counted {
    /// From now on the timer belongs to another group.
    fn begin(&self, period: u64, offset: u64) {
        self.period.store(period, Ordering::Relaxed);
        self.offset.store(offset, Ordering::Relaxed);
        for counter in [&self.ticks, &self.missed, &self.longest] {
            counter.store(0, Ordering::Relaxed);
        }
    }

    /// Its timer has expired `times` times when it was read at `now`.
    pub(super) fn expired(&self, times: u64, now: Instant) {
        self.ticks.fetch_add(times, Ordering::Relaxed);
        self.missed.fetch_add(times - 1, Ordering::Relaxed);
        let period = self.period.load(Ordering::Relaxed).max(1);
        let offset = self.offset.load(Ordering::Relaxed);
        // From the first of those ticks on.
        let since_last = now.as_nanos().saturating_sub(offset) % period;
        let late = since_last.saturating_add(period.saturating_mul(times - 1));
        self.longest.fetch_max(late, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests;
