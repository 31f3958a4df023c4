//! The contract of a simulated plant, and the wrapper that enforces it.

use crate::error::{PlantError, Side};
use crate::port::{Outside, Port};
use std::time::Duration;

/// A simulated machine, or a part of one.
///
/// Time advances only in [`step`](Self::step), with the last applied inputs held constant, as a
/// converter holds them. Use it through a [`PlantLink`](crate::PlantLink), or directly through
/// [`Checked`], which enforces the promises below.
///
/// An implementation promises: the same calls give the same values; the numbers of ports never
/// change; `step` allocates nothing and takes bounded time (each type states its bound, and
/// exceptions). A failure is final.
///
/// ```
/// use luna_plants::{Checked, Plant, PlantError, Port};
/// use std::time::Duration;
///
/// /// A tank with an inlet.
/// struct Tank { ports: [Port; 2], flow: f64, level: f64 }
///
/// impl Plant for Tank {
///     fn inputs(&self) -> &[Port] { &self.ports[..1] }
///     fn outputs(&self) -> &[Port] { &self.ports[1..] }
///     fn apply(&mut self, inputs: &[f64]) -> Result<(), PlantError> {
///         self.flow = inputs[0];
///         Ok(())
///     }
///     fn step(&mut self, time: Duration) -> Result<(), PlantError> {
///         self.level += self.flow * time.as_secs_f64();
///         Ok(())
///     }
///     fn measure(&mut self, outputs: &mut [f64]) -> Result<(), PlantError> {
///         outputs[0] = self.level;
///         Ok(())
///     }
/// }
///
/// let ports = [Port::new("flow", "m3/s"), Port::new("level", "m3").range(0.0, 10.0)];
/// let mut tank = Checked::new(Tank { ports, flow: 0.0, level: 1.0 });
/// tank.set("flow", 0.5).unwrap();
/// tank.step(Duration::from_secs(4)).unwrap();
/// assert_eq!(tank.get("level"), Ok(3.0));
/// // It runs over: no level is returned any more.
/// assert!(tank.step(Duration::from_secs(100)).is_err());
/// assert!(tank.get("level").is_err());
/// ```
pub trait Plant {
    /// What actuators apply. In the order of [`apply`](Self::apply).
    fn inputs(&self) -> &[Port];

    /// What sensors read. In the order of [`measure`](Self::measure).
    fn outputs(&self) -> &[Port];

    /// Sets the values of all inputs, which hold from now on. They are within their ranges. Takes
    /// no time.
    ///
    /// # Errors
    ///
    /// The model refuses them.
    fn apply(&mut self, inputs: &[f64]) -> Result<(), PlantError>;

    /// Lets `time` go by.
    ///
    /// # Errors
    ///
    /// The model cannot: a step of zero or too long, no solution.
    fn step(&mut self, time: Duration) -> Result<(), PlantError>;

    /// Writes the values of all outputs at this moment. Takes no time.
    ///
    /// # Errors
    ///
    /// The model has none.
    fn measure(&mut self, outputs: &mut [f64]) -> Result<(), PlantError>;
}

impl<P: Plant + ?Sized> Plant for Box<P> {
    fn inputs(&self) -> &[Port] {
        (**self).inputs()
    }

    fn outputs(&self) -> &[Port] {
        (**self).outputs()
    }

    fn apply(&mut self, inputs: &[f64]) -> Result<(), PlantError> {
        (**self).apply(inputs)
    }

    fn step(&mut self, time: Duration) -> Result<(), PlantError> {
        (**self).step(time)
    }

    fn measure(&mut self, outputs: &mut [f64]) -> Result<(), PlantError> {
        (**self).measure(outputs)
    }
}

/// A plant in a wrapper that checks it: inputs are saturated or refused by their ranges, outputs
/// are checked before they are returned, and after a failure every call returns that failure.
///
/// Inputs begin at 0, or at the end of their range next to 0. For an example see [`Plant`].
#[derive(Debug)]
pub struct Checked<P> {
    plant: P,
    inputs: Box<[f64]>,
    outputs: Box<[f64]>,
    /// Whether `inputs` were applied to the plant, and `outputs` read from it.
    is_applied: bool,
    is_measured: bool,
    failure: Option<PlantError>,
}

impl<P: Plant> Checked<P> {
    /// Puts the guard around `plant`. Allocates.
    pub fn new(plant: P) -> Self {
        let inputs = plant.inputs().iter().map(neutral).collect();
        let outputs = vec![0.0; plant.outputs().len()].into();
        Self {
            plant,
            inputs,
            outputs,
            is_applied: false,
            is_measured: false,
            failure: None,
        }
    }

    /// The plant, to look at.
    pub fn plant(&self) -> &P {
        &self.plant
    }

    /// Which number the input called `name` has. O(inputs).
    pub fn input(&self, name: &str) -> Option<usize> {
        position(self.plant.inputs(), name)
    }

    /// Which number the output called `name` has. O(outputs).
    pub fn output(&self, name: &str) -> Option<usize> {
        position(self.plant.outputs(), name)
    }

