//! The handles of a system's safety state.

use super::emergency::{Emergency, OF_THREAD};
use super::entered::SafeStateEntered;
use super::state::{Cause, Degree, ResetError, SafetyState};
use crate::error::{Error, Result};
use std::sync::Arc;
use std::time::Duration;

/// A system's safety state, to be read and changed from anywhere: from
/// [`System::safety`](crate::System::safety), and in a process from
/// [`current`]. Cloning it is cheap, and it may outlive the system.
///
/// ```
/// use luna::prelude::*;
/// use luna::safety::Degree;
///
/// let mut system = System::new("arm");
/// let safety = system.safety();
/// let main = system.executor("main").build()?;
/// main.process("controller").spawn(async {
///     let safety = luna::safety::current().expect("it is a process of a system");
///     safety.warn(luna::Error::other("the motor is hot"));
///     assert_eq!(safety.degree(), Degree::Warning);
///     safety.enter_safe_state(luna::Error::other("the motor is too hot"));
///     let output = if safety.is_safe_state() { 0.0 } else { 1.0 };
///     assert_eq!(output, 0.0);
///     Ok(())
/// })?;
/// let report = system.run()?; // a safe state does not end the system
/// assert_eq!(report.safety.state.to_string(), "safe state: the motor is too hot, by process `controller`");
/// assert!(safety.reset(luna::Error::other("the motor has cooled down")).is_ok());
/// assert_eq!(safety.degree(), Degree::Normal);
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Clone)]
pub struct Safety(Arc<Emergency>);

/// The safety state of the system that the calling process belongs to; none outside of a system's
/// threads. Real-time path: yes; O(1).
///
/// ```
/// assert!(luna::safety::current().is_none());
/// ```
pub fn current() -> Option<Safety> {
    let emergency = OF_THREAD.with_borrow(Clone::clone);
    emergency.map(Safety)
}

impl Safety {
    pub(crate) fn new(emergency: Arc<Emergency>) -> Self {
        Self(emergency)
    }

    /// How bad it is. Real-time path: yes; one atomic load.
    pub fn degree(&self) -> Degree {
        self.0.journal.degree()
    }

    /// Whether outputs are to be neutral: in a safe state, and in an emergency too. Real-time path:
    /// yes; one atomic load.
    #[inline]
    pub fn is_safe_state(&self) -> bool {
        self.degree() >= Degree::SafeState
    }

