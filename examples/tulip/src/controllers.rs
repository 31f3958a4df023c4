//! The joint controllers: two implementations behind one interface, exchanged while the robot walks.

use crate::parameters::{BANDWIDTH, DT, DUTY_LIMIT, Joint};

/// A controller of one joint.
pub trait Controller: std::fmt::Debug {
    /// One cycle: the duty for a joint at `angle` that is to be at `set` and to move with `rate`.
    /// Real-time path: yes; O(1).
    fn step(&mut self, set: f64, rate: f64, angle: f64) -> f64;

    /// Goes on where another controller was: the joint is at `angle`, was there a cycle ago less
    /// `speed` (rad/s) times a cycle, and the other one's slow part of the duty was `slow`.
    fn take_over(&mut self, angle: f64, speed: f64, slow: f64);

    /// The speed that it measured, and the slow part of its duty, for the one that takes over.
    fn hand_over(&self) -> (f64, f64);
}

/// Both controllers of a joint. They are made at the start: an exchange allocates nothing.
pub fn of(joint: &Joint) -> [Box<dyn Controller + Send>; 2] {
    [Box::new(Pid::new(joint)), Box::new(Cascade::new(joint))]
}

/// What both need: gains of a critically damped loop, in V.
#[derive(Debug, Clone, Copy)]
struct Axis {
    per_volt: f64,
    back_emf: f64,
    supply: f64,
    last: f64,
    speed: f64,
    /// In V.
    integral: f64,
}

impl Axis {
    fn new(joint: &Joint) -> Self {
        let back_emf = joint.motor.joint_constant();
        Self {
            per_volt: joint.motor.inertia() * joint.motor.resistance / back_emf,
            back_emf,
            supply: joint.motor.supply,
            last: f64::NAN,
            speed: 0.0,
            integral: 0.0,
        }
    }

    fn measure(&mut self, angle: f64) {
        if self.last.is_finite() {
            self.speed = (angle - self.last) / DT;
        }
        self.last = angle;
    }

    /// The duty of these volts and the integral, which grows by `growth` volts unless the motor
    /// gives all that it may.
    fn duty(&mut self, volts: f64, growth: f64) -> f64 {
        let most = DUTY_LIMIT * self.supply;
        let sum = volts + self.integral;
        if sum.abs() < most || sum * growth < 0.0 {
            self.integral = (self.integral + growth).clamp(-most, most);
        }
        sum.clamp(-most, most) / self.supply
    }

    fn take_over(&mut self, angle: f64, speed: f64, slow: f64) {
        self.last = angle - speed * DT;
        self.speed = speed;
        self.integral = slow * self.supply;
    }

    fn hand_over(&self) -> (f64, f64) {
        (self.speed, self.integral / self.supply)
    }
}

/// Position, its integral and its speed, with feed-forward.
#[derive(Debug)]
struct Pid(Axis);

impl Pid {
    fn new(joint: &Joint) -> Self {
        Self(Axis::new(joint))
    }
}

impl Controller for Pid {
    fn step(&mut self, set: f64, rate: f64, angle: f64) -> f64 {
        let axis = &mut self.0;
        axis.measure(angle);
        let kp = BANDWIDTH * BANDWIDTH * axis.per_volt;
        let kd = (2.0 * BANDWIDTH * axis.per_volt - axis.back_emf).max(0.0);
        let volts = kp * (set - angle) + kd * (rate - axis.speed) + axis.back_emf * rate;
        axis.duty(volts, kp * BANDWIDTH / 10.0 * (set - angle) * DT)
    }

    fn take_over(&mut self, angle: f64, speed: f64, slow: f64) {
        self.0.take_over(angle, speed, slow);
    }

    fn hand_over(&self) -> (f64, f64) {
        self.0.hand_over()
    }
}

/// A position loop that asks a speed loop within for a speed, which it may not exceed.
#[derive(Debug)]
struct Cascade {
    axis: Axis,
    fastest: f64,
}

impl Cascade {
    fn new(joint: &Joint) -> Self {
        let axis = Axis::new(joint);
        let fastest = 0.9 * axis.supply / axis.back_emf;
        Self { axis, fastest }
    }
}

impl Controller for Cascade {
    fn step(&mut self, set: f64, rate: f64, angle: f64) -> f64 {
        let axis = &mut self.axis;
        axis.measure(angle);
        let outer = BANDWIDTH / 2.0;
        let inner = 2.0 * BANDWIDTH * axis.per_volt;
        let wanted = (rate + outer * (set - angle)).clamp(-self.fastest, self.fastest);
        let error = wanted - axis.speed;
        let volts = inner * error + axis.back_emf * axis.speed;
        axis.duty(volts, inner * BANDWIDTH / 10.0 * error * DT)
    }

    fn take_over(&mut self, angle: f64, speed: f64, slow: f64) {
        self.axis.take_over(angle, speed, slow);
    }

    fn hand_over(&self) -> (f64, f64) {
        self.axis.hand_over()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::ROBOT;
    use luna_plants::Motor;

    /// The furthest from the set-point after it has settled, with an exchange each `exchange`
    /// cycles, in rad; and the largest change of the duty from a cycle to the next.
    fn worst(exchange: usize, first: usize) -> (f64, f64) {
        let mut controllers = of(&ROBOT[2]);
        let mut motor = Motor::new(ROBOT[2].motor);
        let (mut law, mut last) = (first, 0.0);
        let (mut worst, mut jump) = (0.0_f64, 0.0_f64);
        for cycle in 0..4000 {
            let time = cycle as f64 * DT;
            let (set, rate) = (0.3 * (6.0 * time).sin(), 1.8 * (6.0 * time).cos());
            let angle = motor.state().angle;
            if cycle % exchange == exchange - 1 {
                let (speed, slow) = controllers[law].hand_over();
                law = 1 - law;
                controllers[law].take_over(angle, speed, slow);
            }
            let duty = controllers[law].step(set, rate, angle);
            motor.drive(duty, DT);
            if cycle > 1000 {
                worst = worst.max((set - angle).abs());
                jump = jump.max((duty - last).abs());
            }
            last = duty;
        }
        (worst, jump)
    }

    #[test]
    fn both_follow_and_an_exchange_is_not_felt() {
        let alone = [worst(usize::MAX, 0), worst(usize::MAX, 1)];
        assert!(alone.iter().all(|(worst, _)| *worst < 0.02), "{alone:?}");
        assert!((alone[0].0 - alone[1].0).abs() > 1e-4, "they are the same");
        let most = alone[0].1.max(alone[1].1);
        for exchange in [50, 173, 700] {
            let (error, jump) = worst(exchange, 0);
            assert!(error < 0.025, "{exchange}: {error}");
            assert!(jump <= most + 0.05, "{exchange}: {jump}, alone {most}");
        }
    }
}
