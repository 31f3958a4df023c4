//! The grid that a loop's slots lie on, and its change.

use super::{Periodic, Prepared};
use crate::time::grid::Grid;
use luna_core::events::{self, Kind};
use luna_platform::clock::Instant;

impl Periodic {
    /// Begins a loop that was made before its process was here. O(processes with parameters).
    #[cold]
    pub(super) fn begin_prepared(&mut self, now: Instant) {
        let begins = match self.prepared.take() {
            Some(Prepared::AtStart) => self.scope.start(),
            _ => now,
        };
        let origin = match self.scope.manager() {
            Some(manager) => manager.slot_before(begins, self.period),
            None => begins,
        };
        self.grid = Grid::new(origin, self.period);
        self.grid.shift_behind(self.number, self.trim.nanos());
        self.parameters = self.scope.parameters();
        let name = self.name();
        let statistics = self.statistics();
        events::name_in_ring(Kind::Loop, statistics.number, name.as_str());
        statistics.late.begin_here(now);
    }

    /// Closes the present grid, and joins the one that the loops of its period have in common.
    pub(super) fn join_common_grid(&mut self, phase: u64, now: Instant) {
        self.close_grid(self.come);
        self.begin_grid(Grid::joined_at(
            self.scope.start().plus_nanos(phase),
            self.period,
            now,
        ));
        self.grid.shift_behind(self.number, self.trim.nanos());
    }

    /// Closes the present grid and begins one on which slot 1 is due at `now`; gives how many slots
    /// were missed on the old one. The slot that lasts at `now` is not among them: it is served
    /// late, as the first of the new grid.
    pub(super) fn leave_grid(&mut self, now: Instant) -> u64 {
        let first = now - self.period();
        let missed = self.close_grid(self.grid.last_at(first));
        self.begin_grid(Grid::new(first, self.period));
        missed
    }

    fn begin_grid(&mut self, grid: Grid) {
        self.grid = grid;
        self.number = grid.joined();
        self.come = self.number;
    }

    /// Accounts for all slots of the present grid up to `last`: those that were not served are
    /// missed. Gives their number.
    pub(super) fn close_grid(&mut self, last: u64) -> u64 {
        let elapsed = self.grid.elapsed(last);
        let unserved = last.saturating_sub(self.number);
        let statistics = self.statistics();
        statistics.slots_elapsed += elapsed;
        statistics.missed += unserved;
        unserved
    }
}
