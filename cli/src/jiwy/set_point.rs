//! From the joystick's deflection to an angle that an axis can follow.

/// The set-point of one axis.
#[derive(Debug, Clone)]
pub(crate) struct SetPoint {
    range: f64,
    max_speed: f64,
    angle: f64,
}

impl SetPoint {
    /// Starts at angle 0; full deflection means `range` (rad), and the angle never moves faster than `max_speed` (rad/s).
    pub(crate) fn new(range: f64, max_speed: f64) -> Self {
        Self {
            range,
            max_speed,
            angle: 0.0,
        }
    }

    /// The angle (rad) to be at, `time` seconds after the call before, with the joystick at `deflection` (−1 to 1). O(1).
    ///
    /// A deflection beyond its range is full deflection; one that is no number leaves the angle as it is.
    pub(crate) fn follow(&mut self, deflection: f64, time: f64) -> f64 {
        let wanted = self.range * deflection.clamp(-1.0, 1.0);
        // `max` also turns a time that is no number into none.
        let reach = self.max_speed * time.max(0.0);
        if !wanted.is_nan() {
            self.angle = wanted.clamp(self.angle - reach, self.angle + reach);
        }
        self.angle
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_to_the_range() {
        let mut set_point = SetPoint::new(1.2, 1e6);
        assert_eq!(set_point.follow(0.5, 1.0), 0.6);
        assert_eq!(set_point.follow(-1.0, 1.0), -1.2);
        assert_eq!(set_point.follow(7.0, 1.0), 1.2);
    }

    #[test]
    fn never_faster_than_allowed() {
        let mut set_point = SetPoint::new(1.0, 2.0);
        let mut last = 0.0;
        for n in 0..1000 {
            let deflection = if n % 300 < 150 { 1.0 } else { -1.0 };
            let angle = set_point.follow(deflection, 1e-3);
            assert!(f64::abs(angle - last) <= 2e-3 + 1e-12);
            last = angle;
        }
    }

    #[test]
    fn keeps_its_angle_without_a_number_or_time() {
        let mut set_point = SetPoint::new(1.0, 2.0);
        let angle = set_point.follow(1.0, 0.1);
        assert_eq!(set_point.follow(f64::NAN, 0.1), angle);
        for time in [0.0, -1.0, f64::NAN] {
            assert_eq!(set_point.follow(1.0, time), angle);
        }
    }
}
