//! Co-simulation FMUs as plants (feature `fmi`).
//!
//! A *functional mock-up unit* is a model that a simulation tool has exported with its solver: a
//! zip archive with a description and a shared library. 20-sim, OpenModelica, Simulink, Dymola and
//! others write them. Versions 2 and 3 of the standard are supported; the
//! [`fmi`](https://docs.rs/fmi) crate does the loading and the C interface.
//!
//! What an FMU logs is a [message](luna::log::message) from `fmu` and the instance's name; while it
//! refuses to be set up it is in the error too.
//!
//! ```no_run
//! use luna_plants::{PlantLink, fmu::Fmu};
//! # fn main() -> luna::Result<()> {
//! let fmu = Fmu::open("motor.fmu")?;
//! println!("{fmu}"); // its variables, with units and ranges
//! let motor = fmu.parameter("resistance", 4.7)?.instantiate("motor", &["voltage"], &["speed"])?;
//! let mut link = PlantLink::new("motor", motor);
//! # let (_, voltages) = luna::channel::<f64>();
//! link.actuator("voltage", voltages)?;
//! # Ok(()) }
//! ```
//!
//! ## Ranges
//!
//! The ports have the minimum and maximum of the description, or of the declared type. Inputs
//! saturate there, since the standard forbids setting values outside; an output outside is a
//! failure of the plant. Units are the description's, "1" if it has none; values are not converted.
//!
//! ## Risks
//!
//! An FMU is foreign code: it may allocate, block, and take any time in a step. Give its plant an
//! executor or an OS thread of its own, with a priority below control.
//!
//! A crash in it, `abort`, `exit`, or a C++ exception that leaves one of its functions ends the
//! program at once: no function of [`on_emergency`](luna::System::on_emergency) runs. Load only
//! FMUs that you trust as much as a linked library; run others in a program of their own.

mod code;
mod description;
mod error;
mod instance;
mod journal;

pub use error::{FmuError, FmuFault, FmuStatus};

use crate::error::Side;
use crate::{Outside, Plant, PlantError, Port};
use description::Description;
use error::causality;
use instance::{Called, Instance};
use std::fmt;
use std::fs::File;
use std::path::Path;
use std::time::Duration;
use tempfile::TempDir;

/// A version of the standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Version {
    /// 2.0
    Two,
    /// 3.0
    Three,
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Version::Two => "FMI 2.0",
            Version::Three => "FMI 3.0",
        })
    }
}

/// The types that a port can be of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Kind {
    Real,
    Integer,
    Boolean,
}

impl Kind {
    /// Whether it has this value, which is within the range.
    fn has(self, value: f64) -> Result<(), &'static str> {
        match self {
            Kind::Real => Ok(()),
            Kind::Integer if value.fract() == 0.0 => Ok(()),
            Kind::Integer => Err("integer"),
            Kind::Boolean if value == 0.0 || value == 1.0 => Ok(()),
            Kind::Boolean => Err("boolean"),
        }
    }
}

/// A variable of an FMU.
#[derive(Debug, Clone, PartialEq)]
struct Variable {
    name: String,
    reference: u32,
    causality: String,
    type_name: String,
    /// None of one that no port can be.
    kind: Option<Kind>,
    unit: String,
    min: f64,
    max: f64,
}

impl Variable {
    fn kind(&self) -> Result<Kind, FmuError> {
        self.kind.ok_or_else(|| FmuError::Type {
            name: self.name.clone(),
            found: self.type_name.clone(),
        })
    }

    fn port(&self) -> Port {
        Port::new(&self.name, &self.unit).range(self.min, self.max)
    }
}

/// An unpacked FMU and its description; none of its code has run. Its `Display` lists its
/// variables.
pub struct Fmu {
    files: TempDir,
    description: Description,
    parameters: Vec<(Kind, u32, f64)>,
    is_logging: bool,
}

