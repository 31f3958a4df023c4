//! The code of an FMU: its functions, called through the bindings of the `fmi` crate.
//!
//! That crate's instances are not used. Their log callbacks read texts that may be null, and panic
//! on an unknown status: in a function called from C that ends the program. They let foreign code
//! write to a `bool`, and give an FMU of version 3 the path of its resources without the separator
//! that the standard has at its end.

use super::description::Description;
use super::error::{FmuError, FmuStatus};
use super::instance::Called;
use super::journal::{Journal, log_three, log_two};
use super::{Kind, Version};
use fmi::fmi2::binding as two;
use fmi::fmi2::import::Fmi2Import;
use fmi::fmi3::binding as three;
use fmi::fmi3::import::Fmi3Import;
use fmi::traits::FmiImport;
use std::ffi::{CStr, CString, c_char};
use std::path::MAIN_SEPARATOR;
use std::sync::Arc;
use tempfile::TempDir;

fn library(error: fmi::Error) -> FmuError {
    FmuError::Library {
        reason: error.to_string(),
    }
}

fn not_instantiated(journal: &Journal) -> FmuError {
    FmuError::Refused {
        call: "instantiate",
        status: FmuStatus::Error,
        said: journal.reason(),
    }
}

fn text(text: &str) -> Result<CString, FmuError> {
    CString::new(text).map_err(|_| FmuError::Description {
        reason: format!("`{}` has a zero in it", text.escape_debug()),
    })
}

/// Names the first function that is not there.
macro_rules! demand {
    ($code:expr; $($function:ident),+ $(,)?) => { $(
        if $code.$function.is_err() {
            return Err(FmuError::Library { reason: concat!("it has no function ", stringify!($function)).to_owned() });
        }
    )+ };
}

/// # Safety
///
/// `said` is null, or a string terminated by a zero.
unsafe fn check_version(description: Version, said: *const c_char) -> Result<(), FmuError> {
    if said.is_null() {
        return Err(FmuError::Library {
            reason: "it does not say its version".to_owned(),
        });
    }
    // SAFETY: it is not null, so it ends.
    let code = unsafe { CStr::from_ptr(said) }.to_string_lossy();
    let first = match description {
        Version::Two => '2',
        Version::Three => '3',
    };
    if code.starts_with(first) {
        return Ok(());
    }
    Err(FmuError::VersionOfCode {
        description,
        code: code.into_owned(),
    })
}

fn called_two(status: two::fmi2Status) -> Called {
    match status {
        two::fmi2Status_fmi2OK | two::fmi2Status_fmi2Warning => Ok(()),
        two::fmi2Status_fmi2Discard => Err(FmuStatus::Discard),
        two::fmi2Status_fmi2Error => Err(FmuStatus::Error),
        two::fmi2Status_fmi2Fatal => Err(FmuStatus::Fatal),
        _ => Err(FmuStatus::Unknown),
    }
}

fn called_three(status: three::fmi3Status) -> Called {
    match status {
        three::fmi3Status_fmi3OK | three::fmi3Status_fmi3Warning => Ok(()),
        three::fmi3Status_fmi3Discard => Err(FmuStatus::Discard),
        three::fmi3Status_fmi3Error => Err(FmuStatus::Error),
        three::fmi3Status_fmi3Fatal => Err(FmuStatus::Fatal),
        _ => Err(FmuStatus::Unknown),
    }
}

fn callbacks_two(journal: &Journal) -> two::fmi2CallbackFunctions {
    // calloc and free.
    let memory = fmi::fmi2::CallbackFunctions::default();
    two::fmi2CallbackFunctions {
        logger: Some(log_two),
        allocateMemory: memory.allocate_memory,
        freeMemory: memory.free_memory,
        stepFinished: None,
        componentEnvironment: (&raw const *journal).cast_mut().cast(),
    }
}

