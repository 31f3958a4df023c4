//! What happens when something goes wrong: the emergency functions, which run once, before anything
//! else; the degrees below an emergency and their functions; watchdogs, which detect missing
//! heartbeats; and budgets, which detect processes that take too long.

mod budget;
mod emergency;
mod entered;
mod guardian;
mod handle;
mod parent;
mod report;
mod state;
mod watchdog;

pub use budget::{BudgetKind, BudgetOverrun, BudgetReport, OnOverrun};
pub(crate) use budget::{Budgets, Ledger};
pub(crate) use emergency::{Emergency, EmergencyThread, LIMIT};
pub use emergency::{EmergencyTrigger, FunctionOutcome, FunctionReport, emergency};
pub use entered::SafeStateEntered;
pub(crate) use guardian::GuardianWatch;
pub use guardian::{Guardian, guard};
pub use handle::{Safety, SafetyFunction, safety};
pub(crate) use parent::ParentThread;
pub use report::SafetyReport;
pub use state::{Cause, Degree, ResetError, SafetyEvent, SafetyState};
pub use watchdog::{Bite, Watchdog, WatchdogProcess};