impl Fmu {
    /// Unpacks the FMU at `path` to a temporary folder, which exists as long as it and its plant,
    /// and reads its description.
    ///
    /// # Errors
    ///
    /// The file does not exist or is not an archive; its description is missing or malformed; it
    /// has another version, or is not for co-simulation.
    ///
    /// ```
    /// use luna_plants::fmu::{Fmu, FmuError};
    /// assert!(matches!(Fmu::open("nowhere.fmu"), Err(FmuError::File { .. })));
    /// ```
    pub fn open(path: impl AsRef<Path>) -> Result<Fmu, FmuError> {
        let path = path.as_ref();
        let no_file = |reason: String| FmuError::File {
            path: path.to_owned(),
            reason,
        };
        let file = File::open(path).map_err(|error| no_file(error.to_string()))?;
        let mut archive = zip::ZipArchive::new(file).map_err(|error| no_file(error.to_string()))?;
        let files = tempfile::Builder::new()
            .prefix("luna-fmu-")
            .tempdir()
            .map_err(|error| no_file(error.to_string()))?;
        archive
            .extract(&files)
            .map_err(|error| no_file(error.to_string()))?;
        // Some have no resources: the folder that it is told of is there all the same.
        std::fs::create_dir_all(files.path().join("resources"))
            .map_err(|error| no_file(error.to_string()))?;
        let xml = std::fs::read_to_string(files.path().join("modelDescription.xml")).map_err(
            |error| FmuError::Description {
                reason: format!("modelDescription.xml: {error}"),
            },
        )?;
        Ok(Fmu {
            files,
            description: Description::parse(&xml)?,
            parameters: Vec::new(),
            is_logging: false,
        })
    }

    /// The version of the standard that it follows.
    pub fn version(&self) -> Version {
        self.description.version
    }

    /// Sets a parameter before the model is initialized. Other parameters have the values of the
    /// description.
    ///
    /// # Errors
    ///
    /// No parameter has that name, its type is not a number, or the value is outside of its range.
    pub fn parameter(mut self, name: &str, value: f64) -> Result<Fmu, FmuError> {
        let variable = self.variable(name, "parameter")?;
        let kind = variable.kind()?;
        let refused = |reason: String| FmuError::Value {
            name: name.to_owned(),
            value,
            reason,
        };
        // Including NaN.
        if !(variable.min <= value && value <= variable.max && value.is_finite()) {
            return Err(refused(format!(
                "it is within {} to {}",
                variable.min, variable.max
            )));
        }
        kind.has(value)
            .map_err(|kind| refused(format!("it is {kind}")))?;
        let reference = variable.reference;
        self.parameters.push((kind, reference, value));
        Ok(self)
    }

    /// Turns its debug logging on: without it most log no more than warnings and errors.
    #[must_use]
    pub fn debug_log(mut self) -> Fmu {
        self.is_logging = true;
        self
    }

    /// Loads its code, and creates an instance called `name`, initialized at time 0: a plant with
    /// these inputs and outputs, by the names of its variables. Inputs that are not listed keep the
    /// model's values.
    ///
    /// # Errors
    ///
    /// There is no code for this platform, or it does not match the description; a variable does
    /// not exist, has another causality, or its type is not a number; the model's initialization
    /// fails.
    pub fn instantiate(
        self,
        name: &str,
        inputs: &[&str],
        outputs: &[&str],
    ) -> Result<FmuPlant, FmuError> {
        let (inputs, input_ports) = self.ports(inputs, Side::Input)?;
        let (outputs, output_ports) = self.ports(outputs, Side::Output)?;
        let mut instance = Instance::new(self.files, &self.description, name, self.is_logging)?;
        for (kind, reference, value) in self.parameters {
            let set = instance.set(kind, reference, value);
            set.map_err(|status| instance.refused("set of a parameter", status))?;
        }
        let entered = instance.enter_initialization();
        entered.map_err(|status| instance.refused("enterInitializationMode", status))?;
        let left = instance.exit_initialization();
        left.map_err(|status| instance.refused("exitInitializationMode", status))?;
        instance.set_up();
        Ok(FmuPlant {
            instance,
            inputs,
            input_ports,
            outputs,
            output_ports,
            takes_any_step: self.description.takes_any_step,
            first_step: None,
            now: Duration::ZERO,
        })
    }

    #[expect(clippy::type_complexity, reason = "two columns of one table")]
    fn ports(&self, names: &[&str], side: Side) -> Result<(Vec<(Kind, u32)>, Vec<Port>), FmuError> {
        let mut references = Vec::new();
        let mut ports = Vec::new();
        for name in names {
            let variable = self.variable(name, causality(side))?;
            references.push((variable.kind()?, variable.reference));
            ports.push(match side {
                Side::Input => variable.port().outside(Outside::Saturate),
                Side::Output => variable.port(),
            });
        }
        Ok((references, ports))
    }

