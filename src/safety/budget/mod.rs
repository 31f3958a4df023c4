//! Budgets: how long a process may keep the processor, or take for a cycle, and what happens when
//! it takes longer.

mod ledger;

pub(crate) use ledger::{CycleWatch, Ledger};
pub(crate) use luna_config::deployment::Budgets;
pub use luna_config::deployment::OnOverrun;
pub use luna_error::BudgetKind;

use crate::error::SetupError;
use crate::time::{UsageSince, short};
use luna_platform::clock::Instant;
use std::fmt;
use std::time::Duration;

/// How a process kept a budget.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct BudgetReport {
    /// What the budget was for.
    pub kind: BudgetKind,
    /// The budget.
    pub budget: Duration,
    /// What was to happen.
    pub on_overrun: OnOverrun,
    /// How often it took longer.
    pub overruns: u64,
    /// The longest of these.
    pub worst: Option<BudgetOverrun>,
}

/// A poll or cycle that took longer than its budget.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct BudgetOverrun {
    /// When it began.
    pub at: Instant,
    /// How long it took, by the clock on the wall.
    pub taken: Duration,
    /// The loop that the cycle belongs to.
    pub of_loop: Option<String>,
    /// What the kernel counted of the thread: whether it was on the processor all that time.
    pub usage: Option<UsageSince>,
}

impl BudgetOverrun {
    fn new(at: Instant, taken: Duration, usage: Option<UsageSince>) -> Self {
        Self {
            at,
            taken,
            of_loop: None,
            usage,
        }
    }
}

impl fmt::Display for BudgetReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let times = match self.overruns {
            1 => "once".to_owned(),
            times => format!("{times} times"),
        };
        write!(
            f,
            "{} budget of {} overrun {times}",
            self.kind,
            short(self.budget)
        )?;
        if let Some(worst) = &self.worst {
            write!(f, ", by a {} of {}", self.kind, short(worst.taken))?;
            if let Some(name) = &worst.of_loop {
                write!(f, " of loop `{name}`")?;
            }
            if let Some(usage) = &worst.usage {
                write!(f, "; {usage}")?;
            }
        }
        Ok(())
    }
}

/// The ledger that keeps the budgets of a process.
pub(crate) fn ledger(budgets: Budgets, process: &str) -> Result<Ledger, SetupError> {
    let kinds = [
        (BudgetKind::Poll, budgets.poll),
        (BudgetKind::Cycle, budgets.cycle),
    ];
    for (kind, budget) in kinds {
        if budget == Some(Duration::ZERO) {
            return Err(SetupError::ZeroBudget {
                process: process.to_owned(),
                kind,
            });
        }
    }
    if budgets.poll.is_none() && budgets.cycle.is_none() {
        return Err(SetupError::NoBudget {
            process: process.to_owned(),
        });
    }
    Ok(Ledger::new(budgets))
}
