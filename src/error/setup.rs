//! Errors of the set-up: bad input, and what the system refuses.

use crate::safety::BudgetKind;
use luna_platform::shortfall::Shortfall;
use luna_platform::thread::AttributeError;
use std::fmt;
use std::time::Duration;

/// What was asked for cannot be set up. Each error has what failed, with which value, and what to
/// do.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum SetupError {
    /// The machine has no such core.
    NoSuchCore {
        /// For which executor or thread.
        of: String,
        /// The core that was asked for.
        core: usize,
        /// The cores there are.
        available: Vec<usize>,
    },
    /// A thread's policy, priority, stack or name makes no sense.
    Attributes(AttributeError),
    /// A process' priority is not one of the 32 levels.
    Level {
        /// The process' name.
        process: String,
        /// The priority that was asked for.
        level: u8,
    },
    /// A signal cannot be registered.
    Signal(crate::log::RegisterError),
    /// The recording that was asked for cannot begin.
    #[cfg(feature = "logger")]
    Logging(crate::log::StartError),
    /// A parameter cannot be declared.
    Parameter(crate::parameters::DeclareError),
    /// The values of parameters cannot be taken.
    Parameters(crate::parameters::SetError),
    /// Two of a kind have one name.
    DuplicateName {
        /// Executor, process, or loop.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A process' budget is zero.
    ZeroBudget {
        /// The process' name.
        process: String,
        /// Which budget.
        kind: BudgetKind,
    },
    /// The reaction to an overrun was set, but no budget.
    NoBudget {
        /// The process' name.
        process: String,
    },
    /// A loop's period is zero.
    ZeroPeriod {
        /// The loop's name.
        name: String,
    },
    /// A loop's period is longer than the clock reaches.
    PeriodTooLong {
        /// The loop's name.
        name: String,
        /// The period.
        period: Duration,
    },
    /// A loop's phase is not within its period.
    PhaseTooLong {
        /// The loop's name.
        name: String,
        /// The phase.
        phase: Duration,
        /// The period.
        period: Duration,
    },
    /// A loop's guard spin is longer than a sixteenth of its period.
    GuardTooLong {
        /// The loop's name.
        name: String,
        /// The guard that was asked for.
        guard: Duration,
        /// The longest it may have.
        longest: Duration,
    },
    /// A loop's name does not fit in the room that is reserved before the start.
    NameTooLong {
        /// The name.
        name: String,
        /// The most bytes it may have.
        most: usize,
    },
    /// There are more loops than the system reserved room for before the start: 16, or as many as
    /// [`System::max_loops`](crate::System::max_loops) set. Loops that have ended count.
    TooManyLoops {
        /// The loop that came last.
        name: String,
        /// How many there is room for.
        most: usize,
    },
    /// There are more timer callbacks than room was reserved for before the start.
    TooManyTimers {
        /// The callback that came last.
        name: String,
        /// How many there is room for.
        most: usize,
    },
    /// A callback of the timer manager in a system on a virtual clock, where there is no thread
    /// that could call it.
    CallbackOnVirtualClock {
        /// The callback's name.
        name: String,
    },
    /// A timer manager was asked for where there is none.
    NoTimerManager {
        /// The system's name.
        system: String,
    },
    /// A loop was made outside of any process.
    NoProcess {
        /// The loop's name.
        name: String,
    },
    /// The system has been run already.
    AlreadyRun {
        /// The system's name.
        system: String,
    },
    /// A process was to be started at once, and the system does not run yet.
    NotRunning {
        /// What was to be started.
        process: String,
    },
    /// The system has ended, or is about to.
    Ended {
        /// The system's name.
        system: String,
        /// What was to be started.
        process: String,
    },
    /// A stand-in was named for a process that is there already, or for a system that runs.
    StandInTooLate {
        /// The process' name.
        process: String,
    },
    /// A stand-in takes other channel ends than the process has.
    StandInDoesNotFit {
        /// The process' name.
        process: String,
        /// The type of the process' ends.
        has: &'static str,
        /// The type that the stand-in takes.
        takes: &'static str,
    },
    /// A process that is to be replaced was spawned without its ends.
    NotReplaceable {
        /// The process' name.
        process: String,
    },
    /// A stand-in was named for a process that is not declared.
    NobodyToReplace {
        /// The name.
        process: String,
        /// The processes that can be replaced.
        known: Vec<String>,
    },
    /// An emergency function was registered when the others had run, or the system had ended.
    EmergencyOver {
        /// The function's name.
        name: String,
    },
    /// There are more emergency functions than room is reserved for.
    TooManyFunctions {
        /// The function that came last.
        name: String,
        /// How many there is room for.
        most: usize,
    },
    /// The guardian could not be started, or does not answer.
    Guardian {
        /// What was to be run.
        command: String,
        /// What happened.
        message: String,
    },
    /// A system, or `luna::run`, was started inside a process.
    Nested,
    /// The system was to be strict, and this was refused.
    Refused {
        /// For which executor or thread, or for the whole system.
        of: String,
        /// What was refused, why, and how to get it.
        shortfall: Shortfall,
    },
    /// A thread could not be started.
    Thread {
        /// The system's error.
        message: String,
    },
    /// Memory or signals could not be prepared.
    System {
        /// What failed, and what to do.
        message: String,
    },
}

