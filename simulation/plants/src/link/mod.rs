//! Connects channels to a plant, which replaces the hardware's link drivers.

mod ends;
mod process;

pub use ends::Measured;
pub use process::PlantProcess;

use crate::error::{ConnectError, Side};
use crate::{Checked, Plant, Port};
use ends::{ActuatorEnd, SensorEnd};
use luna::{Receiver, Sender};
use process::Pace;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// A simulated plant, and its ends of the channels by which processes reach their actuators and
/// sensors.
///
/// Control processes write to a [`Sender`] and read from a [`Receiver`]. At set-up the other ends
/// go to the hardware's link drivers ([`luna::external`]) or to a link, which is then spawned as a
/// process of its own: the control processes do not change.
///
/// ```
/// use luna::prelude::*;
/// use luna_plants::{FirstOrderLag, PlantLink, Port};
/// use std::time::Duration;
///
/// let (power, heating) = luna::channel::<f64>();
/// let (measured, temperatures) = luna::channel::<f64>();
/// let mut system = System::new("oven");
/// let main = system.executor("main").build()?;
///
/// // The control process: it knows its channels alone.
/// main.process("control").spawn(async move {
///     let mut temperature = 0.0;
///     for _ in 0..100 {
///         temperature = temperatures.recv().await?;
///         power.send(20.0 * (80.0 - temperature)).await?;
///     }
///     assert!((temperature - 76.2_f64).abs() < 0.1);
///     Ok(())
/// })?;
///
/// // Chosen here: an oven that is not there.
/// let oven = FirstOrderLag::new(
///     Port::new("power", "W"),
///     Port::new("temperature", "K"),
///     1.0,
///     Duration::from_secs(20),
/// );
/// let mut link = PlantLink::new("oven", oven);
/// link.actuator("power", heating)?;
/// link.sensor("temperature", measured)?;
/// main.process("oven").spawn(link.lock_step(Duration::from_millis(100))?)?;
///
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
///
/// ## When a plant fails
///
/// A failure is a step that fails, an output that is not a number or out of its range, or an input
/// that is not a number. From then on no value of the plant is delivered, not even from a buffer:
/// its channels are poisoned one after the other. Then an emergency is raised ([`luna::emergency`])
/// with a [`PlantFailure`](crate::PlantFailure) as its cause: the functions of
/// [`on_emergency`](luna::System::on_emergency) run, the system ends, and
/// [`System::run`](luna::System::run) returns the cause.
pub struct PlantLink<P> {
    name: Arc<str>,
    plant: Checked<P>,
    actuators: Vec<Actuator>,
    sensors: Vec<Sensor>,
    held: Vec<usize>,
    enabled: Arc<AtomicBool>,
    at_end: Option<AtEnd<P>>,
}

type AtEnd<P> = Box<dyn FnOnce(&P) + Send>;

struct Actuator {
    input: usize,
    end: Box<dyn ActuatorEnd>,
}

struct Sensor {
    output: usize,
    end: Box<dyn SensorEnd>,
}

impl<P: Plant> PlantLink<P> {
    /// A link to `plant`. Its loop and its failures carry `name`.
    pub fn new(name: &str, plant: P) -> Self {
        Self {
            name: Arc::from(name),
            plant: Checked::new(plant),
            actuators: Vec::new(),
            sensors: Vec::new(),
            held: Vec::new(),
            enabled: Arc::new(AtomicBool::new(true)),
            at_end: None,
        }
    }