/// The place of its resources, as version 3 has it: a path with a separator at its end.
fn path_of_resources(import: &Fmi3Import) -> Result<CString, FmuError> {
    let path = import.resource_path();
    let unusable = |reason: String| FmuError::File {
        path: path.clone(),
        reason: format!("{reason}; set TMPDIR to another folder"),
    };
    let absolute = std::path::absolute(&path).map_err(|error| unusable(error.to_string()))?;
    let Some(absolute) = absolute.to_str() else {
        return Err(unusable("its path is no UTF-8".to_owned()));
    };
    text(&format!("{absolute}{MAIN_SEPARATOR}"))
}

/// An instance of version 2. Dropping it frees it. Its files must exist that long.
///
/// # Invariants
///
/// `demand!` has found each function that is called, under its name in the standard: so it is
/// there, with the type that the standard gives it. `component` was returned by the same code, and
/// is freed by the drop alone. One thread at a time uses it: all calls take `&mut self`. What the
/// code itself does is outside of these arguments: see the module `fmu`.
pub(super) struct Two {
    code: two::Fmi2Binding,
    component: two::fmi2Component,
    /// The code may keep where they are.
    _callbacks: Box<two::fmi2CallbackFunctions>,
    /// It logs there, also as it is freed.
    _journal: Arc<Journal>,
}

impl Two {
    pub(super) fn new(
        files: TempDir,
        description: &Description,
        name: &str,
        (journal, is_logging): (&Arc<Journal>, bool),
    ) -> Result<(Self, Fmi2Import), FmuError> {
        let import = Fmi2Import::new(files, &description.for_loader()).map_err(library)?;
        let code = import.binding(&description.identifier).map_err(library)?;
        demand!(code; fmi2GetVersion, fmi2Instantiate, fmi2FreeInstance, fmi2SetupExperiment, fmi2EnterInitializationMode,
            fmi2ExitInitializationMode, fmi2Terminate, fmi2GetReal, fmi2SetReal, fmi2GetInteger, fmi2SetInteger, fmi2GetBoolean,
            fmi2SetBoolean, fmi2DoStep);
        // SAFETY: the function was just found. It takes nothing, and by the standard it returns a
        // text of the code's, which ends with a zero, as `check_version` requires.
        unsafe { check_version(Version::Two, code.fmi2GetVersion())? };
        let (name, token) = (text(name)?, text(&description.token)?);
        let resources = text(&import.canonical_resource_path_string())?;
        let callbacks = Box::new(callbacks_two(journal));
        // SAFETY: the function was just found. The texts live until it returns; the callbacks and
        // the journal have their places as long as the component that is returned.
        let component = unsafe {
            code.fmi2Instantiate(
                name.as_ptr(),
                two::fmi2Type_fmi2CoSimulation,
                token.as_ptr(),
                resources.as_ptr(),
                &raw const *callbacks,
                0,
                is_logging.into(),
            )
        };
        if component.is_null() {
            return Err(not_instantiated(journal));
        }
        let loaded = Self {
            code,
            component,
            _callbacks: callbacks,
            _journal: journal.clone(),
        };
        Ok((loaded, import))
    }

    pub(super) fn enter_initialization(&mut self) -> Called {
        // SAFETY: by the invariants the function is there and the component lives; all else are
        // numbers.
        called_two(unsafe {
            self.code
                .fmi2SetupExperiment(self.component, 0, 0.0, 0.0, 0, 0.0)
        })?;
        // SAFETY: by the invariants the function is there and the component lives.
        called_two(unsafe { self.code.fmi2EnterInitializationMode(self.component) })
    }

    pub(super) fn exit_initialization(&mut self) -> Called {
        // SAFETY: by the invariants the function is there and the component lives.
        called_two(unsafe { self.code.fmi2ExitInitializationMode(self.component) })
    }

    pub(super) fn do_step(&mut self, at: f64, by: f64) -> Called {
        // SAFETY: by the invariants the function is there and the component lives; all else are
        // numbers.
        called_two(unsafe { self.code.fmi2DoStep(self.component, at, by, 1) })
    }

