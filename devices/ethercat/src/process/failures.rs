//! Cycles that failed, and how many there may be.

use crate::Fault;

/// By how much a failed cycle weighs more than a good one.
const WEIGHT: u32 = 10;

/// Failed cycles: each fills a bucket by [`WEIGHT`], each good one takes 1 out.
#[derive(Debug)]
pub(super) struct Failures {
    limit: u32,
    level: u32,
    in_a_row: u32,
    /// By their cause, since the bucket was empty.
    missed: u32,
    miscounted: u32,
    /// The working counter if all take part.
    expected: u16,
    /// The last wrong working counter, and the first subdevice that did not answer then.
    counter: Option<u16>,
    silent: Option<usize>,
}

impl Failures {
    /// For `tolerated` failed cycles in a row.
    pub(super) fn new(tolerated: u32, expected: u16) -> Self {
        Self {
            limit: tolerated.saturating_mul(WEIGHT),
            level: 0,
            in_a_row: 0,
            missed: 0,
            miscounted: 0,
            expected,
            counter: None,
            silent: None,
        }
    }

    pub(super) fn in_a_row(&self) -> u32 {
        self.in_a_row
    }

    pub(super) fn good(&mut self) {
        self.in_a_row = 0;
        self.level = self.level.saturating_sub(1);
        if self.level == 0 {
            (self.missed, self.miscounted) = (0, 0);
            (self.counter, self.silent) = (None, None);
        }
    }

    /// # Errors
    ///
    /// These are too many.
    pub(super) fn missed(&mut self) -> Result<(), Fault> {
        self.missed = self.missed.saturating_add(1);
        self.failed()
    }

    /// # Errors
    ///
    /// These are too many.
    pub(super) fn miscounted(&mut self, counter: u16, silent: Option<usize>) -> Result<(), Fault> {
        self.miscounted = self.miscounted.saturating_add(1);
        self.counter = Some(counter);
        self.silent = silent;
        self.failed()
    }

    fn failed(&mut self) -> Result<(), Fault> {
        self.in_a_row = self.in_a_row.saturating_add(1);
        self.level = self.level.saturating_add(WEIGHT);
        match self.level > self.limit {
            true => Err(Fault::TooManyErrors {
                in_a_row: self.in_a_row,
                missed: self.missed,
                miscounted: self.miscounted,
                counter: self.counter,
                expected: self.expected,
                silent: self.silent,
            }),
            false => Ok(()),
        }
    }
}
