//! Generated code between channels.

use crate::Submodel;
use luna::{Process, Receiver, Result, Sender};
use std::fmt;
use std::time::Duration;

/// A sub-model as a process: it receives one value of each input in order, computes a step, and
/// sends one value of each output in order.
///
/// It has no clock: the writers of its inputs set its pace, such as a periodic reader of a sensor.
/// The code's time is 0 in the first step, and increases by `step` in each. It is initialized in
/// `pre_run`, and ends without an error when an input's writers or an output's readers are gone. An
/// output that is not finite is not sent: all outputs are poisoned, including the contents of
/// buffers, and an emergency is raised ([`luna::emergency`]).
///
/// ```no_run
/// # use luna_external_code::{Submodel, SubmodelProcess};
/// # fn example(pid: Submodel<2, 1, 3, 4>, main: luna::Executor) -> luna::Result<()> {
/// let (set_point, set_points) = luna::channel();
/// let (angle, angles) = luna::channel();
/// let (duty, duties) = luna::channel();
/// let step = std::time::Duration::from_millis(1);
/// main.process("pid").spawn(SubmodelProcess::new(pid, step, [set_points, angles], [duty]))?;
/// # Ok(()) }
/// ```
#[must_use = "it is a process: spawn it"]
pub struct SubmodelProcess<const U: usize, const Y: usize, const X: usize, const P: usize> {
    submodel: Submodel<U, Y, X, P>,
    step: Duration,
    inputs: [Receiver<f64>; U],
    outputs: [Sender<f64>; Y],
    parameters: Vec<(usize, f64)>,
}

impl<const U: usize, const Y: usize, const X: usize, const P: usize> SubmodelProcess<U, Y, X, P> {
    /// A process of `submodel` with these channels. The code's time increases by `step` in each
    /// step.
    pub fn new(
        submodel: Submodel<U, Y, X, P>,
        step: Duration,
        inputs: [Receiver<f64>; U],
        outputs: [Sender<f64>; Y],
    ) -> Self {
        Self {
            submodel,
            step,
            inputs,
            outputs,
            parameters: Vec::new(),
        }
    }

    /// Sets a parameter to a value other than the model's.
    ///
    /// # Panics
    ///
    /// If there is no parameter of that number.
    #[track_caller]
    pub fn parameter(mut self, number: usize, value: f64) -> Self {
        assert!(
            number < P,
            "there are {P} parameters, and none of number {number}"
        );
        self.parameters.push((number, value));
        self
    }
}

impl<const U: usize, const Y: usize, const X: usize, const P: usize> Process
    for SubmodelProcess<U, Y, X, P>
{
    fn pre_run(&mut self) -> Result<()> {
        self.submodel.initialize(0.0);
        for &(number, value) in &self.parameters {
            self.submodel.set_parameter(number, value);
        }
        Ok(())
    }

    async fn run(&mut self) -> Result<()> {
        let mut time = Duration::ZERO;
        let mut inputs = [0.0; U];
        loop {
            for (value, input) in inputs.iter_mut().zip(&self.inputs) {
                match input.recv().await {
                    Ok(came) => *value = came,
                    Err(error) if error.is_closed() => return Ok(()),
                    Err(error) => return Err(error.into()),
                }
            }
            let outputs = match self.submodel.step(inputs, time.as_secs_f64()) {
                Ok(outputs) => outputs,
                Err(error) => {
                    // Before the emergency: no process that runs for it receives an old value.
                    for output in &self.outputs {
                        output.poison();
                    }
                    return Err(luna::realtime::off_path(|| luna::emergency(error.into())));
                }
            };
            time += self.step;
            for (&value, output) in outputs.iter().zip(&self.outputs) {
                match output.send(value).await {
                    Ok(()) => {}
                    Err(error) if error.is_closed() => return Ok(()),
                    Err(error) => return Err(error.into()),
                }
            }
        }
    }
}

impl<const U: usize, const Y: usize, const X: usize, const P: usize> fmt::Debug
    for SubmodelProcess<U, Y, X, P>
{
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SubmodelProcess")
            .field("submodel", &self.submodel)
            .field("step", &self.step)
            .finish_non_exhaustive()
    }
}
