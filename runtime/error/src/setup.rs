//! Errors of the set-up: bad input, and what the system refuses.

use luna_machine::shortfall::Shortfall;
use luna_platform::thread::AttributeError;
use std::fmt;
use std::time::Duration;
use thiserror::Error;

/// What was asked for cannot be set up. Each error has what failed, with which value, and what to
/// do.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SetupError {
    /// The machine has no such core.
    #[error("`{of}` asks for core {core}, which this machine has not; choose one of {available:?}")]
    NoSuchCore {
        /// For which executor or thread.
        of: String,
        /// The core that was asked for.
        core: usize,
        /// The cores there are.
        available: Vec<usize>,
    },
    /// A thread's policy, priority, stack or name makes no sense.
    #[error("{0}")]
    Attributes(AttributeError),
    /// The system file cannot be read.
    #[error("{path}: {message}")]
    DeploymentFile {
        /// Its name.
        path: String,
        /// Why.
        message: String,
    },
    /// Something is wrong in the system file, or does not fit the program or the machine.
    #[error("{0}")]
    Deployment(Box<crate::Problem>),
    /// A system file was named after an executor or a thread was made, or after another file.
    #[error(
        "the system file of `{system}` comes too late; call System::deployment_from once, before the first executor or thread"
    )]
    DeploymentTooLate {
        /// The system's name.
        system: String,
    },
    /// A process' priority is not one of the 32 levels.
    #[error("process `{process}` asks for priority {level}; choose 0 (lowest) to 31")]
    Level {
        /// The process' name.
        process: String,
        /// The priority that was asked for.
        level: u8,
    },
    /// A signal cannot be registered.
    #[error("{0}")]
    Signal(crate::RegisterError),
    /// The recording that was asked for cannot begin.
    #[cfg(feature = "logger")]
    #[error("{0}")]
    Logging(luna_logger::StartError),
    /// A parameter cannot be declared.
    #[error("{0}")]
    Parameter(luna_config::parameters::DeclareError),
    /// The values of parameters cannot be taken.
    #[error("{0}")]
    Parameters(luna_config::parameters::SetError),
    /// Two of a kind have one name.
    #[error("there is {kind} `{name}` already; give each {kind} a name of its own")]
    DuplicateName {
        /// Executor, process, or loop.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A process' budget is zero.
    #[error("process `{process}` has a {kind} budget of 0; give it at least 1 ns, or none")]
    ZeroBudget {
        /// The process' name.
        process: String,
        /// Which budget.
        kind: BudgetKind,
    },
    /// The reaction to an overrun was set, but no budget.
    #[error(
        "process `{process}` is to be judged by its budgets, and has none; call ProcessBuilder::poll_budget or cycle_budget"
    )]
    NoBudget {
        /// The process' name.
        process: String,
    },
    /// A loop's period is zero.
    #[error("loop `{name}` has a period of 0; give it at least 1 ns")]
    ZeroPeriod {
        /// The loop's name.
        name: String,
    },
    /// A loop's period is longer than the clock reaches.
    #[error("loop `{name}` has a period of {period:?}; the clock reaches 292 years")]
    PeriodTooLong {
        /// The loop's name.
        name: String,
        /// The period.
        period: Duration,
    },
    /// A loop's phase is not within its period.
    #[error(
        "loop `{name}` has a phase of {phase:?} and a period of {period:?}; choose a phase below the period"
    )]
    PhaseTooLong {
        /// The loop's name.
        name: String,
        /// The phase.
        phase: Duration,
        /// The period.
        period: Duration,
    },
    /// A loop's guard spin is longer than a sixteenth of its period.
    #[error(
        "loop `{name}` asks for a guard spin of {guard:?}; choose at most {longest:?}, a sixteenth of its period"
    )]
    GuardTooLong {
        /// The loop's name.
        name: String,
        /// The guard that was asked for.
        guard: Duration,
        /// The longest it may have.
        longest: Duration,
    },
    /// A loop's name does not fit in the room that is reserved before the start.
    #[error("the loop name `{name}` has {} bytes; use at most {most}", .name.len())]
    NameTooLong {
        /// The name.
        name: String,
        /// The most bytes it may have.
        most: usize,
    },
    /// There are more loops than the system reserved room for before the start: 16, or as many as
    /// `System::max_loops` set. Loops that have ended count.
    #[error(
        "loop `{name}` is one more than the {most} for whose statistics the system has room; call \
                 System::max_loops with a greater number before the start"
    )]
    TooManyLoops {
        /// The loop that came last.
        name: String,
        /// How many there is room for.
        most: usize,
    },
    /// There are more timer callbacks than room was reserved for before the start.
    #[error(
        "timer callback `{name}` is one more than the {most} for which there is room; call System::max_timers before the start, or drop \
                 one that is no longer used"
    )]
    TooManyTimers {
        /// The callback that came last.
        name: String,
        /// How many there is room for.
        most: usize,
    },
    /// A callback of the timer manager in a system on a virtual clock, where there is no thread
    /// that could call it.
    #[error(
        "timer callback `{name}` needs the machine's clock, and the system is on a virtual one; let a process with a loop do it"
    )]
    CallbackOnVirtualClock {
        /// The callback's name.
        name: String,
    },
    /// A timer manager was asked for where there is none.
    #[error(
        "system `{system}` has no timer manager; call System::timers with Timers::Manager first"
    )]
    NoTimerManager {
        /// The system's name.
        system: String,
    },
    /// A loop was made outside of any process.
    #[error(
        "loop `{name}` was made outside of any process; call luna::periodic in a process or luna::run"
    )]
    NoProcess {
        /// The loop's name.
        name: String,
    },
    /// The system has been run already.
    #[error("system `{system}` has been run already; build another one to run again")]
    AlreadyRun {
        /// The system's name.
        system: String,
    },
    /// A process was to be started at once, and the system does not run yet.
    #[error("process `{process}` cannot be started, since its system does not run yet; spawn it")]
    NotRunning {
        /// What was to be started.
        process: String,
    },
    /// The system has ended, or is about to.
    #[error("system `{system}` ends or has ended, so process `{process}` cannot be started")]
    Ended {
        /// The system's name.
        system: String,
        /// What was to be started.
        process: String,
    },
    /// A stand-in was named for a process that is there already, or for a system that runs.
    #[error(
        "the stand-in for process `{process}` comes too late; call System::stand_in before the network is built"
    )]
    StandInTooLate {
        /// The process' name.
        process: String,
    },
    /// A stand-in takes other channel ends than the process has.
    #[error("the stand-in for process `{process}` takes `{takes}`, but the process has `{has}`")]
    StandInDoesNotFit {
        /// The process' name.
        process: String,
        /// The type of the process' ends.
        has: &'static str,
        /// The type that the stand-in takes.
        takes: &'static str,
    },
    /// A process that is to be replaced was spawned without its ends.
    #[error(
        "process `{process}` has a stand-in, but is spawned without its channel ends; declare it by ProcessBuilder::replaceable"
    )]
    NotReplaceable {
        /// The process' name.
        process: String,
    },
    /// A stand-in was named for a process that is not declared.
    #[error("there is a stand-in for process `{process}`, but {}", others(.known))]
    NobodyToReplace {
        /// The name.
        process: String,
        /// The processes that can be replaced.
        known: Vec<String>,
    },
    /// An emergency function was registered when the others had run, or the system had ended.
    #[error(
        "emergency function `{name}` comes too late: the others have run, or the system has ended, so it would never be run"
    )]
    EmergencyOver {
        /// The function's name.
        name: String,
    },
    /// There are more emergency functions than room is reserved for.
    #[error(
        "emergency function `{name}` is one too many: there is room for {most}; let one function do what several did"
    )]
    TooManyFunctions {
        /// The function that came last.
        name: String,
        /// How many there is room for.
        most: usize,
    },
    /// The guardian could not be started, or does not answer.
    #[error(
        "the guardian `{command}` could not be started: {message}; it must write a line on its standard output when it is ready"
    )]
    Guardian {
        /// What was to be run.
        command: String,
        /// What happened.
        message: String,
    },
    /// A system, or `luna::run`, was started inside a process.
    #[error(
        "a system or luna::run was started inside a process, whose thread it would stop: await the work instead, or \
                 start it from a plain thread"
    )]
    Nested,
    /// The system was to be strict, and this was refused.
    #[error("strict: {of}: {shortfall}")]
    Refused {
        /// For which executor or thread, or for the whole system.
        of: String,
        /// What was refused, why, and how to get it.
        shortfall: Shortfall,
    },
    /// An emergency came, such as a signal, while the start waited for a file that did not answer:
    /// a FIFO without a partner, or a file of a network that is gone. The emergency functions have
    /// run.
    #[error(
        "the start was ended by {cause} while it waited to {what}, which did not answer; see that it does, or name another"
    )]
    StartInterrupted {
        /// What was to be done, with the file's name.
        what: String,
        /// The emergency's cause.
        cause: String,
    },
    /// A thread could not be started.
    #[error("{message}")]
    Thread {
        /// The system's error.
        message: String,
    },
    /// Memory or signals could not be prepared.
    #[error("{message}")]
    System {
        /// What failed, and what to do.
        message: String,
    },
}

/// The processes that a stand-in could have been named for.
fn others(known: &[String]) -> String {
    match known {
        [] => "no process can be replaced; declare it by ProcessBuilder::replaceable".to_owned(),
        _ => format!("no such process that can be replaced; there are {known:?}"),
    }
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
