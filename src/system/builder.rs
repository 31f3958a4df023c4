//! How a system is described: builders of executors, threads and processes.

use super::plan::{Placement, Plan, ProcessPlan};
use crate::csp::process::{Build, IntoProcess, Prepared};
use crate::deployment::Deployment;
use crate::error::{Result, SetupError};
use crate::log::{Sample, SignalBuilder};
use crate::parameters::{ParameterBuilder, Tunable};
use crate::safety::{Budgets, Ledger, OnOverrun};
use luna_core::arc_cache::ArcCache;
use luna_core::current::{self, LEVELS, ProcessId};
use luna_executors::{Name, ProcessHandle, ProcessSpec};
use luna_platform::facts::{Source, parse::core_list};
use luna_platform::thread::{Attributes, Policy};
use std::panic::{RefUnwindSafe, UnwindSafe};
use std::sync::Arc;
use std::time::Duration;

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
    let Some(available) = online.ok().filter(|cores| !cores.contains(&core)) else {
        return Ok(());
    };
    let of = attributes.name().to_owned();
    let stated = deployment.and_then(|deployment| deployment.lacks_core(&of, &available));
    Err(stated.unwrap_or(SetupError::NoSuchCore {
        of,
        core,
        available,
    }))
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
        /// [virtual clock](crate::System::virtual_clock), if that was set before.
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

thread_local! {
    /// What spawns on this thread referred to the system by.
    static SPARE_PLANS: ArcCache<Plan> = const { ArcCache::new() };
}

