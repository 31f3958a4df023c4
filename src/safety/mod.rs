//! What happens when something goes wrong: the emergency functions, run once, before anything else; how bad it is, and what is done before it is an
//! emergency; watchdogs, which find it out; and budgets, which find out who takes too long.

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