    /// Applies values from `channel` to the input called `input`, in its unit.
    ///
    /// # Errors
    ///
    /// There is no such input, or it has an actuator already.
    pub fn actuator<T: Into<f64> + Send + 'static>(
        &mut self,
        input: &str,
        channel: Receiver<T>,
    ) -> Result<&mut Self, ConnectError> {
        let number = self.free_input(input)?;
        self.actuators.push(Actuator {
            input: number,
            end: Box::new(channel),
        });
        Ok(self)
    }

    /// Sends the output called `output`, in its unit, to `channel`. One output may have several
    /// channels.
    ///
    /// # Errors
    ///
    /// There is no such output.
    pub fn sensor<T: Measured + Send + 'static>(
        &mut self,
        output: &str,
        channel: Sender<T>,
    ) -> Result<&mut Self, ConnectError> {
        let number = self
            .plant
            .output(output)
            .ok_or_else(|| self.no_such(Side::Output, output, self.plant.plant().outputs()))?;
        self.sensors.push(Sensor {
            output: number,
            end: Box::new(channel),
        });
        Ok(self)
    }

    /// Holds the input called `input` at `value`: a load, an ambient temperature.
    ///
    /// # Errors
    ///
    /// There is no such input, it has an actuator, or the value is invalid for it.
    pub fn hold(&mut self, input: &str, value: f64) -> Result<&mut Self, ConnectError> {
        let number = self.free_input(input)?;
        self.plant
            .set_input(number, value)
            .map_err(|error| ConnectError::Refused {
                plant: self.name.to_string(),
                error,
            })?;
        self.held.push(number);
        Ok(self)
    }

    /// The enable line of all actuators. Take it before [`periodic`](Self::periodic) or
    /// [`lock_step`](Self::lock_step), for a function of
    /// [`on_emergency`](luna::System::on_emergency).
    pub fn enable_line(&self) -> EnableLine {
        EnableLine(self.enabled.clone())
    }

    /// Calls `f` with the plant when its process has ended, off the real-time path, to inspect its
    /// final state. Only the last `f` given is called.
    pub fn at_end(&mut self, f: impl FnOnce(&P) + Send + 'static) -> &mut Self {
        self.at_end = Some(Box::new(f));
        self
    }

    /// A process that steps the plant each `period`, as hardware that runs by itself.
    ///
    /// In each slot the plant is stepped by the time since the slot before, with the last
    /// set-points; then the newest value of each actuator is received, then each sensor is sent its
    /// present value, if there is room or a reader waits. The plant never waits. So use registers
    /// ([`Buffer::overwrite_oldest(1)`](luna::Buffer::overwrite_oldest)) for both: on a rendezvous
    /// a writer or reader waits for the next slot, and a full FIFO loses the newest values. Before
    /// the first value of an actuator its input is neutral (0, or the end of its range next to 0);
    /// when its writers are gone it keeps its last value.
    ///
    /// The sensors are sent the initial state before the first slot, and time counts from there. So
    /// the first step is one period and the time of missed slots. With
    /// [`Timers::Manager`](luna::time::Timers::Manager) all loops of a period share their slots;
    /// then the first step is the rest of the current period. (An FMU that only takes steps of one
    /// length then fails at its second step.)
    ///
    /// It ends when the writers of all actuators are gone; without actuators, when the readers of
    /// all sensors are. Real-time path: the plant's step and O(ports); no allocation. Its time is
    /// the system's clock.
    ///
    /// # Errors
    ///
    /// Inputs that are neither connected nor held, or a period of zero.
    pub fn periodic(self, period: Duration) -> Result<PlantProcess<P>, ConnectError> {
        self.into_process(Pace::Periodic(period))
    }

    /// A process that steps the plant by `step` in each exchange: in lock-step neither side runs
    /// ahead, and no clock is used.
    ///
    /// An exchange is one value to each sensor and one from each actuator, in the order in which
    /// the processes receive and send them. The sensors of the first exchange have the initial
    /// state. Then the plant is stepped with the received values. So a process that reads its
    /// sensors and then writes its actuators does one cycle an exchange. The outputs depend on the
    /// exchanges alone, not on the scheduling.
    ///
    /// It ends when the writers of one actuator are gone; without actuators, when the readers of
    /// all sensors are. A sensor without readers is skipped. Real-time path: the plant's step, and
    /// O(ports) a value; no allocation.
    ///
    /// # Errors
    ///
    /// Inputs that are neither connected nor held, or a step of zero.
    pub fn lock_step(self, step: Duration) -> Result<PlantProcess<P>, ConnectError> {
        self.into_process(Pace::LockStep(step))
    }

    fn into_process(self, pace: Pace) -> Result<PlantProcess<P>, ConnectError> {
        let inputs = self.plant.plant().inputs();
        let missing: Vec<String> = (0..inputs.len())
            .filter(|&input| !self.is_taken(input))
            .map(|input| inputs[input].name().to_owned())
            .collect();
        if !missing.is_empty() {
            return Err(ConnectError::NotConnected {
                plant: self.name.to_string(),
                ports: missing,
            });
        }
        if pace.time().is_zero() {
            return Err(ConnectError::ZeroStep {
                plant: self.name.to_string(),
            });
        }
        Ok(PlantProcess::new(self, pace))
    }

    fn is_taken(&self, input: usize) -> bool {
        self.held.contains(&input) || self.actuators.iter().any(|one| one.input == input)
    }

    fn free_input(&self, input: &str) -> Result<usize, ConnectError> {
        let number = self
            .plant
            .input(input)
            .ok_or_else(|| self.no_such(Side::Input, input, self.plant.plant().inputs()))?;
        if self.is_taken(number) {
            return Err(ConnectError::Taken {
                plant: self.name.to_string(),
                port: input.to_owned(),
            });
        }
        Ok(number)
    }

    fn no_such(&self, side: Side, port: &str, known: &[Port]) -> ConnectError {
        ConnectError::NoSuchPort {
            plant: self.name.to_string(),
            side,
            port: port.to_owned(),
            known: known.iter().map(|port| port.name().to_owned()).collect(),
        }
    }
}

impl<P> fmt::Debug for PlantLink<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PlantLink")
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

/// The line that enables a plant's actuators, as that of a motor bridge.
///
/// ```
/// use luna_plants::{Motor, PAN, PlantLink};
///
/// let link = PlantLink::new("pan", Motor::new(PAN));
/// let line = link.enable_line();
/// let mut system = luna::System::new("arm");
/// system.on_emergency("motors off", move || line.cut());
/// ```
#[derive(Debug, Clone)]
pub struct EnableLine(Arc<AtomicBool>);

impl EnableLine {
    /// From the next step on all actuators apply nothing (0, or the end of their range next to it),
    /// whatever is written to them, for good. [Held](PlantLink::hold) inputs are not affected. From
    /// any thread; O(1).
    pub fn cut(&self) {
        self.0.store(false, Ordering::Relaxed);
    }
}
