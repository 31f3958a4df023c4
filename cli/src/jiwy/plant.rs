//! The physics of one axis: supply, armature, gear, inertia, friction, end stops.
//!
//! All of it is seen from the joint (the camera's side of the gear). With `K` = torque constant × gear ratio:
//!
//! ```text
//! L di/dt = duty·supply − R i − K ω                      the armature, with its back-EMF
//! J dω/dt = K i − b ω − friction(ω) − stop(θ, ω)         J: load + rotor × gear²
//!   dθ/dt = ω
//! ```
//!
//! The three are integrated together by implicit Euler in sub-steps of at most [`MAX_SUB_STEP`]. That is only first order, but it is
//! stable for every step, never adds energy, and has the exact steady states. Friction is part of the implicit step, so it is
//! a set-valued law and needs no smoothing: below breakaway the speed is exactly zero and the angle does not creep (Moreau's
//! time stepping; Acary & Brogliato, "Numerical Methods for Nonsmooth Dynamical Systems", 2008, chapter 10).
//!
//! Left out: the ripple of the PWM (the voltage is its average), play and elasticity in the gear, gravity (both axes are
//! taken as balanced), heat.

/// The longest sub-step, in seconds: a quarter of the armature's time constant, a hundredth of the end stops' period.
pub(crate) const MAX_SUB_STEP: f64 = 25e-6;

/// What one axis is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Parameters {
    /// The voltage at duty 1, in V.
    pub(crate) supply: f64,
    /// Of the armature, in Ω.
    pub(crate) resistance: f64,
    /// Of the armature, in H.
    pub(crate) inductance: f64,
    /// Torque by current at the rotor, in N·m/A; the back-EMF in V·s/rad is the same number.
    pub(crate) torque_constant: f64,
    /// Rotor turns for one turn of the joint.
    pub(crate) gear_ratio: f64,
    /// Of the rotor, in kg·m².
    pub(crate) rotor_inertia: f64,
    /// Of what the joint carries, in kg·m².
    pub(crate) load_inertia: f64,
    /// At the joint, in N·m·s/rad.
    pub(crate) viscous_friction: f64,
    /// At the joint while it moves, in N·m. The losses of the gear are in it.
    pub(crate) coulomb_friction: f64,
    /// The torque at the joint that breaks it loose from rest, in N·m; at least the Coulomb friction.
    pub(crate) stiction: f64,
    /// The stops stand at plus and minus this angle, in rad.
    pub(crate) end_stop: f64,
    /// Of a stop, in N·m/rad.
    pub(crate) stop_stiffness: f64,
    /// Of a stop, in N·m·s/rad.
    pub(crate) stop_damping: f64,
}

// The figures of both axes are not those of the real Jiwy, which the thesis does not give. They are those of a plausible
// small camera head: 12 V brushed motors of the 5 W class (data sheets of 22 mm motors give 4 to 6 Ω, 0.3 to 0.6 mH, 12 to
// 15 mN·m/A, 3 to 5 g·cm²), planetary gears, a 0.3 kg camera some centimetres off the axes, rubber stops. Friction is chosen:
// 3 to 4 % of the stall torque when moving, a third more to break loose.

/// The lower axis: it carries the tilt axis, and turns further.
pub(crate) const PAN: Parameters = Parameters {
    supply: 12.0,
    resistance: 5.0,
    inductance: 0.5e-3,
    torque_constant: 13.5e-3,
    gear_ratio: 72.0,
    rotor_inertia: 4.0e-7,
    load_inertia: 1.2e-3,
    viscous_friction: 2.0e-3,
    coulomb_friction: 0.08,
    stiction: 0.11,
    end_stop: 1.4,
    stop_stiffness: 200.0,
    stop_damping: 0.5,
};

/// The upper axis: the same motor with a shorter gear, and the camera alone to move.
pub(crate) const TILT: Parameters = Parameters {
    supply: 12.0,
    resistance: 5.0,
    inductance: 0.5e-3,
    torque_constant: 13.5e-3,
    gear_ratio: 50.0,
    rotor_inertia: 4.0e-7,
    load_inertia: 0.5e-3,
    viscous_friction: 1.5e-3,
    coulomb_friction: 0.06,
    stiction: 0.08,
    end_stop: 0.6,
    stop_stiffness: 200.0,
    stop_damping: 0.3,
};

impl Parameters {
    /// Torque at the joint by current, in N·m/A; back-EMF by joint speed, in V·s/rad.
    pub(crate) fn joint_constant(&self) -> f64 {
        self.torque_constant * self.gear_ratio
    }

