//! The times of several recordings as those of the first one's clock.

use super::selection::Filter;
use crate::args::{Clock, Convert};
use crate::failure::{Failure, failed};

/// So much may the clock of the day be set, relative to the monotonic one, between the recordings
/// of one computer, without a word about it: 1 s.
const SET: i128 = 1_000_000_000;

/// What is to be added to the times of each recording, in ns.
pub(super) fn shifts(arguments: &Convert, filters: &[Filter]) -> Result<Vec<i64>, Failure> {
    let first = filters.first().and_then(|filter| filter.epoch);
    let asked = std::iter::once(0).chain(arguments.offset.iter().copied());
    let asked = asked.chain(std::iter::repeat(0));
    let all = arguments.files.iter().zip(filters).zip(asked);
    all.map(|((path, filter), asked)| {
        // Between the clocks of the two, if their times of the day are right.
        let apart = first.zip(filter.epoch).map(|(first, own)| own - first);
        let shift = match (arguments.clock, apart) {
            (Clock::Monotonic, apart) => {
                if asked == 0 && apart.is_some_and(|apart| apart.abs() > SET) {
                    eprintln!(
                        "luna: {}: its clock differs from that of the first recording: if it is of another computer, or from before a restart of this one, use --clock wall",
                        path.display()
                    );
                }
                0
            }
            (Clock::Wall, Some(apart)) => apart,
            (Clock::Wall, None) => {
                let why = "it, or the first recording, has no time of the day: use --offset";
                return Err(failed(path)(why));
            }
        };
        let shift = shift.saturating_add(asked.into());
        Ok(shift.clamp(i64::MIN.into(), i64::MAX.into()) as i64)
    })
    .collect()
}

/// A time on the common clock.
pub(super) fn shifted(time: u64, shift: i64) -> u64 {
    time.saturating_add_signed(shift)
}