    pub(super) fn set(&mut self, kind: Kind, reference: u32, value: f64) -> Called {
        let (code, component) = (&self.code, self.component);
        let at = &raw const reference;
        // SAFETY: by the invariants the function is there and the component lives; one variable and
        // one value are stated, and one of each is there.
        called_two(unsafe {
            match kind {
                Kind::Real => code.fmi2SetReal(component, at, 1, &raw const value),
                Kind::Integer => code.fmi2SetInteger(component, at, 1, &(value as i32)),
                Kind::Boolean => code.fmi2SetBoolean(component, at, 1, &i32::from(value != 0.0)),
            }
        })
    }

    pub(super) fn get(&mut self, kind: Kind, reference: u32) -> Called<f64> {
        let (code, component) = (&self.code, self.component);
        let at = &raw const reference;
        let (mut real, mut integer) = (f64::NAN, 0_i32);
        // SAFETY: by the invariants the function is there and the component lives; one variable and
        // one value are stated, and one of each is there.
        called_two(unsafe {
            match kind {
                Kind::Real => code.fmi2GetReal(component, at, 1, &raw mut real),
                Kind::Integer => code.fmi2GetInteger(component, at, 1, &raw mut integer),
                Kind::Boolean => code.fmi2GetBoolean(component, at, 1, &raw mut integer),
            }
        })?;
        Ok(match kind {
            Kind::Real => real,
            Kind::Integer => integer.into(),
            Kind::Boolean => f64::from(u8::from(integer != 0)),
        })
    }

    pub(super) fn terminate(&mut self) -> Called {
        // SAFETY: by the invariants the function is there and the component lives.
        called_two(unsafe { self.code.fmi2Terminate(self.component) })
    }
}

impl Drop for Two {
    fn drop(&mut self) {
        // SAFETY: by the invariants the function is there and the component lives. Nothing uses it
        // after its drop.
        unsafe { self.code.fmi2FreeInstance(self.component) };
    }
}

/// An instance of version 3. Dropping it frees it. Its files must exist that long.
///
/// # Invariants
///
/// As those of [`Two`], of `instance`: the functions are there, it is freed by the drop alone, and
/// one thread at a time uses it.
pub(super) struct Three {
    code: three::Fmi3Binding,
    instance: three::fmi3Instance,
    /// It logs there, also as it is freed.
    _journal: Arc<Journal>,
}

impl Three {
    pub(super) fn new(
        files: TempDir,
        description: &Description,
        name: &str,
        (journal, is_logging): (&Arc<Journal>, bool),
    ) -> Result<(Self, Fmi3Import), FmuError> {
        let import = Fmi3Import::new(files, &description.for_loader()).map_err(library)?;
        let code = import.binding(&description.identifier).map_err(library)?;
        demand!(code; fmi3GetVersion, fmi3InstantiateCoSimulation, fmi3FreeInstance, fmi3EnterInitializationMode,
            fmi3ExitInitializationMode, fmi3Terminate, fmi3GetFloat64, fmi3SetFloat64, fmi3GetInt32, fmi3SetInt32, fmi3GetBoolean,
            fmi3SetBoolean, fmi3DoStep);
        // SAFETY: the function was just found. It takes nothing, and by the standard it returns a
        // text of the code's, which ends with a zero, as `check_version` requires.
        unsafe { check_version(Version::Three, code.fmi3GetVersion())? };
        let (name, token) = (text(name)?, text(&description.token)?);
        let resources = path_of_resources(&import)?;
        // SAFETY: the function was just found. The texts live until it returns; the list of
        // variables, which may be null, is empty. The journal, which is passed back alone, has its
        // place as long as the instance that is returned.
        let instance = unsafe {
            code.fmi3InstantiateCoSimulation(
                name.as_ptr(),
                token.as_ptr(),
                resources.as_ptr(),
                false,
                is_logging,
                false,
                false,
                std::ptr::null(),
                0,
                Arc::as_ptr(journal).cast_mut().cast(),
                Some(log_three),
                None,
            )
        };
        if instance.is_null() {
            return Err(not_instantiated(journal));
        }
        let loaded = Self {
            code,
            instance,
            _journal: journal.clone(),
        };
        Ok((loaded, import))
    }

