//! The attributes that a thread is to have, and those that it obtained.

use super::policy::{Policy, PolicyError};
use super::refusal::{Refusal, SpinRefusal};
use crate::spin;
use std::time::Duration;

/// What happens when the system does not give what was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Mode {
    /// Refuse: the start fails with the refusal as its error.
    Strict,
    /// Go on without, and report the refusal.
    #[default]
    BestEffort,
}

/// The stack of a thread that asks for nothing else: 2 MiB, as threads of the standard library
/// have.
///
/// So code that runs on a thread of the standard library runs here too: an unoptimized build moves
/// a value several times on the way through futures and channels, and takes stack for each move.
/// Every page of it is touched and, once memory is locked, stays in memory: 2 MiB a thread, which a
/// machine that is to keep deadlines has; more by default would cost one with some tens of threads,
/// or a limit of locked memory (8 MiB on many systems, unless it is lifted), too much.
pub const DEFAULT_STACK_SIZE: usize = 2 << 20;

/// The smallest stack that can be asked for: 128 KiB.
///
/// The C library takes some of it for thread-local data (16 KiB is its own minimum), the standard
/// library's start and end of a thread and a panic's message take some 20 KiB more, and unoptimized
/// builds several times that.
pub const MINIMUM_STACK_SIZE: usize = 128 << 10;

/// The largest stack that can be asked for: 1 GiB. All of it is touched at the thread's start.
pub const MAXIMUM_STACK_SIZE: usize = 1 << 30;

/// The attributes of a thread that is to be made: a builder.
///
/// ```
/// use luna_platform::thread::{Attributes, Mode, Policy};
///
/// let attributes = Attributes::new("control").core(0).policy(Policy::fifo(80)).mode(Mode::BestEffort);
/// assert!(attributes.validate().is_ok());
/// assert!(attributes.stack_size(100).validate().is_err());
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
#[must_use = "attributes do nothing until a thread is made with them"]
pub struct Attributes {
    pub(crate) name: String,
    pub(crate) core: Option<usize>,
    pub(crate) policy: Policy,
    pub(crate) stack_size: usize,
    pub(crate) mode: Mode,
    framework: bool,
    spin: Duration,
    spin_refused: Option<SpinRefusal>,
}

impl Attributes {
    /// A thread called `name`, on any core, without a real-time policy, best effort, with
    /// [`DEFAULT_STACK_SIZE`].
    ///
    /// The operating system shows the first 15 bytes of the name, cut between characters.
    pub fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            core: None,
            policy: Policy::Other,
            stack_size: DEFAULT_STACK_SIZE,
            mode: Mode::default(),
            framework: false,
            spin: Duration::ZERO,
            spin_refused: None,
        }
    }

    /// A thread of the framework's own: as [`new`](Self::new), but priorities 98 and 99 are open to
    /// it.
    ///
    /// For the timer manager, the emergency manager and tools that measure beside them. A user's
    /// thread is made with `new`.
    pub fn framework(name: impl Into<String>, policy: Policy) -> Self {
        Self {
            policy,
            framework: true,
            ..Self::new(name)
        }
    }

    /// Runs on `core` alone, by the system's number of it.
    pub fn core(mut self, core: usize) -> Self {
        self.core = Some(core);
        self
    }

    /// Runs on any core.
    pub fn any_core(mut self) -> Self {
        self.core = None;
        self
    }

    /// Runs under `policy`.
    pub fn policy(mut self, policy: Policy) -> Self {
        self.policy = policy;
        self
    }

    /// The thread's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The policy that was asked for.
    pub fn asked_policy(&self) -> Policy {
        self.policy
    }

    /// The core that was asked for.
    pub fn asked_core(&self) -> Option<usize> {
        self.core
    }

    /// Has a stack of `bytes`, rounded up to whole pages: [`MINIMUM_STACK_SIZE`] to
    /// [`MAXIMUM_STACK_SIZE`].
    pub fn stack_size(mut self, bytes: usize) -> Self {
        self.stack_size = bytes;
        self
    }

    /// The stack that was asked for, in bytes.
    pub fn asked_stack(&self) -> usize {
        self.stack_size
    }

    /// What to do when the system refuses the policy or the core.
    pub fn mode(mut self, mode: Mode) -> Self {
        self.mode = mode;
        self
    }

    /// Spins for work for `time` before each sleep, at most [`spin::LONGEST`]; not at all if not
    /// stated.
    ///
    /// A wake across cores then takes some hundred nanoseconds instead of microseconds, and the
    /// thread burns its core meanwhile: it needs a core to itself. The code that makes the thread
    /// must know whether it has one ([`refuse_spin`](Self::refuse_spin)); a thread that is not
    /// pinned has none. It is for threads that run processes, and does nothing on others.
    pub fn spin_before_sleep(mut self, time: Duration) -> Self {
        self.spin = time;
        self
    }

    /// The requested time to spin for work before each sleep.
    pub fn asked_spin(&self) -> Duration {
        self.spin
    }

    /// Refuses the requested spinning before a sleep: `why` becomes a refusal. Does nothing if
    /// there was no request.
    pub fn refuse_spin(mut self, why: SpinRefusal) -> Self {
        self.spin_refused = Some(why);
        self
    }

    /// Decides whether a thread that has obtained the rest may spin before it sleeps.
    pub(crate) fn settle_spin(&self, obtained: &mut Obtained) -> Result<(), Refusal> {
        if self.spin.is_zero() {
            return Ok(());
        }
        let unpinned = (obtained.core.is_none()).then_some(SpinRefusal::NotPinned);
        match self.spin_refused.clone().or(unpinned) {
            Some(why) => {
                let asked = self.spin;
                obtained.refused(self.mode, Refusal::Spin { asked, why })
            }
            None => {
                obtained.spin_before_sleep = self.spin;
                Ok(())
            }
        }
    }

    /// Whether the attributes make sense on any machine. Making a thread checks this too.
    ///
    /// # Errors
    ///
    /// A priority out of range, a deadline policy beside a core, a stack too small or too large, a
    /// name with a zero byte in it, or a time to look for work before a sleep that is too long.
    pub fn validate(&self) -> Result<(), AttributeError> {
        let checked = if self.framework {
            self.policy.validate_framework()
        } else {
            self.policy.validate_user()
        };
        let name = self.name.clone();
        if let Err(error) = checked {
            return Err(AttributeError::Policy { name, error });
        }
        if let Some(core) = self.core
            && self.policy.is_deadline()
        {
            return Err(AttributeError::PinnedDeadline { name, core });
        }
        let asked = self.stack_size;
        if asked < MINIMUM_STACK_SIZE {
            return Err(AttributeError::StackTooSmall { name, asked });
        }
        if asked > MAXIMUM_STACK_SIZE {
            return Err(AttributeError::StackTooLarge { name, asked });
        }
        let asked = self.spin;
        if asked > spin::LONGEST {
            return Err(AttributeError::SpinTooLong { name, asked });
        }
        if name.contains('\0') {
            return Err(AttributeError::ZeroInName { name });
        }
        Ok(())
    }

    /// As [`validate`](Self::validate), for a thread that several processes share.
    ///
    /// # Errors
    ///
    /// As for `validate`, and a deadline policy: its budget would stop all of them at once.
    pub fn validate_shared(&self) -> Result<(), AttributeError> {
        self.validate()?;
        if self.policy.is_deadline() {
            let name = self.name.clone();
            return Err(AttributeError::SharedDeadline { name });
        }
        Ok(())
    }
}

