//! How a system is described: builders of executors, threads and processes.

mod process;

use super::plan::{Placement, Plan};
use crate::error::{Result, SetupError};
use luna_config::deployment::Deployment;
use luna_core::ProcessHandle;
use luna_core::current::ProcessId;
use luna_machine::facts::{Source, parse::core_list};
use luna_platform::thread::{Attributes, Policy};
use std::sync::Arc;
use std::time::Duration;

pub use process::ProcessBuilder;

/// Whether the machine has the requested core. The start shows whether this program may use it.
fn check_core(
    plan: &Plan,
    deployment: Option<&Deployment>,
    attributes: &Attributes,
) -> Result<(), SetupError> {
    let Some(core) = attributes.asked_core() else {
        return Ok(());
    };
    if plan.settings().clock.kind().is_virtual() {
        // It is not requested: what is simulated may be a larger machine.
        return Ok(());
    }
    // Where the machine does not report its cores, the start reports that.
    let online = Source::machine().parse("/sys/devices/system/cpu/online", core_list);
    let Some(available) = online.ok().filter(|cores| is_an_error(core, cores)) else {
        return Ok(());
    };
    let of = attributes.name().to_owned();
    let stated = deployment
        .and_then(|deployment| deployment.lacks_core(&of, &available))
        .map(SetupError::from);
    Err(stated.unwrap_or(SetupError::NoSuchCore {
        of,
        core,
        available,
    }))
}

/// Whether a core that a program asks for is an error on a machine that has `available`. With one
/// core every placement is the same: a program that was written for a larger machine runs, and its
/// report names the core as a [`Shortfall`](crate::report::Shortfall).
fn is_an_error(core: usize, available: &[usize]) -> bool {
    available.len() > 1 && !available.contains(&core)
}

/// The attributes of a thread as the system file has them, if they make sense and the machine has
/// the core.
fn settled(plan: &Plan, attributes: Attributes, is_shared: bool) -> Result<Attributes> {
    let deployment = plan.begin_deployment()?;
    let attributes = match deployment {
        Some(deployment) => deployment.thread(attributes, is_shared)?,
        None => attributes,
    };
    match is_shared {
        true => attributes.validate_shared()?,
        false => attributes.validate()?,
    }
    check_core(plan, deployment, &attributes)?;
    Ok(attributes)
}

macro_rules! place_methods {
    () => {
        /// Pins the thread to `core`, by the operating system's number of it. Whether the machine
        /// has it is checked when the executor or process is made; not in a system on a
        /// [virtual clock](crate::System::virtual_clock), if that was set before. On a machine with
        /// one core, a core that it has not is no error but a
        /// [`Shortfall`](crate::report::Shortfall): each thread runs on the one that is there.
        pub fn core(mut self, core: usize) -> Self {
            self.attributes = self.attributes.core(core);
            self
        }

        /// Runs the thread under `policy`: SCHED_FIFO or SCHED_RR with a priority of 1 to 97, or
        /// none (the default); an OS thread without a core also under SCHED_DEADLINE
        /// ([`Policy::deadline`] has its limits).
        pub fn policy(mut self, policy: Policy) -> Self {
            self.attributes = self.attributes.policy(policy);
            self
        }

        /// Gives the thread a stack of `bytes`, at least 128 KiB; 2 MiB if not stated. All of it is
        /// touched before the start. For processes that keep or move large values; what is on an
        /// executor shares its stack, one turn at a time.
        pub fn stack_size(mut self, bytes: usize) -> Self {
            self.attributes = self.attributes.stack_size(bytes);
            self
        }

        /// Looks for work for `time` before each sleep, at most 1 ms; without this the thread
        /// sleeps as soon as it has nothing to do.
        ///
        /// A wake from another core then takes some hundred nanoseconds instead of microseconds.
        /// The thread burns its core meanwhile, and its process or processes run the later the more
        /// other threads want that core; so it needs one to itself. Where it is not pinned, or
        /// another executor or thread of this system is pinned to the same core or to none, it
        /// sleeps at once, which is a [`Shortfall`](crate::report::Shortfall): stated in the
        /// report, and an error of a [`strict`](crate::System::strict) system. A thread that comes
        /// while the system runs ends the spinning of the threads that share its core. Other
        /// programs are not known here: isolate the core.
        ///
        /// ```
        /// use luna::prelude::*;
        /// use std::time::Duration;
        ///
        /// let mut system = System::new("machine");
        /// let main = system.executor("main").spin_before_sleep(Duration::from_micros(50)).build()?;
        /// main.process("one").spawn(async { Ok(()) })?;
        /// let report = system.run()?;
        /// assert!(report.threads[0].shortfalls[0].to_string().contains("pin it to a core"));
        /// # Ok::<(), luna::Error>(())
        /// ```
        pub fn spin_before_sleep(mut self, time: Duration) -> Self {
            self.attributes = self.attributes.spin_before_sleep(time);
            self
        }
    };
}

