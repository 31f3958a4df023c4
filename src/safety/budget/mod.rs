//! Budgets: how long a process may keep the processor, or take for a cycle, and what happens when
//! it takes longer.

mod ledger;
mod under_way;

pub(crate) use ledger::{CycleWatch, Ledger};

use crate::error::SetupError;
use crate::time::{UsageSince, short};
use luna_platform::clock::Instant;
use std::fmt;
use std::time::Duration;

/// What happens when a process overruns a budget. In any case it is counted, and the worst one
/// kept, in [`ProcessReport::budgets`](crate::report::ProcessReport::budgets).
///
/// ```
/// use luna::prelude::*;
/// use luna::safety::OnOverrun;
/// use luna::Error;
/// use std::time::Duration;
///
/// let mut system = System::new("machine");
/// let main = system.executor("main").build()?;
/// main.process("hog")
///     .poll_budget(Duration::from_millis(1))
///     .on_overrun(OnOverrun::Poison)
///     .spawn(async {
///         let end = luna::now() + Duration::from_millis(2);
///         while luna::now() < end {}
///         luna::yield_now().await;
///         unreachable!("it is ended here");
///     })?;
/// let Err(Error::Process { name, source }) = system.run() else { panic!("it was ended for cause") };
/// assert_eq!(name, "hog");
/// assert!(matches!(*source, Error::BudgetOverrun { taken, .. } if taken >= Duration::from_millis(2)));
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum OnOverrun {
    /// Nothing more.
    #[default]
    Count,
    /// The thread that runs the system prints it on standard error, at most once a second for each
    /// process.
    Warn,
    /// The process is ended where it waits next, all its channel ends poison their channels, and
    /// its error is [`Error::BudgetOverrun`](crate::Error::BudgetOverrun). A process that ends by
    /// itself in that poll has ended.
    Poison,
    /// The emergency functions run, then the system ends: [`End::Overrun`](crate::End::Overrun).
    ///
    /// Also if the poll or the cycle never ends: the thread that runs the system looks at the
    /// process after its budget, at most 10 ms later if it gets a core (not on a virtual clock). So
    /// for up to eight loops of a process at a time.
    Emergency,
}

/// What a budget is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum BudgetKind {
    /// The time from when the process gets the processor until it awaits something that is not
    /// ready yet.
    Poll,
    /// The time from when a cycle of one of its loops begins until the loop asks for the next.
    Cycle,
}

impl fmt::Display for BudgetKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            BudgetKind::Poll => "poll",
            BudgetKind::Cycle => "cycle",
        })
    }
}

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

/// The budgets of a process to be.
#[derive(Debug, Default)]
pub(crate) struct Budgets {
    pub(crate) poll: Option<Duration>,
    pub(crate) cycle: Option<Duration>,
    pub(crate) on_overrun: Option<OnOverrun>,
    pub(crate) accounted: bool,
}

impl Budgets {
    /// The ledger that keeps them.
    pub(crate) fn ledger(self, process: &str) -> Result<Ledger, SetupError> {
        let kinds = [
            (BudgetKind::Poll, self.poll),
            (BudgetKind::Cycle, self.cycle),
        ];
        for (kind, budget) in kinds {
            if budget == Some(Duration::ZERO) {
                return Err(SetupError::ZeroBudget {
                    process: process.to_owned(),
                    kind,
                });
            }
        }
        if self.poll.is_none() && self.cycle.is_none() {
            return Err(SetupError::NoBudget {
                process: process.to_owned(),
            });
        }
        Ok(Ledger::new(self))
    }
}
