//! The safety layer between the controllers and the motors (the thesis' *SanityCheck*): whatever a controller asks for, a motor
//! gets a duty that harms neither it nor the head. Three checks, one after the other, each a process of its own in the network.

use serde::Serialize;

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

/// How often each rule changed a duty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
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

/// Lets no duty pass that is too large, or no number.
#[derive(Debug, Clone)]
pub struct Limit {
    largest: f64,
    /// Duties that were no numbers.
    pub not_finite: u64,
    /// Duties that were too large.
    pub limited: u64,
}

impl Limit {
    /// Up to `largest` either way.
    pub fn new(largest: f64) -> Self {
        Self {
            largest,
            not_finite: 0,
            limited: 0,
        }
    }

    /// `duty` within the limits; 0 if it, or the `angle` that it was computed from, is no finite number. O(1); allocates nothing.
    pub fn check(&mut self, duty: f64, angle: f64) -> f64 {
        if !duty.is_finite() || !angle.is_finite() {
            self.not_finite += 1;
            return 0.0;
        }
        let limited = duty.clamp(-self.largest, self.largest);
        self.limited += u64::from(limited != duty);
        limited
    }
}

/// Lets a duty change only so fast, but to 0, which never harms.
#[derive(Debug, Clone)]
pub struct Slew {
    fastest: f64,
    duty: f64,
    /// Duties that were changed.
    pub slewed: u64,
}

impl Slew {
    /// By `fastest` in a second. The motor is off.
    pub fn new(fastest: f64) -> Self {
        Self {
            fastest,
            duty: 0.0,
            slewed: 0,
        }
    }

    /// `duty`, or what comes next to it, `sample_time` seconds after the call before. O(1); allocates nothing.
    ///
    /// A sample time that is not positive allows no change.
    pub fn check(&mut self, duty: f64, sample_time: f64) -> f64 {
        // `max` also turns a sample time that is no number into none.
        let change = self.fastest * sample_time.max(0.0);
        let slewed = match duty == 0.0 {
            true => duty,
            false => duty.clamp(self.duty - change, self.duty + change),
        };
        self.slewed += u64::from(slewed != duty);
        self.duty = slewed;
        slewed
    }
}

/// Lets no duty pass that leads into an end stop.
#[derive(Debug, Clone)]
pub struct EndStopGuard {
    from: f64,
    /// Duties that were made 0.
    pub guarded: u64,
}

impl EndStopGuard {
    /// Beyond plus and minus `from` (rad).
    pub fn new(from: f64) -> Self {
        Self { from, guarded: 0 }
    }

    /// `duty`, or 0 if it leads further out at the measured `angle` (rad). O(1); allocates nothing.
    pub fn check(&mut self, duty: f64, angle: f64) -> f64 {
        let leads_out = angle.abs() >= self.from && duty * angle > 0.0;
        self.guarded += u64::from(leads_out);
        match leads_out {
            true => 0.0,
            false => duty,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_plants::{Motor, PAN};

    const SAMPLE_TIME: f64 = 1e-3;

    #[test]
    fn harmless_duty_passes_unchanged() {
        let (mut limit, mut slew, mut guard) =
            (Limit::new(0.8), Slew::new(100.0), EndStopGuard::new(1.3));
        for n in 0..1000 {
            let duty = 0.5 * (f64::from(n) * 0.01).sin();
            assert_eq!(
                guard.check(slew.check(limit.check(duty, 1.0), SAMPLE_TIME), 1.0),
                duty
            );
        }
        assert_eq!(
            (limit.not_finite, limit.limited, slew.slewed, guard.guarded),
            (0, 0, 0, 0)
        );
    }

    #[test]
    fn not_finite_is_zero_and_counted() {
        let mut limit = Limit::new(0.8);
        let cases = [
            (f64::NAN, 0.0),
            (f64::INFINITY, 0.0),
            (f64::NEG_INFINITY, 0.0),
            (0.1, f64::NAN),
            (0.1, f64::INFINITY),
        ];
        for (duty, angle) in cases {
            assert_eq!(limit.check(duty, angle), 0.0);
        }
        assert_eq!((limit.not_finite, limit.limited), (5, 0));
    }

    #[test]
    fn duty_is_limited_both_ways() {
        let mut limit = Limit::new(0.8);
        assert_eq!((limit.check(5.0, 0.0), limit.check(-5.0, 0.0)), (0.8, -0.8));
        assert_eq!(limit.limited, 2);
    }

    #[test]
    fn slew_is_limited_by_time_but_to_zero() {
        let mut slew = Slew::new(100.0);
        for expected in [0.1, 0.2, 0.3] {
            assert!((slew.check(0.8, SAMPLE_TIME) - expected).abs() < 1e-12);
        }
        assert!((slew.check(-0.8, 2.0 * SAMPLE_TIME) - 0.1).abs() < 1e-12);
        assert_eq!(slew.slewed, 4);
        for sample_time in [0.0, -1.0, f64::NAN] {
            assert!((slew.check(0.8, sample_time) - 0.1).abs() < 1e-12);
        }
        assert_eq!(slew.check(0.0, SAMPLE_TIME), 0.0);
        assert_eq!(slew.slewed, 7);
    }

    #[test]
    fn end_stop_guard_blocks_one_direction() {
        let mut guard = EndStopGuard::new(1.3);
        assert_eq!(guard.check(0.1, 1.3), 0.0);
        assert_eq!(guard.check(-0.1, 1.4), -0.1);
        assert_eq!(guard.check(-0.1, -1.3), 0.0);
        assert_eq!(guard.check(0.1, -1.4), 0.1);
        assert_eq!(guard.guarded, 2);
    }

    #[test]
    fn guard_keeps_a_controller_gone_mad_off_the_stop_at_low_speed() {
        let (mut limit, mut slew, mut guard) =
            (Limit::new(0.2), Slew::new(100.0), EndStopGuard::new(1.3));
        let mut plant = Motor::new(PAN);
        for _ in 0..5000 {
            let angle = plant.state().angle;
            let duty = slew.check(limit.check(1.0, angle), SAMPLE_TIME);
            plant.drive(guard.check(duty, angle), SAMPLE_TIME);
        }
        assert!(plant.state().angle > 1.3);
        assert!(plant.state().angle < PAN.end_stop);
        assert!(guard.guarded > 0);
    }
}
