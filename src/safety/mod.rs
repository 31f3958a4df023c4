//! What happens when something goes wrong: the emergency functions, run once, before anything else; watchdogs, which find it out; and
//! budgets, which find out who takes too long.

mod budget;
mod emergency;
mod watchdog;

pub use budget::{BudgetKind, BudgetOverrun, BudgetReport, OnOverrun};
pub(crate) use budget::{Budgets, Ledger};
pub use emergency::emergency;
pub(crate) use emergency::{Emergency, EmergencyThread, Function};
pub use watchdog::{Bite, Watchdog, WatchdogProcess};