impl fmt::Display for SetupError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SetupError::NoSuchCore { of, core, available } => {
                write!(f, "`{of}` asks for core {core}, which this machine has not; choose one of {available:?}")
            }
            SetupError::Attributes(error) => error.fmt(f),
            SetupError::Parameter(error) => error.fmt(f),
            SetupError::Parameters(error) => error.fmt(f),
            SetupError::Signal(error) => error.fmt(f),
            #[cfg(feature = "logger")]
            SetupError::Logging(error) => error.fmt(f),
            SetupError::Level { process, level } => {
                write!(f, "process `{process}` asks for priority {level}; choose 0 (lowest) to 31")
            }
            SetupError::DuplicateName { kind, name } => {
                write!(f, "there is {kind} `{name}` already; give each {kind} a name of its own")
            }
            SetupError::ZeroBudget { process, kind } => {
                write!(f, "process `{process}` has a {kind} budget of 0; give it at least 1 ns, or none")
            }
            SetupError::NoBudget { process } => write!(
                f,
                "process `{process}` is to be judged by its budgets, and has none; call ProcessBuilder::poll_budget or cycle_budget"
            ),
            SetupError::ZeroPeriod { name } => write!(f, "loop `{name}` has a period of 0; give it at least 1 ns"),
            SetupError::PeriodTooLong { name, period } => {
                write!(f, "loop `{name}` has a period of {period:?}; the clock reaches 292 years")
            }
            SetupError::PhaseTooLong { name, phase, period } => write!(
                f,
                "loop `{name}` has a phase of {phase:?} and a period of {period:?}; choose a phase below the period"
            ),
            SetupError::GuardTooLong { name, guard, longest } => write!(
                f,
                "loop `{name}` asks for a guard spin of {guard:?}; choose at most {longest:?}, a sixteenth of its period"
            ),
            SetupError::NameTooLong { name, most } => {
                write!(f, "the loop name `{name}` has {} bytes; use at most {most}", name.len())
            }
            SetupError::TooManyLoops { name, most } => write!(
                f,
                "loop `{name}` is one more than the {most} for whose statistics the system has room; call \
                 System::max_loops with a greater number before the start"
            ),
            SetupError::TooManyTimers { name, most } => write!(
                f,
                "timer callback `{name}` is one more than the {most} for which there is room; call System::max_timers before the start, or drop \
                 one that is no longer used"
            ),
            SetupError::CallbackOnVirtualClock { name } => write!(
                f,
                "timer callback `{name}` needs the machine's clock, and the system is on a virtual one; let a process with a loop do it"
            ),
            SetupError::NoTimerManager { system } => write!(
                f,
                "system `{system}` has no timer manager; call System::timers with Timers::Manager first"
            ),
            SetupError::NoProcess { name } => {
                write!(f, "loop `{name}` was made outside of any process; call luna::periodic in a process or luna::run")
            }
            SetupError::AlreadyRun { system } => {
                write!(f, "system `{system}` has been run already; build another one to run again")
            }
            SetupError::NotRunning { process } => {
                write!(f, "process `{process}` cannot be started, since its system does not run yet; spawn it")
            }
            SetupError::Ended { system, process } => {
                write!(f, "system `{system}` ends or has ended, so process `{process}` cannot be started")
            }
            SetupError::StandInTooLate { process } => write!(
                f,
                "the stand-in for process `{process}` comes too late; call System::stand_in before the network is built"
            ),
            SetupError::StandInDoesNotFit { process, has, takes } => write!(
                f,
                "the stand-in for process `{process}` takes `{takes}`, but the process has `{has}`"
            ),
            SetupError::NotReplaceable { process } => write!(
                f,
                "process `{process}` has a stand-in, but is spawned without its channel ends; declare it by ProcessBuilder::replaceable"
            ),
            SetupError::NobodyToReplace { process, known } if known.is_empty() => write!(
                f,
                "there is a stand-in for process `{process}`, but no process can be replaced; declare it by ProcessBuilder::replaceable"
            ),
            SetupError::NobodyToReplace { process, known } => write!(
                f,
                "there is a stand-in for process `{process}`, but no such process that can be replaced; there are {known:?}"
            ),
            SetupError::EmergencyOver { name } => write!(
                f,
                "emergency function `{name}` comes too late: the others have run, or the system has ended, so it would never be run"
            ),
            SetupError::TooManyFunctions { name, most } => write!(
                f,
                "emergency function `{name}` is one too many: there is room for {most}; let one function do what several did"
            ),
            SetupError::Guardian { command, message } => write!(
                f,
                "the guardian `{command}` could not be started: {message}; it must write a line on its standard output when it is ready"
            ),
            SetupError::Nested => f.write_str(
                "a system or luna::run was started inside a process, whose thread it would stop: await the work instead, or \
                 start it from a plain thread",
            ),
            SetupError::Refused { of, shortfall } => write!(f, "strict: {of}: {shortfall}"),
            SetupError::Thread { message } | SetupError::System { message } => f.write_str(message),
        }
    }
}

impl std::error::Error for SetupError {}