    /// Why it has failed, if it has.
    pub fn failure(&self) -> Option<&PlantError> {
        self.failure.as_ref()
    }

    /// Applies `value` to the input of this number from now on; a value outside of its range is
    /// treated as its port specifies. O(1).
    ///
    /// # Errors
    ///
    /// The value is not a number, or outside of a range that does not saturate; or the plant has
    /// failed before.
    ///
    /// # Panics
    ///
    /// If there is no such input.
    #[track_caller]
    pub fn set_input(&mut self, input: usize, value: f64) -> Result<(), PlantError> {
        self.unless_failed()?;
        match within(&self.plant.inputs()[input], Side::Input, value) {
            Ok(value) => {
                self.inputs[input] = value;
                self.is_applied = false;
                Ok(())
            }
            Err(error) => Err(self.fail(error)),
        }
    }

    /// [`set_input`](Self::set_input) by name. O(inputs).
    ///
    /// # Errors
    ///
    /// As [`set_input`](Self::set_input).
    ///
    /// # Panics
    ///
    /// If there is no such input.
    #[track_caller]
    pub fn set(&mut self, input: &str, value: f64) -> Result<(), PlantError> {
        let number = self.input(input);
        self.set_input(
            number.unwrap_or_else(|| panic!("there is no input `{input}`")),
            value,
        )
    }

    /// Sets the input of this number to its neutral value: 0, or the end of its range next to it,
    /// as a disabled bridge does. O(1).
    ///
    /// # Panics
    ///
    /// If there is no such input.
    #[track_caller]
    pub fn set_neutral(&mut self, input: usize) {
        self.inputs[input] = neutral(&self.plant.inputs()[input]);
        self.is_applied = false;
    }

    /// Advances by `time` with the present inputs, and checks the outputs. Costs the plant's step
    /// and O(ports). Allocates nothing.
    ///
    /// # Errors
    ///
    /// The step fails, or an output is not finite, or outside of a range that does not saturate.
    /// From then on this and all outputs return that error.
    pub fn step(&mut self, time: Duration) -> Result<(), PlantError> {
        self.unless_failed()?;
        self.is_measured = false;
        let stepped = self
            .apply()
            .and_then(|()| self.plant.step(time))
            .and_then(|()| self.measure());
        stepped.map_err(|error| self.fail(error))
    }

    /// The present outputs, all within their ranges. O(ports) after a change, else O(1).
    ///
    /// # Errors
    ///
    /// As [`step`](Self::step).
    pub fn outputs(&mut self) -> Result<&[f64], PlantError> {
        self.unless_failed()?;
        if !self.is_measured {
            let measured = self.apply().and_then(|()| self.measure());
            measured.map_err(|error| self.fail(error))?;
        }
        Ok(&self.outputs)
    }

    /// One output by name. O(ports).
    ///
    /// # Errors
    ///
    /// As [`step`](Self::step).
    ///
    /// # Panics
    ///
    /// If there is no such output.
    #[track_caller]
    pub fn get(&mut self, output: &str) -> Result<f64, PlantError> {
        let Some(number) = self.output(output) else {
            panic!("there is no output `{output}`")
        };
        Ok(self.outputs()?[number])
    }

    fn apply(&mut self) -> Result<(), PlantError> {
        if !self.is_applied {
            self.plant.apply(&self.inputs)?;
            self.is_applied = true;
        }
        Ok(())
    }

    fn measure(&mut self) -> Result<(), PlantError> {
        // An output that the model does not write stays NaN, which is an error.
        self.outputs.fill(f64::NAN);
        self.plant.measure(&mut self.outputs)?;
        for (value, port) in self.outputs.iter_mut().zip(self.plant.outputs()) {
            *value = within(port, Side::Output, *value)?;
        }
        self.is_measured = true;
        Ok(())
    }

    fn unless_failed(&self) -> Result<(), PlantError> {
        self.failure.clone().map_or(Ok(()), Err)
    }

    fn fail(&mut self, error: PlantError) -> PlantError {
        self.failure.get_or_insert(error).clone()
    }
}

fn position(ports: &[Port], name: &str) -> Option<usize> {
    ports.iter().position(|port| port.name() == name)
}

fn neutral(port: &Port) -> f64 {
    0.0_f64.clamp(port.min(), port.max())
}

/// The value as the port has it.
fn within(port: &Port, side: Side, value: f64) -> Result<f64, PlantError> {
    let saturated = value.clamp(port.min(), port.max());
    let may_be_outside = port.on_outside() == Outside::Saturate;
    if !saturated.is_finite() || !(value.is_finite() || may_be_outside) {
        return Err(PlantError::NotFinite {
            side,
            port: port.shared_name(),
            value,
        });
    }
    if saturated != value && !may_be_outside {
        return Err(PlantError::OutOfRange {
            side,
            port: port.clone(),
            value,
        });
    }
    Ok(saturated)
}

#[cfg(test)]
mod tests;
