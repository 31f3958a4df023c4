//! What the manager counts of the slots that it wakes loops for.

use super::report::TickReport;
use luna_platform::clock::Instant;
use luna_platform::lock::PiLock;
use std::time::Duration;

/// The counters of each period.
pub(super) struct TickCounts {
    rows: PiLock<Vec<Row>>,
}

struct Row {
    period: u64,
    /// The last slot that came, in nanoseconds; 0 for none.
    last: u64,
    counted: TickReport,
}

impl TickCounts {
    /// With room for so many periods.
    pub(super) fn with_room_for(periods: usize) -> Self {
        Self {
            rows: PiLock::new(Vec::with_capacity(periods)),
        }
    }

    /// The number of the counters of a period. If there is no room, one that nothing is counted
    /// under. O(periods), no allocation.
    pub(super) fn number_of(&self, period: u64) -> u32 {
        let mut rows = self.rows.lock();
        let there = rows.iter().position(|row| row.period == period);
        let number = there.unwrap_or(rows.len());
        if number == rows.len() && rows.len() < rows.capacity() {
            rows.push(Row {
                period,
                last: 0,
                counted: TickReport {
                    period: Duration::from_nanos(period),
                    ..TickReport::default()
                },
            });
        }
        number as u32
    }

    /// The manager has found at `now` that `slot` has come. O(1).
    pub(super) fn came(&self, number: u32, slot: Instant, now: Instant) {
        let mut rows = self.rows.lock();
        let Some(row) = rows.get_mut(number as usize) else {
            return;
        };
        let late = now.nanos_since(slot);
        row.counted.latest = row.counted.latest.max(Duration::from_nanos(late));
        let missed = late / row.period;
        let lasts = slot
            .plus_nanos(missed.saturating_mul(row.period))
            .as_nanos();
        // Several loops wait for one slot.
        if lasts > row.last {
            let since = match row.last {
                0 => 0,
                last => (lasts - last) / row.period,
            };
            row.counted.ticks += since.max(missed + 1);
            row.counted.missed += missed;
            row.last = lasts;
        }
    }

    /// Not for the real-time path.
    pub(super) fn reports(&self) -> Vec<TickReport> {
        let rows = self.rows.lock();
        rows.iter().map(|row| row.counted.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(nanos: u64) -> Instant {
        Instant::from_nanos(nanos)
    }

    #[test]
    fn a_slot_counts_once_and_those_that_passed_are_missed() {
        let counts = TickCounts::with_room_for(2);
        let number = counts.number_of(10);
        assert_eq!((counts.number_of(10), counts.number_of(7)), (number, 1));
        // Two loops of one slot; one slot that no loop waited for; a read three slots late.
        for (slot, now) in [(100, 103), (100, 103), (120, 121), (130, 164)] {
            counts.came(number, at(slot), at(now));
        }
        // There is no room for it.
        counts.came(counts.number_of(3), at(100), at(200));
        let reports = counts.reports();
        let one = &reports[0];
        assert_eq!((one.ticks, one.missed), (7, 3));
        assert_eq!(one.latest, Duration::from_nanos(34));
        assert_eq!((reports.len(), reports[1].ticks), (2, 0));
    }
}