/// Keeps a reference to a system that runs for the next spawn: on a thread that runs processes,
/// which ends some time. What waits to be started does not wait for that.
fn spare(system: Arc<Plan>) {
    if current::executor_id().is_some() {
        SPARE_PLANS.with(|spare| {
            if !spare.keeps(&system) {
                spare.keep(&system);
            }
            spare.give_back(system);
        });
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
        let plan = SPARE_PLANS.with(|spare| spare.another(&self.plan));
        ProcessBuilder::new(plan, name.as_ref(), Placement::Executor(self.number))
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

/// A process to be: see [`Executor::process`] and [`Thread::process`].
#[must_use = "a process starts with `spawn`"]
pub struct ProcessBuilder {
    plan: Arc<Plan>,
    spec: ProcessSpec,
    /// A thread as the program states it.
    place: Placement,
    level: u8,
    shares_name: bool,
    /// If there are any.
    budgets: Option<Box<Budgets>>,
}

// A description: each of its methods changes one value, and calls no code of the user.
impl UnwindSafe for ProcessBuilder {}
impl RefUnwindSafe for ProcessBuilder {}

impl ProcessBuilder {
    #[inline]
    fn new(plan: Arc<Plan>, name: &str, place: Placement) -> Self {
        Self {
            plan,
            spec: ProcessSpec::new(Name::from(name)),
            place,
            level: ProcessSpec::DEFAULT_LEVEL,
            shares_name: false,
            budgets: None,
        }
    }

    /// At `priority`, 0 (lowest) to 31, among the processes of the same executor; 16 if not stated.
    #[inline]
    pub fn priority(mut self, priority: u8) -> Self {
        self.level = priority;
        self
    }

    /// Lets others have the same name: for processes that come and go and are not looked up by
    /// name. Reports and errors name each of them so. It is also what costs a spawn least, since no
    /// name is to be made up, and none to be looked for. No name of a process that has one of its
    /// own is in the way; a [replaceable](Self::replaceable) process always has.
    ///
    /// ```
    /// use luna::prelude::*;
    ///
    /// let mut system = System::new("server");
    /// let main = system.executor("main").build()?;
    /// for _ in 0..3 {
    ///     main.process("session").one_of_many().spawn(async { Ok(()) })?;
    /// }
    /// let report = system.run()?;
    /// assert!(report.processes.iter().all(|process| process.name == "session"));
    /// # Ok::<(), luna::Error>(())
    /// ```
    #[inline]
    pub fn one_of_many(mut self) -> Self {
        self.shares_name = true;
        self
    }

    /// A [parameter](crate::parameters) of the process, with the value that it has unless it is
    /// set. Declared with [`register`](ParameterBuilder::register), it is moved into the body.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use std::time::Duration;
    ///
    /// let mut system = System::new("camera");
    /// system.set_parameter("pan/kp", 2.5);
    /// let main = system.executor("main").build()?;
    /// let pan = main.process("pan").priority(20);
    /// let kp = pan.parameter("pan/kp", 2.0).unit("1/rad").range(0.0..=50.0).register()?;
    /// pan.spawn(async move {
    ///     let mut tick = luna::periodic("pan", Duration::from_millis(1))?;
    ///     tick.next().await;
    ///     assert_eq!(kp.get(), 2.5);
    ///     Ok(())
    /// })?;
    /// system.run()?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn parameter<T: Tunable>(&self, name: &str, default: T) -> ParameterBuilder<'_, T> {
        let process = (self.spec.id(), &**self.spec.name());
        ParameterBuilder::new(&self.plan, process, name, default)
    }

    /// A [signal](crate::log) that the process records. Declared with
    /// [`register`](SignalBuilder::register), it is moved into the body.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use std::time::Duration;
    ///
    /// let mut system = System::new("camera");
    /// let main = system.executor("main").build()?;
    /// let pan = main.process("pan").priority(20);
    /// let angle = pan.signal("pan/angle").unit("rad").register()?;
    /// pan.spawn(async move {
    ///     let mut tick = luna::periodic("pan", Duration::from_millis(1))?;
    ///     for cycle in 0..5 {
    ///         tick.next().await;
    ///         angle.record(0.1 * f64::from(cycle));
    ///     }
    ///     Ok(())
    /// })?;
    /// system.run()?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn signal<T: Sample>(&self, name: &str) -> SignalBuilder<T> {
        self.plan.log.signal(name)
    }

    /// Measures the longest time that the process keeps the processor, for about 50 ns each time it
    /// gets it.
    pub fn timed(mut self) -> Self {
        self.spec = self.spec.timed(true);
        self
    }

    /// Sets the longest time of one poll of the process, that is from when it is given the
    /// processor until it awaits something that is not there yet. Measured by the clock on the
    /// wall, for about 50 ns a poll; [`OnOverrun`] sets what happens after a poll that took longer.
    ///
    /// A poll that never ends is never measured: a [`Watchdog`](crate::safety::Watchdog) finds
    /// that. The time counts also while another thread has taken the processor: the report
    /// separates the two.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use std::time::Duration;
    ///
    /// let mut system = System::new("machine");
    /// let main = system.executor("main").build()?;
    /// main.process("planner").poll_budget(Duration::from_millis(1)).spawn(async {
    ///     let end = luna::now() + Duration::from_millis(2);
    ///     while luna::now() < end {}
    ///     Ok(())
    /// })?;
    /// let report = system.run()?;
    /// assert_eq!(report.processes[0].budgets[0].overruns, 1);
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn poll_budget(mut self, budget: Duration) -> Self {
        self.budgets().poll = Some(budget);
        self
    }

    /// Allows the process so much time for a cycle of each of its loops, that is from when the
    /// cycle begins until the loop calls [`next`](crate::Periodic::next). How late the cycle began
    /// does not count, since another process caused that: [`LateCycle`](crate::report::LateCycle)
    /// looks for the cause. What it waits for within the cycle does.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna::safety::BudgetKind;
    /// use std::time::Duration;
    ///
    /// let mut system = System::new("machine");
    /// let main = system.executor("main").build()?;
    /// main.process("servo").cycle_budget(Duration::from_millis(1)).spawn(async {
    ///     let mut tick = luna::periodic("servo", Duration::from_millis(5))?;
    ///     tick.next().await;
    ///     luna::after(Duration::from_millis(2)).await;
    ///     tick.next().await;
    ///     Ok(())
    /// })?;
    /// let budgets = &system.run()?.processes[0].budgets;
    /// assert_eq!((budgets[0].kind, budgets[0].overruns), (BudgetKind::Cycle, 1));
    /// assert_eq!(budgets[0].worst.as_ref().unwrap().of_loop.as_deref(), Some("servo"));
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn cycle_budget(mut self, budget: Duration) -> Self {
        self.budgets().cycle = Some(budget);
        self
    }

    /// What happens when the process takes longer than a budget; without this it is counted.
    pub fn on_overrun(mut self, policy: OnOverrun) -> Self {
        self.budgets().on_overrun = Some(policy);
        self
    }

    /// Reads before each poll what the kernel counts of the thread, so that the report of an
    /// overrun states exactly how long it was on the processor, and how often it was taken off.
    /// Three system calls, about two microseconds a poll: for the search, not for the machine.
    /// Without it the counts go back to the overrun before, or the start.
    pub fn accounted(mut self) -> Self {
        self.budgets().accounted = true;
        self
    }

    fn budgets(&mut self) -> &mut Budgets {
        self.budgets.get_or_insert_default()
    }

    /// Adds the process to the system. It starts with the others; if they run already, at once.
    ///
    /// `process` is a future, a closure that makes one on the executor's thread, or a
    /// [`Process`](crate::Process): see [`IntoProcess`]. While the system runs this is not for the
    /// real-time path: it allocates, and `pre_run` runs right here.
    ///
    /// # Errors
    ///
    /// A [`SetupError`]: a priority out of range, a budget of zero, a name that another process
    /// has, a thread that makes no sense, a system that has ended. While the system runs also an
    /// error of `pre_run`, and a thread that is refused.
    pub fn spawn<M>(self, process: impl IntoProcess<M>) -> Result<ProcessId> {
        let (system, plan) = self.planned(process)?;
        let (id, runs) = system.add_process(plan)?;
        if runs {
            spare(system);
        }
        Ok(id)
    }

    /// Adds the process to the system, which runs already, as [`spawn`](Self::spawn) does, and
    /// returns its handle: to wait for its end, say. Not for the real-time path, as `spawn`.
    ///
    /// # Errors
    ///
    /// As [`spawn`](Self::spawn), and [`SetupError::NotRunning`] before the system runs: nothing
    /// was added then.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna::Exit;
    ///
    /// let mut system = System::new("server");
    /// let main = system.executor("main").build()?;
    /// assert!(main.process("early").start(async { Ok(()) }).is_err());
    /// main.clone().process("parent").spawn(async move {
    ///     let child = main.process("child").start(async { Ok(()) })?;
    ///     assert_eq!(child.join().await, Exit::Completed);
    ///     Ok(())
    /// })?;
    /// system.run()?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn start<M>(self, process: impl IntoProcess<M>) -> Result<ProcessHandle> {
        let (system, plan) = self.planned(process)?;
        let handle = system.start_process(plan)?;
        spare(system);
        Ok(handle)
    }

    #[inline]
    fn planned<M>(
        mut self,
        process: impl IntoProcess<M>,
    ) -> Result<(Arc<Plan>, ProcessPlan<impl Build>)> {
        let ledger = self.check(true).inspect_err(|_| self.plan.note_refusal())?;
        Ok(self.described(ledger, process.prepare()))
    }

    /// Adds the process to the system as [`spawn`](Self::spawn) does, with its channel ends apart
    /// from its body, so that the set-up can let another one stand in for it: see
    /// [`System::stand_in`](crate::System::stand_in), with an example.
    ///
    /// `ends` is of any type: best one that is made for this process, with a field for each end, so
    /// that it can be taken for no other. `body` makes the process of it, unless there is a
    /// stand-in, which then is given the ends.
    ///
    /// # Errors
    ///
    /// As [`spawn`](Self::spawn), and [`SetupError::StandInDoesNotFit`] if a stand-in takes ends of
    /// another type. After an error the stand-in waits as before, so that it may be tried again.
    pub fn replaceable<E: Send + 'static, M, P: IntoProcess<M>>(
        mut self,
        ends: E,
        body: impl FnOnce(E) -> P,
    ) -> Result<ProcessId> {
        // All that can be refused is refused before the stand-in is taken: otherwise a second
        // attempt would run the process itself unnoticed.
        let ledger = self
            .check(false)
            .inspect_err(|_| self.plan.note_refusal())?;
        self.shares_name = false;
        let nothing = Prepared {
            resident: None,
            build: (),
        };
        let (system, plan) = self.described(ledger, nothing);
        let name = system.reserve(plan.name())?;
        let declared = system.stand_ins().declare::<E>(plan.name());
        // Without the lock: what is made here is the user's.
        let prepared = match declared.inspect_err(|_| system.note_refusal())? {
            Some(stand_in) => {
                // From here on it is used up, so the name stays taken, also if what is the user's
                // panics.
                name.keep();
                (stand_in.prepare)(Box::new(ends))
            }
            None => {
                let prepared = body(ends).prepare().boxed();
                name.keep();
                prepared
            }
        };
        system.add_reserved(plan.map(|_| prepared))
    }

    /// Takes what the system file states of the process, and looks whether the description is
    /// valid. Gives the ledger of its budgets. `is_plain`: no stand-in can replace it.
    fn check(&mut self, is_plain: bool) -> Result<Option<Arc<Ledger>>> {
        if is_plain {
            self.plan.check_plain(self.spec.name())?;
        }
        if let Placement::Thread(attributes) = &mut self.place {
            **attributes = settled(&self.plan, (**attributes).clone(), false)?;
            self.plan.members().take_thread_name(attributes.name())?;
        }
        if let Some(deployment) = self.plan.deployment() {
            let Self { spec, place, .. } = self;
            deployment.process(spec, &mut self.level, place, &mut self.budgets)?;
        }
        if self.level >= LEVELS {
            return Err(SetupError::Level {
                process: self.spec.name().to_string(),
                level: self.level,
            }
            .into());
        }
        let budgets = self.budgets.take();
        let ledger = budgets.map(|budgets| budgets.ledger(self.spec.name()));
        Ok(ledger.transpose()?.map(Arc::new))
    }

    /// The description, with what is [prepared](IntoProcess::prepare) for its body.
    #[inline]
    fn described<B>(
        self,
        ledger: Option<Arc<Ledger>>,
        prepared: Prepared<B>,
    ) -> (Arc<Plan>, ProcessPlan<B>) {
        let mut spec = self.spec.level(self.level);
        if let Some(ledger) = &ledger {
            spec = spec.monitored(ledger.clone());
        }
        let plan = ProcessPlan {
            place: self.place,
            spec,
            shares_name: self.shares_name,
            ledger,
            prepared,
        };
        (self.plan, plan)
    }
}

luna_platform::debug_fields!(ExecutorBuilder, |builder| name: builder.attributes.name());
luna_platform::debug_fields!(Thread, |thread| name: thread.attributes.name());
luna_platform::debug_fields!(ProcessBuilder, |builder| name: builder.spec.name());
luna_platform::debug_fields!(Executor, |executor| number: executor.number);