    fn variable(&self, name: &str, wanted: &'static str) -> Result<&Variable, FmuError> {
        let variables = &self.description.variables;
        let Some(variable) = variables.iter().find(|variable| variable.name == name) else {
            let known = variables.iter().filter(|one| one.causality == wanted);
            return Err(FmuError::NoSuchVariable {
                name: name.to_owned(),
                known: known.map(|one| one.name.clone()).collect(),
            });
        };
        if variable.causality != wanted {
            return Err(FmuError::Causality {
                name: name.to_owned(),
                wanted,
                found: variable.causality.clone(),
            });
        }
        Ok(variable)
    }
}

impl fmt::Display for Fmu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", self.description.model, self.version())?;
        for variable in &self.description.variables {
            write!(f, "\n  {} {}: ", variable.causality, variable.type_name)?;
            variable.port().fmt(f)?;
        }
        Ok(())
    }
}

impl fmt::Debug for Fmu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Fmu")
            .field("model", &self.description.model)
            .field("version", &self.version())
            .finish_non_exhaustive()
    }
}

/// An instance of an FMU, as a plant: see [`Fmu::instantiate`].
///
/// A step is one doStep. An FMU that only takes steps of one length gets several for a step that is
/// a multiple of the first. The FMU determines how long that takes, and whether it allocates.
pub struct FmuPlant {
    instance: Instance,
    inputs: Vec<(Kind, u32)>,
    input_ports: Vec<Port>,
    outputs: Vec<(Kind, u32)>,
    output_ports: Vec<Port>,
    takes_any_step: bool,
    first_step: Option<Duration>,
    now: Duration,
}

/// The limit of steps of one length for one longer step.
const MAX_STEPS: u128 = 100_000;

fn fault<T>(call: &'static str, called: Called<T>) -> Result<T, PlantError> {
    called.map_err(|status| PlantError::Fmu(FmuFault::Call { call, status }))
}

impl Plant for FmuPlant {
    fn inputs(&self) -> &[Port] {
        &self.input_ports
    }

    fn outputs(&self) -> &[Port] {
        &self.output_ports
    }

    fn apply(&mut self, inputs: &[f64]) -> Result<(), PlantError> {
        for ((&(kind, reference), port), &value) in
            self.inputs.iter().zip(&self.input_ports).zip(inputs)
        {
            kind.has(value).map_err(|into| PlantError::DoesNotFit {
                side: Side::Input,
                port: port.shared_name(),
                value,
                into,
            })?;
            fault("set", self.instance.set(kind, reference, value))?;
        }
        Ok(())
    }

    fn step(&mut self, time: Duration) -> Result<(), PlantError> {
        if time.is_zero() {
            return Err(PlantError::Step {
                step: time,
                longest: Duration::MAX,
            });
        }
        let first = *self.first_step.get_or_insert(time);
        let (step, steps) = if self.takes_any_step {
            (time, 1)
        } else {
            let steps = time.as_nanos() / first.as_nanos();
            if !time.as_nanos().is_multiple_of(first.as_nanos()) || steps > MAX_STEPS {
                return Err(PlantError::Fmu(FmuFault::StepSize { first, step: time }));
            }
            (first, steps)
        };
        for _ in 0..steps {
            // From whole nanoseconds each time, so that rounding does not add up.
            let at = self.now.as_secs_f64();
            fault("doStep", self.instance.do_step(at, step.as_secs_f64()))?;
            self.now += step;
        }
        Ok(())
    }

    fn measure(&mut self, outputs: &mut [f64]) -> Result<(), PlantError> {
        for (&(kind, reference), value) in self.outputs.iter().zip(outputs) {
            *value = fault("get", self.instance.get(kind, reference))?;
        }
        Ok(())
    }
}

impl Drop for FmuPlant {
    fn drop(&mut self) {
        self.instance.terminate();
    }
}

impl fmt::Debug for FmuPlant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FmuPlant")
            .field("inputs", &self.input_ports)
            .field("outputs", &self.output_ports)
            .finish_non_exhaustive()
    }
}