/// What is wrong with a thread's attributes, whatever the machine.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum AttributeError {
    /// The policy's priority is out of range.
    #[error("thread `{name}`: {error}")]
    Policy {
        /// The thread's name.
        name: String,
        /// What is wrong with it.
        #[source]
        error: PolicyError,
    },
    /// A deadline policy and a core, which the kernel does not give together.
    #[error(
        "thread `{name}` asks for SCHED_DEADLINE and for core {core}, and the kernel refuses that \
         policy to pinned threads; leave the core out, or choose SCHED_FIFO"
    )]
    PinnedDeadline {
        /// The thread's name.
        name: String,
        /// The core that was asked for.
        core: usize,
    },
    /// A deadline policy for a thread that several processes share.
    #[error(
        "executor `{name}` asks for SCHED_DEADLINE, whose budget would stop all its processes at \
         once; run the loop on an OS thread of its own, or choose SCHED_FIFO"
    )]
    SharedDeadline {
        /// The thread's name.
        name: String,
    },
    /// The stack is smaller than [`MINIMUM_STACK_SIZE`].
    #[error(
        "thread `{name}`: a stack of {asked} bytes is too small; ask for at least {MINIMUM_STACK_SIZE}"
    )]
    StackTooSmall {
        /// The thread's name.
        name: String,
        /// What was asked for, in bytes.
        asked: usize,
    },
    /// The stack is larger than [`MAXIMUM_STACK_SIZE`].
    #[error(
        "thread `{name}`: a stack of {asked} bytes is too large; ask for at most {MAXIMUM_STACK_SIZE}"
    )]
    StackTooLarge {
        /// The thread's name.
        name: String,
        /// What was asked for, in bytes.
        asked: usize,
    },
    /// The time to look for work before a sleep is longer than [`spin::LONGEST`].
    #[error(
        "thread `{name}`: {asked:?} is too long to look for work before each sleep; ask for at most \
         {LONGEST:?}",
        LONGEST = spin::LONGEST
    )]
    SpinTooLong {
        /// The thread's name.
        name: String,
        /// What was asked for.
        asked: Duration,
    },
    /// The name holds a zero byte, which ends a name for the operating system.
    #[error("the thread name {name:?} holds a zero byte; leave it out")]
    ZeroInName {
        /// The thread's name.
        name: String,
    },
}

