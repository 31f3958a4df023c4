//! A DC motor and its load: supply, armature, gear, inertia, friction, end stops.
//!
//! All quantities are seen from the joint (the camera's side of the gear). With `K` = torque
//! constant × gear ratio:
//!
//! ```text
//! L di/dt = duty·supply − R i − K ω                      the armature, with its back-EMF
//! J dω/dt = K i − b ω − friction(ω) − stop(θ, ω)         J: load + rotor × gear²
//!   dθ/dt = ω
//! ```
//!
//! Between the events that change these equations (a reversal, sticking and breaking loose, a stop,
//! the limit of the current) they are linear: a step without an event is solved exactly, at once
//! (module `exact`). A step that may have one is halved, and the parts that still may have one are
//! integrated by implicit Euler in sub-steps of at most [`MAX_SUB_STEP`]. That is only of first
//! order, but it is stable for every step, never adds energy, and has the exact steady states.
//! Friction is part of the implicit step, so it is a set-valued law and needs no smoothing: below
//! breakaway the speed is exactly zero and the angle does not creep (Moreau's time stepping; Acary
//! & Brogliato, "Numerical Methods for Nonsmooth Dynamical Systems", 2008, chapter 10).
//!
//! The bridge limits the current by switching the voltage off while the current would exceed the
//! limit: the torque then is that of the limit.
//!
//! Not modelled: the ripple of the PWM (the voltage is its average), play and elasticity in the
//! gear, gravity (both axes are balanced), heat.

mod exact;

use crate::{Outside, Plant, PlantError, Port};
use exact::Prepared;
use std::time::Duration;

/// The longest sub-step, in seconds: a quarter of the time constant of the armatures of
/// [`PAN`](crate::PAN) and [`TILT`](crate::TILT), a hundredth of the period of their end stops.
pub const MAX_SUB_STEP: f64 = 25e-6;

/// How often a step is halved to find its linear parts: from a millisecond to less than a sub-step.
const MAX_HALVED: usize = 6;

/// The longest step of a motor as a [`Plant`], which bounds a step's cost: 40 000 sub-steps for
/// each second of it.
pub const LONGEST_STEP: Duration = Duration::from_secs(10);

/// What a motor and its axis are made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorParameters {
    /// The voltage at duty 1, in V.
    pub supply: f64,
    /// The bridge's limit of the current, in A; infinity if it has none.
    pub current_limit: f64,
    /// Resistance of the armature, in Ω.
    pub resistance: f64,
    /// Inductance of the armature, in H.
    pub inductance: f64,
    /// Torque per current at the rotor, in N·m/A; the back-EMF in V·s/rad is the same number.
    pub torque_constant: f64,
    /// Rotor turns for one turn of the joint.
    pub gear_ratio: f64,
    /// Inertia of the rotor, in kg·m².
    pub rotor_inertia: f64,
    /// Inertia of the load at the joint, in kg·m².
    pub load_inertia: f64,
    /// At the joint, in N·m·s/rad.
    pub viscous_friction: f64,
    /// Coulomb friction at the joint while it moves, in N·m, including the losses of the gear.
    pub coulomb_friction: f64,
    /// The torque at the joint that breaks it loose from rest, in N·m; at least the Coulomb
    /// friction.
    pub stiction: f64,
    /// The stops are at plus and minus this angle, in rad; infinity if there are none.
    pub end_stop: f64,
    /// Of a stop, in N·m/rad.
    pub stop_stiffness: f64,
    /// Of a stop, in N·m·s/rad.
    pub stop_damping: f64,
}

impl MotorParameters {
    /// Torque at the joint per current, in N·m/A; back-EMF per joint speed, in V·s/rad.
    pub fn joint_constant(&self) -> f64 {
        self.torque_constant * self.gear_ratio
    }

    /// The inertia of all moving parts, seen from the joint, in kg·m².
    pub fn inertia(&self) -> f64 {
        self.load_inertia + self.rotor_inertia * self.gear_ratio * self.gear_ratio
    }

    /// The torque at the joint that full duty holds at rest, in N·m.
    pub fn stall_torque(&self) -> f64 {
        self.joint_constant() * self.supply / self.resistance
    }
}

