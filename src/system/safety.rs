//! The safety settings of a system at set-up.

use super::System;
use crate::error::Result;
use crate::safety::{Guardian, LIMIT, Safety};
use std::time::Duration;

impl System {
    /// Registers a function that brings something to safety, and may take half a second for it.
    ///
    /// In an emergency they run once, first to last registered (with those that drivers register by
    /// [`Safety::on_emergency`]), on a thread of the highest priority, SCHED_FIFO 99, which waits
    /// ready for it; then the system ends. What makes an emergency: SIGINT, SIGTERM, SIGHUP; a
    /// panic in a process or a timer's callback; [`luna::emergency`](crate::emergency()); an
    /// overrun budget if [so stated](crate::safety::OnOverrun::Emergency); [`Safety::raise`];
    /// a deadlock of a [`strict`](Self::strict) system; the [parent's
    /// death](Self::emergency_at_parents_death) on request. In a crash (SIGSEGV, SIGBUS, SIGFPE,
    /// SIGILL, SIGABRT) they run too, and then the program ends as it would without them. So they
    /// do at every other signal that ends a program by default and that the program neither handles
    /// nor ignores. `docs/safety.md` says what is guaranteed, and what is not.
    ///
    /// One that panics does not keep the next from running. One that takes longer than its limit is
    /// left behind at low priority, and another thread goes on with the next:
    /// [`on_emergency_within`](Self::on_emergency_within). The report states the outcome of each.
    ///
    /// A function is called in the middle of anything, also of a crash. The crashed thread may hold
    /// any lock, that of the memory allocator too. The best functions write to a device that is
    /// open already, and neither allocate nor lock.
    ///
    /// Functions run with SIGINT, SIGTERM, SIGHUP and SIGQUIT blocked. A program that one starts by
    /// `std::process` inherits that, and such a signal does not end it unless it unblocks it
    /// (shells do so for what they run, few others do): have it started before, or empty the mask
    /// in
    /// [`pre_exec`](https://doc.rust-lang.org/std/os/unix/process/trait.CommandExt.html#tymethod.pre_exec).
    ///
    /// A panic in a process makes an emergency before the panic hook prints, which takes long with
    /// a backtrace; so also one that the body catches, unless by
    /// [`luna::safety::catch_panic`](crate::safety::catch_panic()). A hook that the program sets
    /// while the system runs comes before the functions. A panic while one unwinds is a crash by
    /// SIGABRT.
    pub fn on_emergency(
        &mut self,
        name: &str,
        function: impl FnMut() + Send + 'static,
    ) -> &mut Self {
        self.on_emergency_within(name, LIMIT, function)
    }

    /// Registers a function as [`on_emergency`](Self::on_emergency) does, with the time that it may
    /// take, on the machine's clock.
    ///
    /// When that is over it goes on at low priority (SCHED_OTHER, nice 19) if it can, and another
    /// thread, which was made before the start, begins the next; seven may hang so. If one more
    /// hangs, those behind it do not run, and the report says so. It is noticed at most a
    /// millisecond late.
    ///
    /// # Panics
    ///
    /// If there are 256 functions already.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna::report::FunctionOutcome;
    /// use std::time::Duration;
    ///
    /// let mut system = System::new("arm");
    /// system.on_emergency_within("brakes", Duration::from_millis(20), || loop { std::thread::park() });
    /// system.on_emergency("lamp", || { /* switch it on */ });
    /// let main = system.executor("main").build()?;
    /// main.process("encoder").spawn(async { Err(luna::emergency(luna::Error::other("no index pulse"))) })?;
    /// system.run().unwrap_err();
    /// let functions = system.report().unwrap().safety.functions;
    /// assert_eq!(functions[0].outcome, FunctionOutcome::LeftBehind);
    /// assert_eq!(functions[1].outcome, FunctionOutcome::Ran);
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn on_emergency_within(
        &mut self,
        name: &str,
        limit: Duration,
        function: impl FnMut() + Send + 'static,
    ) -> &mut Self {
        self.added(
            self.plan
                .emergency
                .add_function(name, limit, Box::new(function)),
        )
    }

    /// Registers a function that runs each time the [safe state](Safety::enter_safe_state) is
    /// entered, on the thread of the emergency functions, and in half a second as they: for outputs
    /// that no process drives. The processes run on; they ask [`Safety::is_safe_state`]. On a
    /// virtual clock it runs when it comes to it, while time goes on.
    ///
    /// # Panics
    ///
    /// If there are 256 functions already.
    ///
    /// ```
    /// use luna::prelude::*;
    ///
    /// let mut system = System::new("arm");
    /// let (lamp, lit) = std::sync::mpsc::channel();
    /// system.on_safe_state("lamp", move || drop(lamp.send("orange")));
    /// let main = system.executor("main").build()?;
    /// main.process("controller").spawn(async {
    ///     luna::safety::current().unwrap().enter_safe_state(luna::Error::other("no set-points"));
    ///     Ok(())
    /// })?;
    /// system.run()?;
    /// assert_eq!(lit.try_recv(), Ok("orange"));
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn on_safe_state(
        &mut self,
        name: &str,
        function: impl FnMut() + Send + 'static,
    ) -> &mut Self {
        let functions = &self.plan.emergency.at_safe_state;
        self.added(functions.add(name, LIMIT, Box::new(function)))
    }

    /// Panics if a function could not be added, unless the system has begun: after the run it would
    /// never be called.
    fn added(&mut self, added: Result<u64>) -> &mut Self {
        match added {
            Err(error) if !self.plan.has_begun() => panic!("{error}"),
            _ => self,
        }
    }

    #[doc(hidden)]
    #[deprecated(since = "0.1.0", note = "use `System::safety`")]
    pub fn emergency_trigger(&self) -> Safety {
        self.safety()
    }

    /// The system's safety state, from now on and also after its end: to read it, and to raise an
    /// emergency from any thread ([`Safety::raise`]). In a process
    /// [`safety::current`](crate::safety::current) returns it.
    pub fn safety(&self) -> Safety {
        Safety::new(self.plan.emergency.clone())
    }

    /// Makes it an emergency when the program that started this one ends, in any way: a supervisor
    /// or a remote shell. Without it the machine is unattended.
    ///
    /// Linux alone (5.3 or later); elsewhere [`run`](Self::run) reports a shortfall of the system.
    /// Costs a thread that sleeps.
    pub fn emergency_at_parents_death(&mut self) -> &mut Self {
        self.plan.settings().parents_death = true;
        self
    }

    /// Starts `guardian` with the system: a program of its own that brings the machine to safety if
    /// this one is killed. See [`Guardian`].
    pub fn guardian(&mut self, guardian: Guardian) -> &mut Self {
        self.plan.settings().guardian = Some(guardian);
        self
    }
}
