//! A process that is about to be spawned.

use super::settled;
use crate::csp::process::{IntoProcess, Prepared};
use crate::error::{Result, SetupError};
use crate::log::{Sample, SignalBuilder};
use crate::parameters::{ParameterBuilder, Tunable};
use crate::safety::{Budgets, Ledger, OnOverrun};
use crate::system::plan::{Placement, Plan, ProcessPlan};
use luna_core::current::{LEVELS, ProcessId};
use luna_core::{Name, ProcessHandle, ProcessSpec};
use std::panic::{RefUnwindSafe, UnwindSafe};
use std::sync::Arc;
use std::time::Duration;

/// A process to be: see [`Executor::process`](super::Executor::process) and
/// [`Thread::process`](super::Thread::process).
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
    pub(super) fn new(plan: Arc<Plan>, name: &str, place: Placement) -> Self {
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
        ParameterBuilder::new(
            &self.plan.parameters,
            &self.plan.was_refused,
            process,
            name,
            default,
        )
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
    /// A poll that never ends is found with [`OnOverrun::Emergency`] alone, by the thread that runs
    /// the system; else use a [`Watchdog`](crate::safety::Watchdog). The time counts also while
    /// another thread has taken the processor: the report separates the two.
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
    /// looks for the cause. What it waits for within the cycle does, for ever too: see
    /// [`OnOverrun::Emergency`]. A loop that is dropped has no cycle any more.
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
        system.add_process(plan)
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
        system.start_process(plan)
    }

    #[inline]
    fn planned<M>(mut self, process: impl IntoProcess<M>) -> Result<(Arc<Plan>, ProcessPlan)> {
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
        let (system, mut plan) = self.described(ledger, Prepared::nothing());
        let names = system.reserve(&plan)?;
        let declared = system.stand_ins().declare::<E>(plan.name());
        // Without the lock: what is made here is the user's.
        plan.prepared = match declared.inspect_err(|_| system.note_refusal())? {
            Some(stand_in) => {
                // From here on it is used up, so the names stay taken, also if what is the user's
                // panics.
                names.keep();
                (stand_in.prepare)(Box::new(ends))
            }
            None => {
                let prepared = body(ends).prepare();
                names.keep();
                prepared
            }
        };
        system.add_reserved(plan)
    }

    /// Takes what the system file states of the process, and looks whether the description is
    /// valid. Gives the ledger of its budgets. `is_plain`: no stand-in can replace it.
    fn check(&mut self, is_plain: bool) -> Result<Option<Arc<Ledger>>> {
        if is_plain {
            self.plan.check_plain(self.spec.name())?;
        }
        if let Placement::Thread(attributes) = &mut self.place {
            **attributes = settled(&self.plan, (**attributes).clone(), false)?;
        }
        if let Some(deployment) = self.plan.deployment() {
            let (name, executor) = (self.spec.name(), self.place.executor());
            deployment.process(name, &mut self.level, executor, &mut self.budgets)?;
        }
        if self.level >= LEVELS {
            return Err(SetupError::Level {
                process: self.spec.name().to_string(),
                level: self.level,
            }
            .into());
        }
        let budgets = self.budgets.take();
        let ledger = budgets.map(|budgets| crate::safety::ledger(*budgets, self.spec.name()));
        Ok(ledger.transpose()?.map(Arc::new))
    }

    /// The description, with what is [prepared](IntoProcess::prepare) for its body.
    #[inline]
    fn described(
        self,
        ledger: Option<Arc<Ledger>>,
        prepared: Prepared,
    ) -> (Arc<Plan>, ProcessPlan) {
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

luna_platform::debug_fields!(ProcessBuilder, |builder| name: builder.spec.name());
