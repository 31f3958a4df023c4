//! From channels to a plant: what takes the place of the hardware's link drivers.

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

/// A simulated plant, and the far ends of the channels by which processes reach their actuators and sensors.
///
/// Control processes write to a [`Sender`] and read from a [`Receiver`], whatever is behind them. At set-up the far ends go to link drivers of the hardware
/// ([`luna::external`]) or to one of these, which then is spawned as a process of its own: the control processes do not change.
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
/// let oven = FirstOrderLag::new(Port::new("power", "W"), Port::new("temperature", "K"), 1.0, Duration::from_secs(20));
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
/// A step that fails, an output that is not a number or out of its range, an input that is not a number: from then on nothing of the plant is delivered. Its channels are poisoned one after the
/// other, also what a buffer still holds, and then an emergency is raised ([`luna::emergency`]) whose cause is a [`PlantFailure`](crate::PlantFailure): the functions of
/// [`on_emergency`](luna::System::on_emergency) run, the system ends, and [`System::run`](luna::System::run) returns the cause.
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
    /// A link to `plant`, called `name`: so is its loop, and so it is called when it fails.
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

    /// Lets what comes from `channel` act on the input called `input`, in its unit.
    ///
    /// # Errors
    ///
    /// There is no such input, or it has an actuator.
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

    /// Sends what the output called `output` is, in its unit, to `channel`. One output may have several.
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
    /// There is no such input, it has an actuator, or the value is none for it.
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

    /// The enable line of all actuators. Take it before [`periodic`](Self::periodic) or [`lock_step`](Self::lock_step), for a function of
    /// [`on_emergency`](luna::System::on_emergency).
    pub fn enable_line(&self) -> EnableLine {
        EnableLine(self.enabled.clone())
    }

    /// Calls `f` with the plant when its process has ended, off the real-time path: to see where it has come to. Of several the last one is called.
    pub fn at_end(&mut self, f: impl FnOnce(&P) + Send + 'static) -> &mut Self {
        self.at_end = Some(Box::new(f));
        self
    }

    /// A process that steps the plant each `period`, as hardware that goes on by itself.
    ///
    /// In each slot the plant is stepped by the time since the slot before, with the set-points that were taken last; then the newest value of each actuator is
    /// taken, then each sensor is sent what is now, if there is room or somebody waits. Before the first slot the sensors say how it all begins: time counts from there, so the
    /// first step is a period and what was missed, or with [`Timers::Manager`](luna::Timers::Manager), whose slots all loops of a period share, what is left of the period that
    /// lasts. (Then an FMU that takes steps of one length alone fails at the second.) The plant never waits. So
    /// give both registers ([`Buffer::overwrite_oldest(1)`](luna::Buffer::overwrite_oldest)): on a rendezvous a writer waits for the next slot, and so does a reader; in a FIFO that is
    /// full the newest values are lost. Until an actuator has been written to, its input is neutral (0, or the end of its range next to 0); one whose
    /// writers are gone keeps its last value.
    ///
    /// It ends when the writers of all actuators are gone; if there are none, when the readers of all sensors are. Real-time path: the plant's step, and
    /// O(ports); no allocation. Time is the system's clock.
    ///
    /// # Errors
    ///
    /// Inputs that are neither connected nor held, or a period of zero.
    pub fn periodic(self, period: Duration) -> Result<PlantProcess<P>, ConnectError> {
        self.into_process(Pace::Periodic(period))
    }

    /// A process that steps the plant by `step` in each exchange: lock-step, in which neither side runs ahead, and no clock matters.
    ///
    /// An exchange is one value to each sensor and one from each actuator, in whatever order the processes take and give them. The first one's sensors say how it all
    /// begins. Then the plant is stepped with the values that came. A process that reads its sensors and then writes its actuators so does one cycle an exchange; what
    /// the plant puts out depends on the exchanges alone, not on who ran when.
    ///
    /// It ends when the writers of one actuator are gone; if there are none, when the readers of all sensors are. A sensor whose readers are gone is left out.
    /// Real-time path: the plant's step, and O(ports) a value; no allocation.
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
    /// From the next step on all actuators apply nothing (0, or the end of their range next to it), whatever is written to them. For good. Inputs that are
    /// [held](PlantLink::hold) are no actuators. From any thread; O(1).
    pub fn cut(&self) {
        self.0.store(false, Ordering::Relaxed);
    }
}
