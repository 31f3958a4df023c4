//! An encoder's counter, and the time stamps.

use super::configuration::CLOCK_LOW;
use hostmot2::registers::encoder;

/// The writable bits of the control register; the three lowest are the lines.
const WRITABLE: u16 = !0b111;

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Encoder {
    /// Where the machine is.
    turned: i64,
    /// Where it was when the counter was cleared.
    cleared: i64,
    stamp: u16,
    control: u16,
    latched: u16,
    /// Counts from index to index.
    index: Option<u32>,
}

impl Encoder {
    pub(super) fn turn(&mut self, count: i64, stamp: u16) {
        if count == self.turned {
            return;
        }
        if let Some(index) = self.index
            && self.control & encoder::LATCH_ON_INDEX != 0
        {
            let index = i64::from(index);
            let (from, to) = (self.turned.div_euclid(index), count.div_euclid(index));
            if from != to {
                // The first one that is passed.
                let passed = if to > from { from + 1 } else { from } * index;
                self.latched = passed.wrapping_sub(self.cleared) as u16;
                if self.control & encoder::JUST_ONCE != 0 {
                    self.control &= !encoder::LATCH_ON_INDEX;
                }
            }
        }
        self.turned = count;
        self.stamp = stamp;
    }

    pub(super) fn set_index(&mut self, counts: u32) {
        self.index = (counts > 0).then_some(counts);
    }

    pub(super) fn disturb(&mut self) {
        self.control |= encoder::QUADRATURE_ERROR;
    }

    pub(super) fn clear(&mut self) {
        self.cleared = self.turned;
    }

    pub(super) fn set_control(&mut self, control: u16) {
        self.control = control & WRITABLE;
    }

    pub(super) fn count_register(&self) -> u32 {
        let count = self.turned.wrapping_sub(self.cleared) as u16;
        u32::from(self.stamp) << 16 | u32::from(count)
    }

    pub(super) fn control_register(&self) -> u32 {
        // Two lines, a quarter of a period apart.
        let lines = match self.turned.rem_euclid(4) {
            0 => 0b00,
            1 => 0b01,
            2 => 0b11,
            _ => 0b10,
        };
        u32::from(self.latched) << 16 | u32::from(self.control) | lines
    }
}

/// The counter of time stamps.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Stamps {
    divider: u16,
}

impl Stamps {
    pub(super) fn set_divider(&mut self, divider: u32) {
        self.divider = divider as u16;
    }

    pub(super) fn divider(&self) -> u32 {
        self.divider.into()
    }

    pub(super) fn at(&self, now: u64) -> u16 {
        let by = match self.divider {
            0x8000.. => 1,
            divider => u128::from(divider) + 2,
        };
        (u128::from(now) * u128::from(CLOCK_LOW) / 1_000_000_000 / by) as u16
    }
}