    pub(super) fn enter_initialization(&mut self) -> Called {
        // SAFETY: by the invariants the function is there and the instance lives; all else are
        // numbers.
        called_three(unsafe {
            self.code
                .fmi3EnterInitializationMode(self.instance, false, 0.0, 0.0, false, 0.0)
        })
    }

    pub(super) fn exit_initialization(&mut self) -> Called {
        // SAFETY: by the invariants the function is there and the instance lives.
        called_three(unsafe { self.code.fmi3ExitInitializationMode(self.instance) })
    }

    pub(super) fn do_step(&mut self, at: f64, by: f64) -> Called {
        // Bytes, since a `bool` must be 0 or 1 and foreign code writes these: an event occurred,
        // the simulation should end, the step ended early.
        let [mut event, mut end, mut early] = [0_u8; 3];
        let mut reached = at;
        // SAFETY: by the invariants the function is there and the instance lives. The four results
        // live until it returns; a bool of C is a byte.
        called_three(unsafe {
            self.code.fmi3DoStep(
                self.instance,
                at,
                by,
                true,
                (&raw mut event).cast(),
                (&raw mut end).cast(),
                (&raw mut early).cast(),
                &raw mut reached,
            )
        })?;
        if end != 0 || early != 0 {
            return Err(FmuStatus::Ended);
        }
        Ok(())
    }

    pub(super) fn set(&mut self, kind: Kind, reference: u32, value: f64) -> Called {
        let (code, instance) = (&self.code, self.instance);
        let at = &raw const reference;
        // SAFETY: by the invariants the function is there and the instance lives; one variable and
        // one value are stated, and one of each is there.
        called_three(unsafe {
            match kind {
                Kind::Real => code.fmi3SetFloat64(instance, at, 1, &raw const value, 1),
                Kind::Integer => code.fmi3SetInt32(instance, at, 1, &(value as i32), 1),
                Kind::Boolean => code.fmi3SetBoolean(instance, at, 1, &(value != 0.0), 1),
            }
        })
    }

    pub(super) fn get(&mut self, kind: Kind, reference: u32) -> Called<f64> {
        let (code, instance) = (&self.code, self.instance);
        let at = &raw const reference;
        // A byte for a boolean, as in a step.
        let (mut real, mut integer, mut byte) = (f64::NAN, 0_i32, 0_u8);
        // SAFETY: by the invariants the function is there and the instance lives; one variable and
        // one value are stated, and one of each is there.
        called_three(unsafe {
            match kind {
                Kind::Real => code.fmi3GetFloat64(instance, at, 1, &raw mut real, 1),
                Kind::Integer => code.fmi3GetInt32(instance, at, 1, &raw mut integer, 1),
                Kind::Boolean => code.fmi3GetBoolean(instance, at, 1, (&raw mut byte).cast(), 1),
            }
        })?;
        Ok(match kind {
            Kind::Real => real,
            Kind::Integer => integer.into(),
            // The port's range refuses other values.
            Kind::Boolean => byte.into(),
        })
    }

    pub(super) fn terminate(&mut self) -> Called {
        // SAFETY: by the invariants the function is there and the instance lives.
        called_three(unsafe { self.code.fmi3Terminate(self.instance) })
    }
}

impl Drop for Three {
    fn drop(&mut self) {
        // SAFETY: by the invariants the function is there and the instance lives. Nothing uses it
        // after its drop.
        unsafe { self.code.fmi3FreeInstance(self.instance) };
    }
}