/// Where an axis is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MotorState {
    /// Of the joint, in rad; 0 is half way between the stops.
    pub angle: f64,
    /// Of the joint, in rad/s.
    pub speed: f64,
    /// Current in the armature, in A.
    pub current: f64,
}

/// A motor in motion, with its axis.
///
/// As a [`Plant`] it has the input `duty` (−1 to 1 of the supply, saturates like a bridge) and the
/// outputs `angle` in rad, `speed` in rad/s and `current` in A. A step allocates nothing. It is
/// O(1), some 15 ns, while the joint moves one way or rests. A step with an event (it reverses,
/// sticks, breaks loose, meets a stop or the limit of the current) is O(time / [`MAX_SUB_STEP`]):
/// at most 64 sub-steps for a millisecond, each some 20 ns.
///
/// ```
/// use luna_plants::{Checked, Motor, PAN};
/// use std::time::Duration;
///
/// let mut motor = Checked::new(Motor::new(PAN));
/// motor.set("duty", 0.5).unwrap();
/// motor.step(Duration::from_millis(100)).unwrap();
/// assert!(motor.get("angle").unwrap() > 0.1);
/// ```
#[derive(Debug, Clone)]
pub struct Motor {
    parameters: MotorParameters,
    state: MotorState,
    duty: f64,
    /// For whole steps, halves of them, and so on.
    prepared: [Prepared; MAX_HALVED + 1],
    ports: [Port; 4],
}

/// What a sub-step of one length always needs.
#[derive(Debug, Clone, Copy)]
struct Coefficients {
    h: f64,
    k: f64,
    impedance: f64,
    /// Of the free joint with the armature's reaction, and without it.
    mass: f64,
    mass_at_limit: f64,
    /// What a stop adds to either.
    mass_of_stop: f64,
}

impl Motor {
    /// At rest at angle 0.
    pub fn new(parameters: MotorParameters) -> Self {
        Self {
            parameters,
            state: MotorState::default(),
            duty: 0.0,
            prepared: [Prepared::NONE; MAX_HALVED + 1],
            ports: [
                Port::new("duty", "1")
                    .range(-1.0, 1.0)
                    .outside(Outside::Saturate),
                Port::new("angle", "rad"),
                Port::new("speed", "rad/s"),
                Port::new("current", "A"),
            ],
        }
    }

    /// What it is made of.
    pub fn parameters(&self) -> &MotorParameters {
        &self.parameters
    }

    /// Where it is now.
    pub fn state(&self) -> MotorState {
        self.state
    }

    /// In another state.
    #[must_use]
    pub fn starting_at(mut self, state: MotorState) -> Self {
        self.state = state;
        self
    }

    /// Applies `duty` (−1 to 1 of the supply; saturates) for `time` seconds.
    ///
    /// O(1) without an event, else O(time / [`MAX_SUB_STEP`]); allocates nothing. A duty that is
    /// not a number counts as 0; nothing happens for a time that is not positive. A time that
    /// differs from the last call's costs some 100 ns more.
    pub fn drive(&mut self, duty: f64, time: f64) {
        if time > 0.0 {
            self.advance(self.voltage(duty), time, 0);
        }
    }

    /// At once if the step is linear, else by its halves; by sub-steps if those are not longer than
    /// one, or were halved often enough.
    fn advance(&mut self, voltage: f64, time: f64, halved: usize) {
        let exact = self.prepared[halved].steps_of(&self.parameters, time);
        if let Some(exact) = exact
            && let Some(state) = exact.step(&self.parameters, self.state, voltage)
        {
            self.state = state;
        } else if exact.is_some() && halved < MAX_HALVED && time > MAX_SUB_STEP {
            self.advance(voltage, time / 2.0, halved + 1);
            self.advance(voltage, time / 2.0, halved + 1);
        } else {
            self.drive_by(voltage, time, MAX_SUB_STEP);
        }
    }

    fn voltage(&self, duty: f64) -> f64 {
        let duty = if duty.is_nan() {
            0.0
        } else {
            duty.clamp(-1.0, 1.0)
        };
        duty * self.parameters.supply
    }

    /// By sub-steps alone.
    fn drive_by(&mut self, voltage: f64, time: f64, max_sub_step: f64) {
        // A cast of a negative value or NaN gives 0.
        let sub_steps = (time / max_sub_step).ceil() as u64;
        let coefficients = self.coefficients(time / sub_steps as f64);
        for _ in 0..sub_steps {
            self.sub_step(voltage, &coefficients);
        }
    }

