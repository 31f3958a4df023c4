//! From the angle that is wanted to one that an axis can follow.

/// The set-point of one axis.
#[derive(Debug, Clone)]
pub struct SetPoint {
    max_speed: f64,
    angle: f64,
}

impl SetPoint {
    /// Starts at angle 0, and never moves faster than `max_speed` (rad/s).
    pub fn new(max_speed: f64) -> Self {
        Self {
            max_speed,
            angle: 0.0,
        }
    }

    /// Starts again at `angle` (rad), where the axis is.
    pub fn begin_at(&mut self, angle: f64) {
        self.angle = angle;
    }

    /// The target angle (rad), `time` seconds after the call before, when `wanted` (rad) is wanted.
    /// O(1).
    ///
    /// A `wanted` that is not finite leaves the angle unchanged.
    pub fn follow(&mut self, wanted: f64, time: f64) -> f64 {
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
    fn never_faster_than_allowed() {
        let mut set_point = SetPoint::new(2.0);
        let mut last = 0.0;
        for n in 0..1000 {
            let wanted = if n % 300 < 150 { 1.0 } else { -1.0 };
            let angle = set_point.follow(wanted, 1e-3);
            assert!(f64::abs(angle - last) <= 2e-3 + 1e-12);
            last = angle;
        }
    }

    #[test]
    fn goes_on_from_where_the_axis_is() {
        let mut set_point = SetPoint::new(2.0);
        set_point.begin_at(1.4);
        assert!((set_point.follow(0.0, 0.1) - 1.2).abs() < 1e-12);
    }

    #[test]
    fn keeps_its_angle_without_a_number_or_time() {
        let mut set_point = SetPoint::new(2.0);
        let angle = set_point.follow(1.0, 0.1);
        assert_eq!(set_point.follow(f64::NAN, 0.1), angle);
        for time in [0.0, -1.0, f64::NAN] {
            assert_eq!(set_point.follow(1.0, time), angle);
        }
    }
}