    /// Waits until the system is in a safe state, or worse: at once if it is.
    ///
    /// It is ready as long as that lasts. In a loop that awaits it again and again, as by
    /// [`Receiver::recv_unless`](crate::Receiver::recv_unless), it never waits then, and no other
    /// process of the executor runs: there take [`safe_state_edge`](Self::safe_state_edge).
    ///
    /// If the state is left before the process runs, it waits on. An emergency that begins wakes no
    /// waiter: its functions bring the machine to safety, and the processes are cancelled.
    /// Cancel-safe. Real-time path: yes; O(1), or O(waiters of lower priority) when it begins to
    /// wait, no allocation; polled again, it is two atomic loads.
    ///
    /// ```
    /// use luna::prelude::*;
    ///
    /// let mut system = System::new("axis");
    /// let safety = system.safety();
    /// let main = system.executor("main").build()?;
    /// main.process("output").spawn(async {
    ///     let safety = luna::safety::current().expect("it is a process of a system");
    ///     safety.safe_state_entered().await;
    ///     assert!(safety.is_safe_state()); // put out neutral
    ///     Ok(())
    /// })?;
    /// main.process("monitor").spawn(async move {
    ///     safety.enter_safe_state(luna::Error::other("the motor is too hot"));
    ///     Ok(())
    /// })?;
    /// system.run()?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn safe_state_entered(&self) -> SafeStateEntered {
        SafeStateEntered::new(self.0.clone(), false)
    }

    /// As [`safe_state_entered`](Self::safe_state_entered), but it reports each safe state once: at
    /// once if the system is in one, and awaited again when the next one is entered.
    ///
    /// For a process that puts out something, and waits for its next value meanwhile
    /// ([`Receiver::recv_unless`](crate::Receiver::recv_unless)): so neutral is put out at once,
    /// and not with the next value. Pin one for the whole body: another one reports the same state
    /// again. It does not report a state that is left before the process runs; an emergency counts
    /// as a state of its own. Cancel-safe, cost and real-time path as there.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use std::{pin::pin, time::Duration};
    ///
    /// let mut system = System::new("axis");
    /// system.virtual_clock();
    /// let safety = system.safety();
    /// let main = system.executor("main").build()?;
    /// let (put, values) = luna::channel::<f64>();
    /// main.process("output").spawn(async move {
    ///     let safety = luna::safety::current().expect("it is a process of a system");
    ///     let mut entered = pin!(safety.safe_state_edge());
    ///     let mut outputs = Vec::new();
    ///     loop {
    ///         let output = match values.recv_unless(entered.as_mut()).await {
    ///             Ok(value) if !safety.is_safe_state() => value,
    ///             Ok(_) => 0.0,
    ///             Err(error) if error.is_timeout() => 0.0, // it has just been entered
    ///             Err(_) => break, // its writers are gone
    ///         };
    ///         outputs.push(output);
    ///     }
    ///     // between two values neutral, once; and for each that comes
    ///     assert_eq!(outputs, [0.5, 0.0, 0.0, 0.0]);
    ///     Ok(())
    /// })?;
    /// main.process("controller").spawn(async move {
    ///     for n in 0..3 {
    ///         put.send(0.5).await?;
    ///         luna::after(Duration::from_millis(10)).await;
    ///         if n == 0 {
    ///             safety.enter_safe_state(luna::Error::other("the motor is too hot"));
    ///         }
    ///         luna::after(Duration::from_millis(10)).await;
    ///     }
    ///     Ok(())
    /// })?;
    /// system.run()?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn safe_state_edge(&self) -> SafeStateEntered {
        SafeStateEntered::new(self.0.clone(), true)
    }

    /// The state, with causes, processes' names and times. Not for the real-time path: it
    /// allocates, and takes the system's plain lock. No thread that changes the state waits for
    /// that: the state's own lock is held for a few moves only.
    pub fn state(&self) -> SafetyState {
        let mut state = self.0.journal.state();
        for event in state.events.iter_mut().chain(&mut state.latched) {
            event.who = event.process.and_then(|process| self.0.name_of(process));
        }
        state
    }

    /// Notes a warning: everything goes on. Real-time path: yes; O(1), no system call, no
    /// allocation.
    pub fn warn(&self, cause: Error) {
        self.0
            .journal
            .note(Degree::Warning, Cause::Raised(cause), || true);
    }

    /// Enters the safe state, if the state is not that bad yet. The processes run on, and
    /// [`is_safe_state`](Self::is_safe_state) is true from now on; the functions of
    /// [`on_safe_state`](crate::System::on_safe_state) run on the emergency manager's thread. It
    /// stays so until it is [`reset`](Self::reset). All that [wait for
    /// it](Self::safe_state_entered) are woken. Real-time path: yes; O(1 + waiters), no allocation,
    /// and one system call if there are such functions, and one for each waiter with a sleeping
    /// thread.
    pub fn enter_safe_state(&self, cause: Error) {
        self.0.enter_safe_state(Cause::Raised(cause));
    }

    /// Raises an emergency with `cause`, as [`luna::emergency`](crate::emergency()) does in a
    /// process, from any thread: also for drivers that run on threads which are no processes.
    ///
    /// Before [`System::run`](crate::System::run) it is latched: the functions run as soon as that
    /// has begun, and no process is released. After its end nothing happens. Real-time path: yes;
    /// O(1) and at most four system calls, no allocation. `cause` is dropped here if others came
    /// before with more than are kept.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna::End;
    ///
    /// let mut system = System::new("arm");
    /// system.on_emergency("brakes", || { /* engage them */ });
    /// let safety = system.safety();
    /// let main = system.executor("main").build()?;
    /// main.process("servo").spawn(std::future::pending::<luna::Result<()>>())?;
    /// let driver = std::thread::spawn(move || safety.raise(luna::Error::other("the card does not answer")));
    /// assert_eq!(system.run().unwrap_err().to_string(), "the card does not answer");
    /// assert_eq!(system.report().unwrap().end, End::Emergency);
    /// # driver.join().unwrap();
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn raise(&self, cause: Error) {
        self.0.trigger(Cause::Raised(cause));
    }

    /// Leaves a warning or the safe state, for a reason that is kept with the other events. A
    /// person's decision, or that of a process that knows that what was wrong is not any more.
    /// Real-time path: no, since it allocates, and may free what the causes hold; O(functions of
    /// the safe state).
    ///
    /// # Errors
    ///
    /// [`ResetError`]: an emergency is not left but by a new system, and functions of the safe
    /// state must have run.
    pub fn reset(&self, why: Error) -> Result<(), ResetError> {
        self.0
            .journal
            .reset(why, || self.0.at_safe_state.may_reset())
    }

    /// Registers a function as [`System::on_emergency_within`](crate::System::on_emergency_within)
    /// does, from any place that sets up something to be brought to safety, such as a driver that
    /// opens a device. Functions run in the order in which they were registered, from wherever that
    /// was.
    ///
    /// It may still be registered while the system runs, or while the others run in an emergency:
    /// then it runs behind them. Not for the real-time path: it allocates, and the memory is taken
    /// before any lock.
    ///
    /// # Errors
    ///
    /// [`SetupError::EmergencyOver`](crate::error::SetupError::EmergencyOver) if it would never be
    /// run: the functions have run, or the system has ended;
    /// [`SetupError::TooManyFunctions`](crate::error::SetupError::TooManyFunctions).
    ///
    /// ```
    /// use luna::prelude::*;
    /// use std::time::Duration;
    ///
    /// let system = System::new("arm");
    /// let function = system.safety().on_emergency("card", Duration::from_millis(10), || { /* neutral outputs */ })?;
    /// // When the card is closed:
    /// assert!(function.withdraw());
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn on_emergency(
        &self,
        name: &str,
        limit: Duration,
        function: impl FnMut() + Send + 'static,
    ) -> Result<SafetyFunction> {
        let id = self.0.add_function(name, limit, Box::new(function))?;
        Ok(SafetyFunction {
            emergency: self.0.clone(),
            id,
        })
    }
}

luna_platform::debug_fields!(Safety, |safety| degree: safety.degree());

/// A function that a driver has registered by its [handle](Safety). Dropping this changes nothing.
pub struct SafetyFunction {
    emergency: Arc<Emergency>,
    id: u64,
}

impl SafetyFunction {
    /// Withdraws and drops the function, because what it was for is gone. Returns whether it will
    /// not run; if false, it runs at this moment, or has run. Not for the real-time path: it frees.
    pub fn withdraw(self) -> bool {
        self.emergency.withdraw_function(self.id)
    }
}

luna_platform::debug_fields!(SafetyFunction, |function| id: function.id);