/// The obtained attributes of a thread, as read back from the system.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Obtained {
    /// The policy it runs under.
    pub policy: Policy,
    /// The core it is pinned to, if it is.
    pub core: Option<usize>,
    /// The bytes of its stack; where the system does not report it, the requested size.
    pub stack_size: usize,
    /// How long it looks for work before each sleep.
    pub spin_before_sleep: Duration,
    /// What was asked for and refused; always empty under [`Mode::Strict`].
    pub refusals: Vec<Refusal>,
}

impl Obtained {
    /// Nothing of `attributes` but the stack.
    pub(crate) fn stack_of(attributes: &Attributes) -> Self {
        Self {
            policy: Policy::Other,
            core: None,
            stack_size: attributes.stack_size,
            spin_before_sleep: Duration::ZERO,
            refusals: Vec::new(),
        }
    }

    /// Notes a refusal, or makes it the error under [`Mode::Strict`].
    pub(crate) fn refused(&mut self, mode: Mode, refusal: Refusal) -> Result<(), Refusal> {
        match mode {
            Mode::Strict => Err(refusal),
            Mode::BestEffort => {
                self.refusals.push(refusal);
                Ok(())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_attributes_are_named() {
        let error = Attributes::new("small")
            .stack_size(MINIMUM_STACK_SIZE - 1)
            .validate()
            .unwrap_err();
        assert!(
            error.to_string().contains("`small`") && error.to_string().contains("131071"),
            "{error}"
        );
        assert!(
            Attributes::new("large")
                .stack_size(usize::MAX)
                .validate()
                .is_err()
        );
        let error = Attributes::new("high")
            .policy(Policy::fifo(98))
            .validate()
            .unwrap_err();
        assert!(
            error.to_string().contains("fifo:98") && error.to_string().contains("97"),
            "{error}"
        );
        let error = Attributes::new("ze\0ro").validate().unwrap_err();
        assert!(error.to_string().contains("ze\\0ro"), "{error}");
    }

    #[test]
    fn a_thread_looks_for_work_for_a_bounded_time_and_on_a_core_of_its_own() {
        let attributes = |time| Attributes::new("io").spin_before_sleep(time);
        assert_eq!(attributes(spin::LONGEST).validate(), Ok(()));
        let error = attributes(spin::LONGEST + Duration::from_nanos(1)).validate();
        let error = error.unwrap_err().to_string();
        assert!(
            error.contains("`io`") && error.contains("1.000001ms"),
            "{error}"
        );
        let time = Duration::from_micros(50);
        let settled = |attributes: &Attributes, core| {
            let mut obtained = Obtained {
                core,
                ..Obtained::stack_of(attributes)
            };
            let settled = attributes.settle_spin(&mut obtained);
            settled.map(|()| (obtained.spin_before_sleep, obtained.refusals))
        };
        let refused = |why| Refusal::Spin { asked: time, why };
        assert_eq!(settled(&attributes(time), Some(1)), Ok((time, vec![])));
        let unpinned = refused(SpinRefusal::NotPinned);
        assert_eq!(
            settled(&attributes(time), None),
            Ok((Duration::ZERO, vec![unpinned.clone()]))
        );
        assert_eq!(
            settled(&attributes(time).mode(Mode::Strict), None),
            Err(unpinned)
        );
        let shared = SpinRefusal::SharedCore {
            with: "main".to_owned(),
        };
        assert_eq!(
            settled(&attributes(time).refuse_spin(shared.clone()), Some(1)),
            Ok((Duration::ZERO, vec![refused(shared.clone())]))
        );
        let unasked = Attributes::new("io").refuse_spin(shared);
        assert_eq!(settled(&unasked, None), Ok((Duration::ZERO, vec![])));
    }

    #[test]
    fn a_deadline_is_for_one_process_on_any_core() {
        let time = std::time::Duration::from_millis;
        let attributes =
            Attributes::new("servo").policy(Policy::deadline(time(1), time(2), time(2)));
        assert_eq!(attributes.validate(), Ok(()));
        let shared = attributes.validate_shared().unwrap_err();
        assert!(shared.to_string().contains("`servo`"), "{shared}");
        let pinned = attributes.core(3).validate().unwrap_err();
        assert!(pinned.to_string().contains("core 3"), "{pinned}");
        let reversed = Attributes::new("servo").policy(Policy::deadline(time(2), time(1), time(2)));
        assert!(matches!(
            reversed.validate(),
            Err(AttributeError::Policy { .. })
        ));
        assert_eq!(Attributes::new("many").validate_shared(), Ok(()));
    }

    #[test]
    fn the_framework_has_98_and_99() {
        assert_eq!(
            Attributes::framework("timers", Policy::fifo(98)).validate(),
            Ok(())
        );
        assert_eq!(
            Attributes::framework("emergency", Policy::fifo(99)).validate(),
            Ok(())
        );
        assert!(
            Attributes::framework("above", Policy::fifo(100))
                .validate()
                .is_err()
        );
    }
}