    /// All that turns, seen from the joint, in kg·m².
    pub(crate) fn inertia(&self) -> f64 {
        self.load_inertia + self.rotor_inertia * self.gear_ratio * self.gear_ratio
    }

    /// The torque at the joint that full duty holds at rest, in N·m.
    #[cfg(test)]
    pub(crate) fn stall_torque(&self) -> f64 {
        self.joint_constant() * self.supply / self.resistance
    }
}

/// Where an axis is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct State {
    /// Of the joint, in rad; 0 is half way between the stops.
    pub(crate) angle: f64,
    /// Of the joint, in rad/s.
    pub(crate) speed: f64,
    /// In the armature, in A.
    pub(crate) current: f64,
}

/// One axis in motion.
#[derive(Debug, Clone)]
pub(crate) struct Plant {
    parameters: Parameters,
    state: State,
}

impl Plant {
    /// An axis at rest at angle 0.
    pub(crate) fn new(parameters: Parameters) -> Self {
        Self {
            parameters,
            state: State::default(),
        }
    }

    /// Where it is now.
    pub(crate) fn state(&self) -> State {
        self.state
    }

    /// Applies `duty` (−1 to 1 of the supply; a bridge cannot give more) for `time` seconds.
    ///
    /// O(time / [`MAX_SUB_STEP`]); allocates nothing. A duty that is no number is none, a time that is not positive no time.
    pub(crate) fn step(&mut self, duty: f64, time: f64) {
        self.step_by(duty, time, MAX_SUB_STEP);
    }

    fn step_by(&mut self, duty: f64, time: f64, max_sub_step: f64) {
        let duty = if duty.is_nan() {
            0.0
        } else {
            duty.clamp(-1.0, 1.0)
        };
        // A cast of what is not positive, or not a number, gives 0.
        let sub_steps = (time / max_sub_step).ceil() as u64;
        let h = time / sub_steps as f64;
        for _ in 0..sub_steps {
            self.sub_step(duty * self.parameters.supply, h);
        }
    }

    /// One implicit step of `h` seconds.
    ///
    /// With the new current eliminated, the new speed solves `mass·ω' = impulse − h·friction(ω')`, once for the free joint and,
    /// if that would end in a stop, once with the stop's spring and damper in `mass` and `impulse`.
    fn sub_step(&mut self, voltage: f64, h: f64) {
        let p = &self.parameters;
        let State {
            angle,
            speed,
            current,
        } = self.state;
        let k = p.joint_constant();
        let impedance = p.inductance + h * p.resistance;
        let mass = p.inertia() + h * p.viscous_friction + h * h * k * k / impedance;
        let impulse =
            p.inertia() * speed + h * k * (p.inductance * current + h * voltage) / impedance;
        let friction = h * if speed == 0.0 {
            p.stiction
        } else {
            p.coulomb_friction
        };

        // Moves when the impulse exceeds friction, against Coulomb friction then; else sticks, at exactly zero speed.
        let solve = |mass: f64, impulse: f64| {
            if impulse.abs() <= friction {
                0.0
            } else {
                (impulse - impulse.signum() * h * p.coulomb_friction) / mass
            }
        };

        let mut new_speed = solve(mass, impulse);
        let new_angle = angle + h * new_speed;
        if new_angle.abs() > p.end_stop {
            let side = new_angle.signum();
            let depth = angle - side * p.end_stop;
            let touching = solve(
                mass + h * p.stop_damping + h * h * p.stop_stiffness,
                impulse - h * p.stop_stiffness * depth,
            );
            // A stop pushes but does not pull: rubber that springs back slower than the joint leaves lets it go.
            let push = p.stop_stiffness * (depth + h * touching) + p.stop_damping * touching;
            if push * side > 0.0 {
                new_speed = touching;
            }
        }
        self.state = State {
            angle: angle + h * new_speed,
            speed: new_speed,
            current: (p.inductance * current + h * (voltage - k * new_speed)) / impedance,
        };
    }

    /// What is stored in the armature, in motion and in a compressed stop, in J.
    #[cfg(test)]
    fn energy(&self) -> f64 {
        let p = &self.parameters;
        let s = &self.state;
        let depth = (s.angle.abs() - p.end_stop).max(0.0);
        0.5 * (p.inductance * s.current * s.current
            + p.inertia() * s.speed * s.speed
            + p.stop_stiffness * depth * depth)
    }
}

#[cfg(test)]
mod tests;
