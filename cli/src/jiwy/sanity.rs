//! The safety layer between the controllers and the motors (the thesis' *SanityCheck*): whatever a controller asks for, a motor
//! gets a duty that harms neither it nor the head.

/// What the layer lets through on one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Limits {
    /// The largest duty, either way.
    pub(crate) duty: f64,
    /// The largest change of the duty, in 1/s.
    pub(crate) slew: f64,
    /// Beyond plus and minus this measured angle (rad), no duty leads further out.
    pub(crate) guard: f64,
}

/// How often each rule changed a duty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub(crate) struct Interventions {
    /// A duty or a measured angle that was no finite number.
    pub(crate) not_finite: u64,
    /// A duty that was too large.
    pub(crate) limited: u64,
    /// A duty that changed too fast.
    pub(crate) slewed: u64,
    /// A duty that led into an end stop.
    pub(crate) guarded: u64,
}

/// The check of one axis.
#[derive(Debug, Clone)]
pub(crate) struct SanityCheck {
    limits: Limits,
    duty: f64,
    interventions: Interventions,
}

impl SanityCheck {
    /// A check whose motor is off.
    pub(crate) fn new(limits: Limits) -> Self {
        Self {
            limits,
            duty: 0.0,
            interventions: Interventions::default(),
        }
    }

    /// The duty for the motor, when a controller asks for `duty` at the measured `angle` (rad), `sample_time` seconds after the
    /// check before. O(1); allocates nothing.
    ///
    /// What is not finite gives 0 at once. So does what leads into an end stop, since there too the slew limit would only
    /// prolong the harm. A sample time that is not positive allows no change but these.
    pub(crate) fn check(&mut self, duty: f64, angle: f64, sample_time: f64) -> f64 {
        let limits = self.limits;
        let counts = &mut self.interventions;
        if !duty.is_finite() || !angle.is_finite() {
            counts.not_finite += 1;
            self.duty = 0.0;
            return 0.0;
        }
        let limited = duty.clamp(-limits.duty, limits.duty);
        counts.limited += u64::from(limited != duty);

        // `max` also turns a sample time that is no number into none.
        let change = limits.slew * sample_time.max(0.0);
        let slewed = limited.clamp(self.duty - change, self.duty + change);
        counts.slewed += u64::from(slewed != limited);

        let guarded = if angle.abs() >= limits.guard && slewed * angle > 0.0 {
            0.0
        } else {
            slewed
        };
        counts.guarded += u64::from(guarded != slewed);

        self.duty = guarded;
        guarded
    }

    /// How often each rule has changed a duty so far.
    pub(crate) fn interventions(&self) -> Interventions {
        self.interventions
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_plants::{Motor, PAN};

    const LIMITS: Limits = Limits {
        duty: 0.8,
        slew: 100.0,
        guard: 1.3,
    };
    const SAMPLE_TIME: f64 = 1e-3;

    #[test]
    fn harmless_duty_passes_unchanged() {
        let mut sanity = SanityCheck::new(LIMITS);
        for n in 0..1000 {
            let duty = 0.5 * (f64::from(n) * 0.01).sin();
            assert_eq!(sanity.check(duty, 1.0, SAMPLE_TIME), duty);
        }
        assert_eq!(sanity.interventions(), Interventions::default());
    }

    #[test]
    fn not_finite_is_zero_and_counted() {
        let mut sanity = SanityCheck::new(LIMITS);
        let cases = [
            (f64::NAN, 0.0),
            (f64::INFINITY, 0.0),
            (f64::NEG_INFINITY, 0.0),
            (0.1, f64::NAN),
            (0.1, f64::INFINITY),
        ];
        for (duty, angle) in cases {
            sanity.check(0.05, 0.0, SAMPLE_TIME);
            assert_eq!(sanity.check(duty, angle, SAMPLE_TIME), 0.0);
        }
        assert_eq!(
            sanity.interventions(),
            Interventions {
                not_finite: 5,
                ..Interventions::default()
            }
        );
    }

    #[test]
    fn duty_is_limited_both_ways() {
        let mut sanity = SanityCheck::new(LIMITS);
        assert_eq!(sanity.check(5.0, 0.0, 1.0), 0.8);
        assert_eq!(sanity.check(-5.0, 0.0, 1.0), -0.8);
        assert_eq!(
            sanity.interventions(),
            Interventions {
                limited: 2,
                ..Interventions::default()
            }
        );
    }

    #[test]
    fn slew_is_limited_by_time() {
        let mut sanity = SanityCheck::new(LIMITS);
        for expected in [0.1, 0.2, 0.3] {
            assert!((sanity.check(0.8, 0.0, SAMPLE_TIME) - expected).abs() < 1e-12);
        }
        assert!((sanity.check(-0.8, 0.0, 2.0 * SAMPLE_TIME) - 0.1).abs() < 1e-12);
        assert_eq!(
            sanity.interventions(),
            Interventions {
                slewed: 4,
                ..Interventions::default()
            }
        );
        for sample_time in [0.0, -1.0, f64::NAN] {
            assert!((sanity.check(0.8, 0.0, sample_time) - 0.1).abs() < 1e-12);
        }
    }

    #[test]
    fn end_stop_guard_blocks_one_direction() {
        let mut sanity = SanityCheck::new(LIMITS);
        assert_eq!(sanity.check(0.1, 1.3, SAMPLE_TIME), 0.0);
        assert_eq!(sanity.check(-0.1, 1.4, SAMPLE_TIME), -0.1);
        assert_eq!(sanity.check(-0.1, -1.3, SAMPLE_TIME), 0.0);
        assert_eq!(sanity.check(0.1, -1.4, SAMPLE_TIME), 0.1);
        assert_eq!(
            sanity.interventions(),
            Interventions {
                guarded: 2,
                ..Interventions::default()
            }
        );
    }

    #[test]
    fn guard_keeps_a_controller_gone_mad_off_the_stop_at_low_speed() {
        let mut sanity = SanityCheck::new(Limits {
            duty: 0.2,
            ..LIMITS
        });
        let mut plant = Motor::new(PAN);
        for _ in 0..5000 {
            let duty = sanity.check(1.0, plant.state().angle, SAMPLE_TIME);
            plant.drive(duty, SAMPLE_TIME);
        }
        assert!(plant.state().angle > LIMITS.guard);
        assert!(plant.state().angle < PAN.end_stop);
        assert!(sanity.interventions().guarded > 0);
    }
}
