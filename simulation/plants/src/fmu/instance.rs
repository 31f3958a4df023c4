//! An instance of an FMU of either version, with one face.

use super::code::{Three, Two};
use super::description::Description;
use super::error::{FmuError, FmuStatus};
use super::journal::Journal;
use super::{Kind, Version};
use fmi::fmi2::import::Fmi2Import;
use fmi::fmi3::import::Fmi3Import;
use std::mem::ManuallyDrop;
use std::sync::Arc;
use tempfile::TempDir;

/// A call's result.
pub(super) type Called<T = ()> = Result<T, FmuStatus>;

/// A loaded and instantiated FMU.
pub(super) struct Instance {
    loaded: ManuallyDrop<Loaded>,
    is_fatal: bool,
    has_failed: bool,
    journal: Arc<Journal>,
    /// Its files, which it may read while it lives.
    _import: Import,
}

#[expect(dead_code, reason = "holds the unpacked files")]
enum Import {
    Two(Fmi2Import),
    Three(Fmi3Import),
}

enum Loaded {
    Two(Box<Two>),
    Three(Box<Three>),
}

// SAFETY: the standards bind an instance to no thread; they require that its functions are not
// called at the same time, and all calls take `&mut self`. The other fields are handles of the
// loaded library, and the journal, which any thread may use.
unsafe impl Send for Instance {}

/// Calls the function of that name on the loaded instance, and notes its status.
macro_rules! call {
    ($instance:expr, $function:ident $(, $argument:expr)*) => {{
        let called = match &mut *$instance.loaded {
            Loaded::Two(two) => two.$function($($argument),*),
            Loaded::Three(three) => three.$function($($argument),*),
        };
        $instance.has_failed |= called.is_err();
        $instance.is_fatal |= matches!(called, Err(FmuStatus::Fatal));
        called
    }};
}

impl Instance {
    /// Loads the code in `files` and creates an instance called `name`.
    pub(super) fn new(
        files: TempDir,
        description: &Description,
        name: &str,
        is_logging: bool,
    ) -> Result<Self, FmuError> {
        let journal = Arc::new(Journal::new(name));
        let log = (&journal, is_logging);
        // It is made into a text of C.
        let name = name.replace('\0', " ");
        let (loaded, import) = match description.version {
            Version::Two => {
                let (two, import) = Two::new(files, description, &name, log)?;
                (Loaded::Two(Box::new(two)), Import::Two(import))
            }
            Version::Three => {
                let (three, import) = Three::new(files, description, &name, log)?;
                (Loaded::Three(Box::new(three)), Import::Three(import))
            }
        };
        Ok(Self {
            loaded: ManuallyDrop::new(loaded),
            is_fatal: false,
            has_failed: false,
            journal,
            _import: import,
        })
    }

    /// An error of a call before it is set up.
    pub(super) fn refused(&self, call: &'static str, status: FmuStatus) -> FmuError {
        FmuError::Refused {
            call,
            status,
            said: self.journal.reason(),
        }
    }

    /// It is initialized.
    pub(super) fn set_up(&self) {
        self.journal.set_up();
    }

    pub(super) fn enter_initialization(&mut self) -> Called {
        call!(self, enter_initialization)
    }

    pub(super) fn exit_initialization(&mut self) -> Called {
        call!(self, exit_initialization)
    }

    /// From `at`, in seconds since the start, by `by`.
    pub(super) fn do_step(&mut self, at: f64, by: f64) -> Called {
        call!(self, do_step, at, by)
    }

    /// Sets a variable to a value that fits its kind.
    pub(super) fn set(&mut self, kind: Kind, reference: u32, value: f64) -> Called {
        call!(self, set, kind, reference, value)
    }

    pub(super) fn get(&mut self, kind: Kind, reference: u32) -> Called<f64> {
        call!(self, get, kind, reference)
    }

    /// Terminates an instance without failure before it is freed, as the standard requires.
    pub(super) fn terminate(&mut self) {
        if !self.has_failed {
            let _ = call!(self, terminate);
        }
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // After a fatal error no function may be called, not even the one that frees: the instance
        // is leaked.
        if !self.is_fatal {
            // SAFETY: dropped here alone.
            unsafe { ManuallyDrop::drop(&mut self.loaded) };
        }
    }
}
