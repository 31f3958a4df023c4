//! How long a process may take, as the program or the file states it.

use std::time::Duration;

/// What happens when a process overruns a budget. In any case it is counted, and the worst one
/// kept, in `ProcessReport::budgets`.
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
    /// its error is `Error::BudgetOverrun`. A process that ends by
    /// itself in that poll has ended.
    Poison,
    /// The emergency functions run, then the system ends: `End::Overrun`.
    ///
    /// Also if the poll or the cycle never ends: the thread that runs the system looks at the
    /// process after its budget, at most 10 ms later if it gets a core (not on a virtual clock). So
    /// for up to eight loops of a process at a time.
    Emergency,
}

/// The budgets of a process to be.
#[derive(Debug, Default)]
pub struct Budgets {
    /// Of a poll.
    pub poll: Option<Duration>,
    /// Of a cycle.
    pub cycle: Option<Duration>,
    /// What happens when it takes longer.
    pub on_overrun: Option<OnOverrun>,
    /// Whether what the kernel counts is read before each poll.
    pub accounted: bool,
}
