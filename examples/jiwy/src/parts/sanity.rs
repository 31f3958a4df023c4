//! The safety layer between the controllers and the motors (the thesis' *SanityCheck*): for any
//! output of a controller, a motor gets a duty that damages neither it nor the head. Three safety
//! blocks in a row, each a process of its own in the network.

use luna_safety_blocks::{Block, EndStop, Limit, RateLimit, Sample, SettingError, Verdict};
use std::time::Duration;

/// What the layer lets through on one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// The largest duty, either way.
    pub duty: f64,
    /// The largest change of the duty, in 1/s.
    pub slew: f64,
    /// Beyond plus and minus this measured angle (rad), no duty leads further out.
    pub guard: f64,
}

impl Limits {
    /// Lets no duty pass that is too large.
    ///
    /// # Errors
    ///
    /// It is no limit.
    pub fn limit(&self) -> Result<Sanity<Limit>, SettingError> {
        Limit::new(-self.duty, self.duty).map(Sanity::new)
    }

    /// Lets a duty change only so fast, but to 0, which never harms.
    ///
    /// # Errors
    ///
    /// It is no rate.
    pub fn slew(&self) -> Result<Sanity<RateLimit>, SettingError> {
        RateLimit::new(self.slew)?.free_to(0.0).map(Sanity::new)
    }

    /// Lets no duty pass that leads into an end stop.
    ///
    /// # Errors
    ///
    /// It is no angle.
    pub fn guard(&self) -> Result<Sanity<EndStop>, SettingError> {
        EndStop::new(-self.guard, self.guard).map(Sanity::new)
    }
}

/// How often each rule changed a duty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Interventions {
    /// A duty or a measured angle that was no finite number.
    pub not_finite: u64,
    /// A duty that was too large.
    pub limited: u64,
    /// A duty that changed too fast.
    pub slewed: u64,
    /// A duty that led into an end stop.
    pub guarded: u64,
}

/// A safety block on the duties of an axis, and how often it intervened.
#[derive(Debug, Clone)]
pub struct Sanity<B> {
    block: B,
    /// Duties, or angles beside them, that were no finite numbers.
    pub not_finite: u64,
    /// Duties that were changed.
    pub changed: u64,
}

impl<B: Block> Sanity<B> {
    fn new(block: B) -> Self {
        Self {
            block,
            not_finite: 0,
            changed: 0,
        }
    }

    /// The checked duty, `elapsed` after the call before: 0 if `duty` or the measured `angle` (rad)
    /// is not finite. O(1); allocates nothing.
    pub fn check(&mut self, duty: f64, angle: f64, elapsed: Duration) -> f64 {
        match self.block.step(&Sample::new(duty, elapsed).beside(angle)) {
            Verdict::Pass(duty) => duty,
            Verdict::Limited(duty, _) => {
                self.changed += 1;
                duty
            }
            Verdict::Refused(_) => {
                self.not_finite += 1;
                0.0
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_plants::{Motor, PAN};

    const MS: Duration = Duration::from_millis(1);
    const LIMITS: Limits = Limits {
        duty: 0.2,
        slew: 100.0,
        guard: 1.3,
    };

    #[test]
    fn harmless_duty_passes_unchanged() {
        let (mut limit, mut slew, mut guard) = layer();
        for n in 0..1000 {
            let duty = 0.1 * (f64::from(n) * 0.01).sin();
            let limited = limit.check(duty, 1.0, MS);
            assert_eq!(guard.check(slew.check(limited, 1.0, MS), 1.0, MS), duty);
        }
        let counts = (limit.not_finite, limit.changed, slew.changed, guard.changed);
        assert_eq!(counts, (0, 0, 0, 0));
    }

    #[test]
    fn not_finite_is_zero_and_counted() {
        let (mut limit, ..) = layer();
        let cases = [
            (f64::NAN, 0.0),
            (f64::INFINITY, 0.0),
            (f64::NEG_INFINITY, 0.0),
            (0.1, f64::NAN),
            (0.1, f64::INFINITY),
        ];
        for (duty, angle) in cases {
            assert_eq!(limit.check(duty, angle, MS), 0.0);
        }
        assert_eq!((limit.not_finite, limit.changed), (5, 0));
    }

    #[test]
    fn off_is_at_once_and_on_is_not() {
        let (_, mut slew, _) = layer();
        assert_eq!(slew.check(0.2, 0.0, MS), 0.1);
        assert_eq!(slew.check(0.2, 0.0, MS), 0.2);
        assert_eq!(slew.check(0.0, 0.0, MS), 0.0);
        assert_eq!(slew.changed, 1);
    }

    fn layer() -> (Sanity<Limit>, Sanity<RateLimit>, Sanity<EndStop>) {
        let made = (LIMITS.limit(), LIMITS.slew(), LIMITS.guard());
        (made.0.unwrap(), made.1.unwrap(), made.2.unwrap())
    }

    #[test]
    fn guard_keeps_a_controller_gone_mad_off_the_stop_at_low_speed() {
        let (mut limit, mut slew, mut guard) = layer();
        let mut plant = Motor::new(PAN);
        for _ in 0..5000 {
            let angle = plant.state().angle;
            let duty = slew.check(limit.check(1.0, angle, MS), angle, MS);
            plant.drive(guard.check(duty, angle, MS), 1e-3);
        }
        assert!(plant.state().angle > 1.3);
        assert!(plant.state().angle < PAN.end_stop);
        assert!(guard.changed > 0);
    }
}