    fn coefficients(&self, h: f64) -> Coefficients {
        let p = &self.parameters;
        let k = p.joint_constant();
        let impedance = p.inductance + h * p.resistance;
        let mass_at_limit = p.inertia() + h * p.viscous_friction;
        Coefficients {
            h,
            k,
            impedance,
            mass: mass_at_limit + h * h * k * k / impedance,
            mass_at_limit,
            mass_of_stop: h * p.stop_damping + h * h * p.stop_stiffness,
        }
    }

    /// One implicit step.
    ///
    /// With the new current eliminated, the new speed solves `mass·ω' = impulse − h·friction(ω')`.
    /// If the current would exceed the limit, it is set to the limit, and the speed is solved
    /// again.
    fn sub_step(&mut self, voltage: f64, c: &Coefficients) {
        let p = &self.parameters;
        let MotorState { speed, current, .. } = self.state;
        let driven = (p.inductance * current + c.h * voltage) / c.impedance;
        let momentum = p.inertia() * speed;
        let mut new_speed = self.solve(c.mass, momentum + c.h * c.k * driven, c);
        let mut new_current = driven - c.h * c.k * new_speed / c.impedance;
        if new_current.abs() > p.current_limit {
            new_current = p.current_limit.copysign(new_current);
            new_speed = self.solve(c.mass_at_limit, momentum + c.h * c.k * new_current, c);
        }
        self.state = MotorState {
            angle: self.state.angle + c.h * new_speed,
            speed: new_speed,
            current: new_current,
        };
    }

    /// The new speed: of the free joint, and if that would end in a stop, again with the stop's
    /// spring and damper in `mass` and `impulse`.
    fn solve(&self, mass: f64, impulse: f64, c: &Coefficients) -> f64 {
        let p = &self.parameters;
        let MotorState { angle, speed, .. } = self.state;
        let friction = c.h
            * if speed == 0.0 {
                p.stiction
            } else {
                p.coulomb_friction
            };
        // It moves against Coulomb friction if the impulse exceeds the friction; otherwise it
        // sticks, at exactly zero speed.
        let against_friction = |mass: f64, impulse: f64| {
            if impulse.abs() <= friction {
                0.0
            } else {
                (impulse - impulse.signum() * c.h * p.coulomb_friction) / mass
            }
        };
        let free = against_friction(mass, impulse);
        let new_angle = angle + c.h * free;
        if new_angle.abs() <= p.end_stop {
            return free;
        }
        let side = new_angle.signum();
        let depth = angle - side * p.end_stop;
        let touching = against_friction(
            mass + c.mass_of_stop,
            impulse - c.h * p.stop_stiffness * depth,
        );
        // A stop pushes but does not pull: a joint that leaves faster than the rubber expands loses
        // contact.
        let push = p.stop_stiffness * (depth + c.h * touching) + p.stop_damping * touching;
        if push * side > 0.0 { touching } else { free }
    }

    /// The energy in the armature, in motion and in a compressed stop, in J.
    pub fn energy(&self) -> f64 {
        let p = &self.parameters;
        let s = &self.state;
        let depth = (s.angle.abs() - p.end_stop).max(0.0);
        0.5 * (p.inductance * s.current * s.current
            + p.inertia() * s.speed * s.speed
            + p.stop_stiffness * depth * depth)
    }
}

impl Plant for Motor {
    fn inputs(&self) -> &[Port] {
        &self.ports[..1]
    }

    fn outputs(&self) -> &[Port] {
        &self.ports[1..]
    }

    fn apply(&mut self, inputs: &[f64]) -> Result<(), PlantError> {
        self.duty = inputs[0];
        Ok(())
    }

    fn step(&mut self, time: Duration) -> Result<(), PlantError> {
        if time.is_zero() || time > LONGEST_STEP {
            return Err(PlantError::Step {
                step: time,
                longest: LONGEST_STEP,
            });
        }
        self.drive(self.duty, time.as_secs_f64());
        Ok(())
    }

    fn measure(&mut self, outputs: &mut [f64]) -> Result<(), PlantError> {
        outputs.copy_from_slice(&[self.state.angle, self.state.speed, self.state.current]);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
