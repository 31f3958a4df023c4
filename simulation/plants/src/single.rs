//! What plants of one input and one output have alike.

use crate::Port;

/// The input and the output of such a plant, and their values.
#[derive(Debug, Clone)]
pub(crate) struct Single {
    pub(crate) input: Port,
    pub(crate) output: Port,
    /// What the input was given last.
    pub(crate) applied: f64,
    /// The output's value.
    pub(crate) value: f64,
}

impl Single {
    /// Both at 0.
    pub(crate) fn new(input: Port, output: Port) -> Self {
        Self {
            input,
            output,
            applied: 0.0,
            value: 0.0,
        }
    }
}

/// [`Plant`](crate::Plant) except for the step, for a plant with a field `single`.
macro_rules! plant_of_single {
    () => {
        fn inputs(&self) -> &[Port] {
            std::slice::from_ref(&self.single.input)
        }

        fn outputs(&self) -> &[Port] {
            std::slice::from_ref(&self.single.output)
        }

        fn apply(&mut self, inputs: &[f64]) -> Result<(), PlantError> {
            self.single.applied = inputs[0];
            Ok(())
        }

        fn measure(&mut self, outputs: &mut [f64]) -> Result<(), PlantError> {
            outputs[0] = self.single.value;
            Ok(())
        }
    };
}

pub(crate) use plant_of_single;
