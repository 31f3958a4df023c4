//! Compares counts with the recorded ones.

use crate::recorded::Figures;

/// How much an operation's instructions may differ from the recorded ones, as a fraction of these.
const TOLERANCE: f64 = 0.03;

/// How much its atomic instructions may differ: half of the last recorded digit. An operation that
/// starts and ends processes hands what they leave to a thread that frees it, and how often depends
/// on when that thread runs. So its count is no whole number, and may differ by one.
pub(crate) fn rounding(atomics: f64) -> f64 {
    let is_whole = (atomics - atomics.round()).abs() < 0.02;
    if is_whole { 0.01 } else { 1.0 }
}

/// The verdict on an operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// As recorded.
    Same,
    /// Fewer atomic instructions than recorded: no failure, but record it, so that they do not come
    /// back.
    FewerAtomics,
    /// Fewer instructions than recorded, beyond the tolerance: as for `FewerAtomics`.
    Faster,
    /// It is recorded with another C library, which has a share in it.
    OtherLibrary,
    /// It is not recorded.
    New,
    /// More instructions than recorded, by more than may be.
    Slower,
    /// More atomic instructions than recorded.
    MoreAtomics,
}

impl Verdict {
    /// Judges.
    pub(crate) fn of(recorded: Option<Figures>, now: Figures) -> Verdict {
        let Some(old) = recorded else {
            return Verdict::New;
        };
        let change = change(old, now);
        if now.atomics > old.atomics + rounding(old.atomics) {
            Verdict::MoreAtomics
        } else if change > TOLERANCE {
            Verdict::Slower
        } else if change < -TOLERANCE {
            Verdict::Faster
        } else if now.atomics < old.atomics - rounding(old.atomics) {
            Verdict::FewerAtomics
        } else {
            Verdict::Same
        }
    }

    /// Whether the change has to be made deliberately, by recording it.
    pub(crate) fn is_failure(self) -> bool {
        !matches!(
            self,
            Verdict::Same | Verdict::FewerAtomics | Verdict::Faster | Verdict::OtherLibrary
        )
    }

    pub(crate) fn text(self) -> &'static str {
        match self {
            Verdict::Same => "",
            Verdict::FewerAtomics => "fewer atomics: record it",
            Verdict::OtherLibrary => "not judged: another C library",
            Verdict::New => "not recorded",
            Verdict::Slower => "MORE INSTRUCTIONS",
            Verdict::Faster => "fewer instructions: record it",
            Verdict::MoreAtomics => "MORE ATOMICS",
        }
    }
}

/// The change of instructions, as a share of the recorded ones.
pub(crate) fn change(old: Figures, now: Figures) -> f64 {
    now.instructions / old.instructions - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(instructions: f64, atomics: f64) -> Verdict {
        let old = Figures {
            instructions: 1000.0,
            atomics: 2.0,
        };
        Verdict::of(
            Some(old),
            Figures {
                instructions,
                atomics,
            },
        )
    }

    #[test]
    fn more_instructions_beyond_the_tolerance_fail_and_fewer_do_not() {
        assert_eq!(verdict(1029.0, 2.0), Verdict::Same);
        assert_eq!(verdict(971.0, 2.0), Verdict::Same);
        assert_eq!(verdict(1031.0, 2.0), Verdict::Slower);
        assert_eq!(verdict(969.0, 2.0), Verdict::Faster);
        assert!(Verdict::Slower.is_failure() && !Verdict::Faster.is_failure());
    }

    #[test]
    fn atomics_may_fall_and_not_rise() {
        assert_eq!(verdict(1000.0, 2.004), Verdict::Same);
        assert_eq!(verdict(1000.0, 2.02), Verdict::MoreAtomics);
        assert_eq!(verdict(900.0, 3.0), Verdict::MoreAtomics);
        assert_eq!(verdict(1000.0, 1.0), Verdict::FewerAtomics);
        assert_eq!(rounding(4.0), 0.01);
        assert_eq!(rounding(4.37), 1.0);
        assert!(Verdict::MoreAtomics.is_failure());
        assert!(!Verdict::FewerAtomics.is_failure());
    }

    #[test]
    fn what_is_not_recorded_fails() {
        let now = Figures {
            instructions: 1.0,
            atomics: 0.0,
        };
        assert!(Verdict::of(None, now).is_failure());
    }
}
