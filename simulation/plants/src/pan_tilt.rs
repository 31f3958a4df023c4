//! Jiwy, the pan-tilt camera of the thesis (appendix A.1): two axes with end stops, and an encoder
//! on each motor.

use crate::{Encoder, Motor, MotorParameters, MotorState, Outside, Plant, PlantError, Port};
use std::time::Duration;

// The real Jiwy's parameters are not in the thesis. These are of a plausible small camera head: 12
// V brushed motors of the 5 W class (data sheets of 22 mm motors give 4 to 6 Ω, 0.3 to 0.6 mH, 12
// to 15 mN·m/A, 3 to 5 g·cm²), planetary gears, a 0.3 kg camera some centimetres off the axes,
// rubber stops. Friction is chosen: 3 to 4 % of the stall torque when moving, a third more to break
// loose.

/// The lower axis: it carries the tilt axis, and turns further.
pub const PAN: MotorParameters = MotorParameters {
    supply: 12.0,
    current_limit: f64::INFINITY,
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

/// The upper axis: the same motor with a shorter gear, moving only the camera.
pub const TILT: MotorParameters = MotorParameters {
    supply: 12.0,
    current_limit: f64::INFINITY,
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

/// Two axes of motors with encoders: the mechanism of a pan-tilt camera.
///
/// Inputs: `pan duty` and `tilt duty`, −1 to 1 of the supply, saturate. Outputs: `pan count` and
/// `tilt count`, the encoders' counters as in a card: whole numbers of 32 bits that wrap; a channel
/// of `i32` takes them. The axes are independent. A step costs two [`Motor`] steps.
///
/// ```
/// use luna_plants::{Checked, PanTilt};
/// use std::time::Duration;
///
/// let mut camera = Checked::new(PanTilt::jiwy([0, 0]));
/// camera.set("pan duty", -0.3).unwrap();
/// camera.step(Duration::from_millis(50)).unwrap();
/// assert!(camera.get("pan count").unwrap() < -100.0);
/// assert_eq!(camera.get("tilt count"), Ok(0.0));
/// ```
#[derive(Debug, Clone)]
pub struct PanTilt {
    axes: [Motor; 2],
    encoders: [Encoder; 2],
    ports: [Port; 4],
}

impl PanTilt {
    /// Of these axes, pan first, with their counters.
    pub fn new(axes: [Motor; 2], encoders: [Encoder; 2]) -> Self {
        let duty = |name| {
            Port::new(name, "1")
                .range(-1.0, 1.0)
                .outside(Outside::Saturate)
        };
        let count = |name| Port::new(name, "count").range(i32::MIN.into(), i32::MAX.into());
        Self {
            axes,
            encoders,
            ports: [
                duty("pan duty"),
                duty("tilt duty"),
                count("pan count"),
                count("tilt count"),
            ],
        }
    }

    /// Jiwy at rest in the middle, with counters that read `counts` there.
    pub fn jiwy(counts: [i32; 2]) -> Self {
        let axes = [PAN, TILT];
        Self::new(
            axes.map(Motor::new),
            [0, 1].map(|axis| Encoder::new(axes[axis].gear_ratio, counts[axis])),
        )
    }

    /// The state of the axes, which the sensors do not show completely.
    pub fn states(&self) -> [MotorState; 2] {
        [self.axes[0].state(), self.axes[1].state()]
    }
}

impl Plant for PanTilt {
    fn inputs(&self) -> &[Port] {
        &self.ports[..2]
    }

    fn outputs(&self) -> &[Port] {
        &self.ports[2..]
    }

    fn apply(&mut self, inputs: &[f64]) -> Result<(), PlantError> {
        for (axis, duty) in self.axes.iter_mut().zip(inputs) {
            axis.apply(std::slice::from_ref(duty))?;
        }
        Ok(())
    }

    fn step(&mut self, time: Duration) -> Result<(), PlantError> {
        self.axes.iter_mut().try_for_each(|axis| axis.step(time))
    }

    fn measure(&mut self, outputs: &mut [f64]) -> Result<(), PlantError> {
        for ((output, axis), encoder) in outputs.iter_mut().zip(&self.axes).zip(&self.encoders) {
            *output = encoder.count(axis.state().angle).into();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Checked, Decoder};

    #[test]
    fn is_its_two_axes_seen_through_their_counters() {
        let counts = [i32::MAX - 10, 5];
        let mut camera = Checked::new(PanTilt::jiwy(counts));
        let mut axes = [PAN, TILT].map(Motor::new);
        let mut decoders =
            [0, 1].map(|axis| Decoder::new([PAN, TILT][axis].gear_ratio, counts[axis]));
        let ms = Duration::from_millis(1);
        for n in 0..2000 {
            let duties = [0.6 * (f64::from(n) * 0.01).sin(), -0.4];
            for (axis, duty) in duties.into_iter().enumerate() {
                camera.set_input(axis, duty).unwrap();
                axes[axis].drive(duty, 1e-3);
            }
            camera.step(ms).unwrap();
            for axis in [0, 1] {
                let angle = decoders[axis].angle(camera.outputs().unwrap()[axis] as i32);
                assert!(
                    (angle - axes[axis].state().angle).abs() < 1e-4,
                    "axis {axis}, cycle {n}"
                );
            }
        }
        // Tilt is at its stop.
        assert!(camera.plant().states()[1].angle < -TILT.end_stop);
    }
}
