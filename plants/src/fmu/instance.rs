//! An instance of an FMU of either version, with one face.

use super::description::Description;
use super::error::{FmuError, FmuStatus};
use super::{Kind, Version};
use fmi::fmi2::import::Fmi2Import;
use fmi::fmi2::instance::{CoSimulation as _, Common as _};
use fmi::fmi2::{self, Fmi2Error};
use fmi::fmi3::import::Fmi3Import;
use fmi::fmi3::{self, CoSimulation as _, Fmi3Error, Fmi3Model, GetSet};
use fmi::traits::{FmiImport, FmiInstance};
use std::mem::ManuallyDrop;
use std::panic::{AssertUnwindSafe, catch_unwind};
use tempfile::TempDir;

/// What a call gives.
pub(super) type Called<T = ()> = Result<T, FmuStatus>;

/// A loaded and instantiated FMU.
pub(super) struct Instance {
    loaded: ManuallyDrop<Loaded>,
    is_fatal: bool,
    has_failed: bool,
    /// Its files, which it may read while it lives.
    _import: Import,
}

enum Loaded {
    Two(Box<fmi2::instance::InstanceCS>),
    Three(Box<fmi3::instance::InstanceCS>),
}

#[expect(dead_code, reason = "holds the unpacked files")]
enum Import {
    Two(Fmi2Import),
    Three(Fmi3Import),
}

// SAFETY: the standards bind an instance to no thread; they ask that its functions are not called at the same time, and it is used through `&mut` alone. What
// else is in it are handles of the loaded library, which any thread may use.
unsafe impl Send for Instance {}

fn from_two(error: Fmi2Error) -> FmuStatus {
    match error {
        Fmi2Error::Discard => FmuStatus::Discard,
        Fmi2Error::Fatal => FmuStatus::Fatal,
        _ => FmuStatus::Error,
    }
}

fn from_three(error: Fmi3Error) -> FmuStatus {
    match error {
        Fmi3Error::Discard => FmuStatus::Discard,
        Fmi3Error::Fatal => FmuStatus::Fatal,
        Fmi3Error::Error => FmuStatus::Error,
    }
}

fn library(error: fmi::Error) -> FmuError {
    match error {
        fmi::Error::Instantiation => FmuError::Refused {
            call: "instantiate",
            status: FmuStatus::Error,
        },
        other => FmuError::Library {
            reason: other.to_string(),
        },
    }
}

/// Names the first function that is not there.
macro_rules! demand {
    ($binding:expr; $($function:ident),+ $(,)?) => { $(
        if $binding.$function.is_err() {
            return Err(FmuError::Library { reason: concat!("it has no function ", stringify!($function)).to_owned() });
        }
    )+ };
}

impl Instance {
    /// Loads the code that lies in `files` and makes an instance called `name`.
    pub(super) fn new(
        files: TempDir,
        description: &Description,
        name: &str,
    ) -> Result<Self, FmuError> {
        let xml = description.for_loader();
        // It is made into a text of C.
        let name = name.replace('\0', " ");
        let (loaded, import) = match description.version {
            Version::Two => {
                let import = Fmi2Import::new(files, &xml).map_err(library)?;
                check_two(&import, &description.identifier)?;
                let instance = import
                    .instantiate_cs(&name, false, false)
                    .map_err(library)?;
                (Loaded::Two(Box::new(instance)), Import::Two(import))
            }
            Version::Three => {
                let import = Fmi3Import::new(files, &xml).map_err(library)?;
                check_three(&import, &description.identifier)?;
                let instance = import
                    .instantiate_cs(&name, false, false, false, false, &[])
                    .map_err(library)?;
                (Loaded::Three(Box::new(instance)), Import::Three(import))
            }
        };
        let instance = Self {
            loaded: ManuallyDrop::new(loaded),
            is_fatal: false,
            has_failed: false,
            _import: import,
        };
        instance.check_version(description.version)?;
        Ok(instance)
    }

    fn check_version(&self, description: Version) -> Result<(), FmuError> {
        let code = match &*self.loaded {
            Loaded::Two(instance) => FmiInstance::get_version(&**instance),
            Loaded::Three(instance) => FmiInstance::get_version(&**instance),
        };
        let first = match description {
            Version::Two => '2',
            Version::Three => '3',
        };
        if code.starts_with(first) {
            return Ok(());
        }
        Err(FmuError::VersionOfCode {
            description,
            code: code.to_owned(),
        })
    }

    pub(super) fn enter_initialization(&mut self) -> Called {
        self.call(
            |two| FmiInstance::enter_initialization_mode(two, None, 0.0, None),
            |three| FmiInstance::enter_initialization_mode(three, None, 0.0, None),
        )
    }

    pub(super) fn exit_initialization(&mut self) -> Called {
        self.call(
            FmiInstance::exit_initialization_mode,
            FmiInstance::exit_initialization_mode,
        )
    }

    /// From `at`, in seconds since the start, by `by`.
    pub(super) fn do_step(&mut self, at: f64, by: f64) -> Called {
        let mut has_ended = false;
        self.call(
            |two| two.do_step(at, by, true),
            |three| {
                let (mut event, mut terminate, mut early) = (false, false, false);
                let mut reached = at;
                let done = three.do_step(
                    at,
                    by,
                    true,
                    &mut event,
                    &mut terminate,
                    &mut early,
                    &mut reached,
                )?;
                has_ended = terminate || early;
                Ok(done)
            },
        )?;
        if has_ended {
            return Err(FmuStatus::Ended);
        }
        Ok(())
    }

