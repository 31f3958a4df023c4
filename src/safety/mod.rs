//! What happens when something goes wrong: the emergency functions, which run once, before anything
//! else; the degrees below an emergency and their functions; watchdogs, which detect missing
//! heartbeats; and budgets, which detect processes that take too long. `docs/safety.md` has more.
//!
//! ```
//! use luna::prelude::*;
//! use luna::report::FunctionOutcome;
//! use luna::safety::{self, Degree};
//!
//! let mut system = System::new("arm");
//! system.on_emergency("brakes", || { /* engage them */ });
//! let main = system.executor("main").build()?;
//! main.process("controller").spawn(async {
//!     let safety = safety::current().expect("it is a process of a system");
//!     safety.warn(luna::Error::other("the motor is hot"));
//!     assert_eq!(safety.degree(), Degree::Warning);
//!     Err(luna::emergency(luna::Error::other("the motor is too hot")))
//! })?;
//! system.run().unwrap_err();
//! let safety = system.report().expect("it has run").safety;
//! assert_eq!(safety.functions[0].outcome, FunctionOutcome::Ran);
//! # Ok::<(), luna::Error>(())
//! ```

pub(crate) mod budget;
pub(crate) mod emergency;
mod entered;
mod guardian;
mod handle;
pub(crate) mod report;
mod state;
mod watchdog;

pub use budget::{BudgetKind, BudgetOverrun, OnOverrun};
pub(crate) use budget::{Budgets, CycleWatch, Ledger, ledger};
pub use emergency::emergency;
pub(crate) use emergency::{Emergency, EmergencyThread, LIMIT};
pub use entered::SafeStateEntered;
pub use guardian::{Guardian, guard};
pub(crate) use guardian::{GuardianWatch, ParentThread};
pub use handle::{Safety, SafetyFunction, current};
pub use luna_platform::panics::catch as catch_panic;
pub use state::{Cause, Degree, ResetError, SafetyEvent, SafetyState};
pub use watchdog::{Feeder, Watchdog, WatchdogExpiry, WatchdogProcess};

#[doc(hidden)]
#[deprecated(since = "0.1.0", note = "use `luna::safety::Safety`")]
pub type EmergencyTrigger = Safety;