/// An executor to be: see [`System::executor`](crate::System::executor).
#[must_use = "an executor is made by `build`"]
pub struct ExecutorBuilder {
    plan: Arc<Plan>,
    attributes: Attributes,
}

impl ExecutorBuilder {
    pub(crate) fn new(plan: Arc<Plan>, name: &str) -> Self {
        Self {
            plan,
            attributes: Attributes::new(name),
        }
    }

    place_methods!();

    /// Adds the executor to the system. Its thread is made when the system starts.
    ///
    /// # Errors
    ///
    /// A [`SetupError`]: a core that the machine has not, a priority out of range, a stack too
    /// small, a time to look for work that is too long, a name that another executor or thread has,
    /// or a system that has been run.
    ///
    /// ```
    /// use luna::error::SetupError;
    /// use luna::{Error, Policy, System};
    ///
    /// let mut system = System::new("wrong");
    /// let refused = system.executor("control").policy(Policy::fifo(98)).build();
    /// // 1 to 97 are the user's
    /// assert!(matches!(refused, Err(Error::Setup(SetupError::Attributes(_)))));
    /// assert!(system.executor("control").build().is_ok());
    /// let twice = system.executor("control").build();
    /// assert!(matches!(twice, Err(Error::Setup(SetupError::DuplicateName { .. }))));
    /// ```
    pub fn build(self) -> Result<Executor> {
        let Self { plan, attributes } = self;
        let number = settled(&plan, attributes, true)
            .and_then(|attributes| plan.add_executor(attributes))
            .inspect_err(|_| plan.note_refusal())?;
        Ok(Executor { plan, number })
    }
}

/// An executor of a system: where processes are spawned. Cloning it is cheap; it does not borrow
/// the system, so processes can keep one to spawn others.
#[derive(Clone)]
pub struct Executor {
    plan: Arc<Plan>,
    number: usize,
}

impl Executor {
    /// A process to be, on this executor.
    pub fn process(&self, name: impl AsRef<str>) -> ProcessBuilder {
        ProcessBuilder::new(
            self.plan.clone(),
            name.as_ref(),
            Placement::Executor(self.number),
        )
    }

    /// A spawned process of this system, from when it runs. Not for the real-time path, as
    /// [`System::process_handle`](crate::System::process_handle).
    pub fn process_handle(&self, id: ProcessId) -> Option<ProcessHandle> {
        self.plan.members().started.handle(id)
    }
}

/// An OS thread to be: see [`System::thread`](crate::System::thread).
#[must_use = "a thread is made for the process that is spawned on it"]
pub struct Thread {
    plan: Arc<Plan>,
    attributes: Attributes,
}

impl Thread {
    pub(crate) fn new(plan: Arc<Plan>, name: &str) -> Self {
        Self {
            plan,
            attributes: Attributes::new(name),
        }
    }

    place_methods!();

    /// The thread's one process to be. What is wrong with the thread is an error of `spawn`.
    pub fn process(self, name: impl AsRef<str>) -> ProcessBuilder {
        let place = Placement::Thread(Box::new(self.attributes));
        ProcessBuilder::new(self.plan, name.as_ref(), place)
    }
}

luna_platform::debug_fields!(ExecutorBuilder, |builder| name: builder.attributes.name());
luna_platform::debug_fields!(Thread, |thread| name: thread.attributes.name());
luna_platform::debug_fields!(Executor, |executor| number: executor.number);

#[cfg(test)]
mod tests {
    use super::is_an_error;

    #[test]
    fn a_core_that_is_not_there_is_an_error_where_there_is_a_choice() {
        assert!(is_an_error(2, &[0, 1]));
        assert!(!is_an_error(1, &[0, 1]));
        assert!(is_an_error(1, &[0, 2]));
        assert!(!is_an_error(1, &[0]));
    }
}