    /// Sets a variable to a value that fits its kind.
    pub(super) fn set(&mut self, kind: Kind, reference: u32, value: f64) -> Called {
        let at = [reference];
        match kind {
            Kind::Real => self.call(
                |two| two.set_real(&at, &[value]),
                |three| three.set_float64(&at, &[value]),
            ),
            Kind::Integer => self.call(
                |two| two.set_integer(&at, &[value as i32]),
                |three| three.set_int32(&at, &[value as i32]),
            ),
            Kind::Boolean => self.call(
                |two| two.set_boolean(&at, &[i32::from(value != 0.0)]),
                |three| three.set_boolean(&at, &[value != 0.0]),
            ),
        }
    }

    pub(super) fn get(&mut self, kind: Kind, reference: u32) -> Called<f64> {
        let at = [reference];
        match kind {
            Kind::Real => {
                let mut value = [f64::NAN];
                let to = &mut value;
                match &*self.loaded {
                    Loaded::Two(_) => self.two(|two| two.get_real(&at, to))?,
                    Loaded::Three(_) => self.three(|three| three.get_float64(&at, to))?,
                }
                Ok(value[0])
            }
            Kind::Integer => {
                let mut value = [0_i32];
                let to = &mut value;
                match &*self.loaded {
                    Loaded::Two(_) => self.two(|two| two.get_integer(&at, to))?,
                    Loaded::Three(_) => self.three(|three| three.get_int32(&at, to))?,
                }
                Ok(value[0].into())
            }
            Kind::Boolean => match &*self.loaded {
                Loaded::Two(_) => {
                    let mut value = [0_i32];
                    self.two(|two| two.get_boolean(&at, &mut value))?;
                    Ok(f64::from(u8::from(value[0] != 0)))
                }
                Loaded::Three(_) => {
                    let mut value = [false];
                    self.three(|three| three.get_boolean(&at, &mut value))?;
                    Ok(f64::from(u8::from(value[0])))
                }
            },
        }
    }

    fn call<A, B>(
        &mut self,
        two: impl FnOnce(&mut fmi2::instance::InstanceCS) -> Result<A, Fmi2Error>,
        three: impl FnOnce(&mut fmi3::instance::InstanceCS) -> Result<B, Fmi3Error>,
    ) -> Called {
        match &*self.loaded {
            Loaded::Two(_) => self.two(two),
            Loaded::Three(_) => self.three(three),
        }
    }

    fn two<A>(
        &mut self,
        call: impl FnOnce(&mut fmi2::instance::InstanceCS) -> Result<A, Fmi2Error>,
    ) -> Called {
        let Loaded::Two(instance) = &mut *self.loaded else {
            return Err(FmuStatus::Unknown);
        };
        let called = valid(|| call(instance).map(drop).map_err(from_two));
        self.noted(called)
    }

    fn three<A>(
        &mut self,
        call: impl FnOnce(&mut fmi3::instance::InstanceCS) -> Result<A, Fmi3Error>,
    ) -> Called {
        let Loaded::Three(instance) = &mut *self.loaded else {
            return Err(FmuStatus::Unknown);
        };
        let called = valid(|| call(instance).map(drop).map_err(from_three));
        self.noted(called)
    }

    fn noted(&mut self, called: Called) -> Called {
        self.has_failed |= called.is_err();
        self.is_fatal |= called == Err(FmuStatus::Fatal);
        called
    }

    /// What the standard wants before an instance that is well is freed.
    pub(super) fn terminate(&mut self) {
        if !self.has_failed {
            let _ = self.call(FmiInstance::terminate, FmiInstance::terminate);
        }
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // After a fatal error no function may be called, also not the one that frees: it stays.
        if !self.is_fatal {
            // SAFETY: dropped here alone.
            unsafe { ManuallyDrop::drop(&mut self.loaded) };
        }
    }
}

/// The `fmi` crate panics on a status that the standard does not have, or not there.
fn valid(call: impl FnOnce() -> Called) -> Called {
    catch_unwind(AssertUnwindSafe(call)).unwrap_or(Err(FmuStatus::Unknown))
}

fn check_two(import: &Fmi2Import, identifier: &str) -> Result<(), FmuError> {
    let code = import.binding(identifier).map_err(library)?;
    demand!(code; fmi2GetVersion, fmi2Instantiate, fmi2FreeInstance, fmi2SetupExperiment, fmi2EnterInitializationMode,
        fmi2ExitInitializationMode, fmi2Terminate, fmi2GetReal, fmi2SetReal, fmi2GetInteger, fmi2SetInteger, fmi2GetBoolean,
        fmi2SetBoolean, fmi2DoStep);
    Ok(())
}

fn check_three(import: &Fmi3Import, identifier: &str) -> Result<(), FmuError> {
    let code = import.binding(identifier).map_err(library)?;
    demand!(code; fmi3GetVersion, fmi3InstantiateCoSimulation, fmi3FreeInstance, fmi3EnterInitializationMode,
        fmi3ExitInitializationMode, fmi3Terminate, fmi3GetFloat64, fmi3SetFloat64, fmi3GetInt32, fmi3SetInt32, fmi3GetBoolean,
        fmi3SetBoolean, fmi3DoStep);
    Ok(())
}
