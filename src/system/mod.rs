//! The system: which processes there are, where each runs, and their common start and end.
//!
//! [`System`], [`Executor`] and [`Policy`] are at the crate's root too. Here are also what builds
//! and observes a system, and its clocks.
//!
//! ```
//! use luna::prelude::*;
//! use luna::system::{ClockKind, Executor, ProcessBuilder, Thread};
//!
//! let mut system = System::new("arm");
//! let control: Executor = system.executor("control").policy(Policy::fifo(80)).build()?;
//! let process: ProcessBuilder = control.process("controller").priority(20);
//! process.spawn(async { Ok(()) })?;
//! let console: Thread = system.thread("console");
//! console.process("operator").spawn(async { Ok(()) })?;
//! assert_eq!(system.run()?.clock, ClockKind::Real);
//! # Ok::<(), luna::Error>(())
//! ```

pub(crate) mod announcement;
pub(crate) mod builder;
mod clock;
mod compose;
mod conclusion;
pub(crate) mod deadlock;
mod deployment;
mod launch;
mod neighbours;
pub(crate) mod plan;
mod quiescence;
mod reaper;
mod register;
mod safety;
mod stand_in;
mod stolen;
mod supervise;
mod system_threads;
mod warnings;

pub use builder::{Executor, ExecutorBuilder, ProcessBuilder, Thread};
pub use clock::ClockKind;
pub use compose::Observer;
pub use luna_core::{ClockDriver, DriveError};
pub use luna_platform::thread::{AttributeError, Policy, PolicyError};

use crate::csp::composition::Composition;
use crate::csp::process::IntoProcess;
use crate::error::{Result, SetupError};
use crate::report::Report;
use crate::time::{TimerManager, Timers};
pub(crate) use launch::Opening;
use luna_core::ProcessHandle;
use luna_core::current::ProcessId;
pub(crate) use plan::{Member, Plan};
use std::sync::Arc;

/// A machine's software: executors and OS threads, the processes on them, and what to do in an
/// emergency.
///
/// First the system is described: [`executor`](Self::executor) and [`thread`](Self::thread) define
/// where processes can run, and their `process(..).spawn(..)` which processes run there. Then
/// [`run`](Self::run) starts all of it together and returns when it has ended.
///
/// Best effort is the default: if the operating system refuses something (a policy without the
/// privilege, say), the system runs without it and reports that once on standard error and in the
/// report. [`strict`](Self::strict) refuses to start instead.
///
/// ```
/// use luna::prelude::*;
///
/// let mut system = System::new("greeter");
/// let main = system.executor("main").build()?;
/// main.process("hello").spawn(async {
///     println!("hello");
///     Ok(())
/// })?;
/// let report = system.run()?;
/// assert_eq!(report.processes[0].name, "hello");
/// # Ok::<(), luna::Error>(())
/// ```
pub struct System {
    pub(crate) plan: Arc<Plan>,
}

impl System {
    /// An empty system called `name`.
    pub fn new(name: &str) -> System {
        System {
            plan: Plan::new(name),
        }
    }

    /// Refuses to start, with an error, if anything that was asked for cannot be had: policies,
    /// cores, locked memory. And a deadlock is an emergency that ends the system with
    /// [`Error::Deadlock`](crate::Error::Deadlock), as it always is on a virtual clock; otherwise
    /// it is only reported.
    pub fn strict(&mut self) -> &mut Self {
        self.plan.settings().strict = true;
        self
    }

    /// Keeps all memory of the program in memory while the system runs (`mlockall`), and touches
    /// stacks and heap before the start, so that no page fault makes a process wait. Needs
    /// CAP_IPC_LOCK or an unlimited limit.
    pub fn lock_memory(&mut self) -> &mut Self {
        self.plan.settings().lock_memory = true;
        self
    }

    /// Reserves room for the statistics of `loops` periodic loops, about 50 KiB each, before the
    /// start: one reserve for the whole system, which any of its processes takes from. Without it
    /// there is room for 16 loops (0.8 MiB), however many processes there are. Loops that have
    /// ended count: their statistics are kept for the report.
    ///
    /// One loop more is an error where it begins
    /// ([`SetupError::TooManyLoops`]). The others go on.
    pub fn max_loops(&mut self, loops: usize) -> &mut Self {
        self.plan.settings().max_loops = Some(loops);
        self
    }

    /// Sets what wakes the loops at their slots: their executors, which is the default, or the
    /// timer manager. The loops' code is the same.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna::time::Timers;
    /// use std::time::Duration;
    ///
    /// let mut system = System::new("two cores");
    /// system.timers(Timers::Manager);
    /// let period = Duration::from_millis(1);
    /// for name in ["left", "right"] {
    ///     system.thread(name).process(name).spawn(async move {
    ///         let mut tick = luna::periodic(name, period)?;
    ///         for _ in 0..5 {
    ///             tick.next().await;
    ///         }
    ///         Ok(())
    ///     })?;
    /// }
    /// let report = system.run()?;
    /// assert!(report.timers.unwrap().woken > 0);
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn timers(&mut self, timers: Timers) -> &mut Self {
        let mut settings = self.plan.settings();
        match timers {
            Timers::Executor => settings.manager = None,
            // One that callbacks were made with stays.
            Timers::Manager => drop(settings.manager.get_or_insert_default()),
        }
        drop(settings);
        self
    }

    /// The timer manager, for callbacks. Also for a process, which takes it along.
    ///
    /// # Errors
    ///
    /// [`SetupError::NoTimerManager`]: the system has none, or
    /// has been started.
    pub fn timer_manager(&self) -> Result<TimerManager> {
        let manager = self.plan.settings().manager.clone();
        let none = || SetupError::NoTimerManager {
            system: self.plan.name().to_owned(),
        };
        let manager = manager.ok_or_else(none);
        let manager = manager.inspect_err(|_| self.plan.note_refusal())?;
        Ok(TimerManager::new(manager))
    }

    /// Pins the timer manager's thread to `core`; to none if not stated. If all loops of the
    /// manager are on one core, that core is best: then one core is woken for a tick, and not two
    /// (`docs/time-sources.md`). Where it cannot be had that is a
    /// [`Shortfall`](crate::report::Shortfall).
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna::time::Timers;
    ///
    /// let mut system = System::new("one core");
    /// system.timers(Timers::Manager).timer_core(0);
    /// let main = system.executor("main").core(0).build()?;
    /// main.process("one").spawn(async { Ok(()) })?;
    /// system.run()?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn timer_core(&mut self, core: usize) -> &mut Self {
        self.plan.settings().timer_core = Some(core);
        self
    }

    /// Reserves room for `callbacks` callbacks of the timer manager, including those that are made
    /// before the start; 64 if not stated.
    pub fn max_timers(&mut self, callbacks: usize) -> &mut Self {
        self.plan.settings().max_timers = Some(callbacks);
        self
    }

    /// Sets how many ended processes are remembered, of those that were spawned on an executor
    /// while the system ran: those that ended last. Of the others the report gives
    /// [numbers](crate::report::EarlierProcesses), no [handle](Self::process_handle) is available
    /// any more, and their names may be given again. 1024 if not stated; processes that were
    /// spawned before the run, or have a thread of their own, are always remembered.
    ///
    /// So a system that starts and ends processes without end does not grow.
    pub fn remember_ended(&mut self, processes: usize) -> &mut Self {
        self.plan.settings().remembered = Some(processes);
        self
    }

    /// An executor to be: one OS thread that runs many processes by priority.
    pub fn executor(&mut self, name: impl AsRef<str>) -> ExecutorBuilder {
        ExecutorBuilder::new(self.plan.clone(), name.as_ref())
    }

    /// An OS thread to be, for one process alone, which may make blocking calls.
    pub fn thread(&mut self, name: impl AsRef<str>) -> Thread {
        self.plan.enter_thread(name.as_ref());
        Thread::new(self.plan.clone(), name.as_ref())
    }

    /// Lets `body` stand in for the process called `process`, with the channel ends of that
    /// process.
    ///
    /// For a part of the machine that is not there, or not to be used: a sensor that replays a
    /// recording, an algorithm that is still to be written. The process must be declared by
    /// [`replaceable`](ProcessBuilder::replaceable), and that after this call: so the set-up first
    /// names the replaced processes, and then builds the same network as ever. The stand-in runs
    /// where the process would, with its name and priority. The [report](Report::stand_ins) names
    /// it.
    ///
    /// `body` takes the same ends and gives anything that can be spawned. That the channels fit
    /// means that the ends are of one type, which is compared when the process is declared.
    ///
    /// # Errors
    ///
    /// [`SetupError::StandInTooLate`] if the process is there already, and
    /// [`DuplicateName`](crate::error::SetupError::DuplicateName) if it has a stand-in. Those that
    /// come later: `replaceable` fails if the ends are of other types, `spawn` if the process is
    /// declared without its ends, and [`run`](Self::run) if no process of that name was declared.
    ///
    /// ```
    /// use luna::prelude::*;
    ///
    /// struct Gyroscope { rates: Sender<f64> }
    ///
    /// /// The network, as it always is.
    /// fn build(system: &mut System) -> luna::Result<()> {
    ///     let main = system.executor("main").build()?;
    ///     let (rates, measured) = luna::channel();
    ///     main.process("gyroscope").replaceable(Gyroscope { rates }, |_ends| async {
    ///         Err(luna::Error::other("there is no gyroscope here"))
    ///     })?;
    ///     main.process("controller").spawn(async move {
    ///         assert_eq!(measured.recv().await?, 0.1);
    ///         Ok(())
    ///     })?;
    ///     Ok(())
    /// }
    ///
    /// let mut system = System::new("drone");
    /// system.stand_in("gyroscope", |ends: Gyroscope| async move {
    ///     ends.rates.send(0.1).await?;
    ///     Ok(())
    /// })?;
    /// build(&mut system)?;
    /// assert_eq!(system.run()?.stand_ins, ["gyroscope"]);
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn stand_in<E: Send + 'static, M, P: IntoProcess<M>>(
        &mut self,
        process: &str,
        body: impl FnOnce(E) -> P + Send + 'static,
    ) -> Result<&mut Self> {
        let added = self.plan.stand_ins().add(process, body);
        added.inspect_err(|_| self.plan.note_refusal())?;
        Ok(self)
    }

    /// Records the [signals](crate::Signal) and [messages](crate::log::message()) of the system in
    /// a new file at `path`, from the start to the end. If one is there it stays: this recording
    /// goes to the first free of `run-2.luna`, `run-3.luna` and so on, which a line on standard
    /// error and the report name, unless [`replace_recordings`](Self::replace_recordings) was
    /// called. `luna convert` makes CSV, MCAP and Perfetto traces of it. What is recorded, and what
    /// was lost, stands in [`Report::logging`](crate::Report::logging).
    ///
    /// An ordinary thread writes the file. The processes write to rings of their threads, which is
    /// wait-free; a ring that is full drops what is new, and counts it.
    ///
    /// Where the program does not ask for it, the environment may: `LUNA_LOG=run.luna` records to
    /// that file, `LUNA_LOG=tcp://HOST:PORT` (or `udp://`) to `luna record` on another computer.
    /// `LUNA_SCOPE=1`, or the address to listen on, shows the run in the browser, also beside a
    /// recording (feature `scope`).
    ///
    /// ```
    /// use luna::prelude::*;
    ///
    /// struct Pump { flow: Option<Signal<f32>> }
    ///
    /// impl Process for Pump {
    ///     fn pre_run(&mut self) -> luna::Result<()> {
    ///         self.flow = Some(Signal::with_unit("pump/flow", "l/s").register()?);
    ///         Ok(())
    ///     }
    ///
    ///     async fn run(&mut self) -> luna::Result<()> {
    ///         if let Some(flow) = &self.flow {
    ///             flow.record(2.5);
    ///         }
    ///         Ok(())
    ///     }
    /// }
    ///
    /// let file = std::env::temp_dir().join(format!("luna-pump-{}.luna", std::process::id()));
    /// let mut system = System::new("pump");
    /// system.log_to(&file);
    /// let main = system.executor("main").build()?;
    /// main.process("pump").spawn(Pump { flow: None })?;
    /// let recording = system.run()?.logging.unwrap();
    /// assert_eq!((recording.signals[0].recorded, recording.signals[0].lost), (1, 0));
    /// # std::fs::remove_file(file).unwrap();
    /// # Ok::<(), luna::Error>(())
    /// ```
    #[cfg(feature = "logger")]
    pub fn log_to(&mut self, path: impl Into<std::path::PathBuf>) -> &mut Self {
        self.log(crate::log::Logging::to_file(path))
    }

    /// As [`log_to`](Self::log_to), with the rooms, the rate and the sink of `recording`.
    ///
    /// ```
    /// use luna::log::{Level, Logging, WriterSink};
    /// use luna::prelude::*;
    ///
    /// let mut system = System::new("pump");
    /// let sink = WriterSink::new(std::io::sink());
    /// system.log(Logging::to_sink(sink).room_for_samples(1000).show_messages(Level::Warn));
    /// let main = system.executor("main").build()?;
    /// main.process("pump").spawn(async {
    ///     luna::log::message(Level::Info, "pump", format_args!("primed after {} s", 3));
    ///     Ok(())
    /// })?;
    /// assert_eq!(system.run()?.logging.unwrap().messages.recorded, 1);
    /// # Ok::<(), luna::Error>(())
    /// ```
    ///
    /// With the feature `events`, `recording.events()` records CSP events too: `docs/events.md` has
    /// what they are.
    ///
    #[cfg_attr(feature = "events", doc = "```")]
    #[cfg_attr(not(feature = "events"), doc = "```ignore")]
    /// use luna::log::{Logging, WriterSink};
    /// use luna::prelude::*;
    ///
    /// let mut system = System::new("pair");
    /// system.log(Logging::to_sink(WriterSink::new(std::io::sink())).events());
    /// let (output, input) = luna::channel();
    /// let main = system.executor("main").build()?;
    /// main.process("source").spawn(async move { Ok(output.send(1).await?) })?;
    /// main.process("sink").spawn(async move { Ok(drop(input.recv().await?)) })?;
    /// let events = system.run()?.logging.unwrap().events;
    /// assert!(events.recorded > 0 && events.lost == 0);
    /// # Ok::<(), luna::Error>(())
    /// ```
    #[cfg(feature = "logger")]
    pub fn log(&mut self, recording: crate::log::Logging) -> &mut Self {
        self.plan.settings().logging = Some(recording);
        self
    }

    /// Lets other programs find the system while it runs: `luna list` shows it, with its executors
    /// and what it can be reached at. So does
    /// [`announced_systems`](crate::inspect::announced_systems).
    ///
    /// The thread that runs the system writes a small file to the folder of shared memory before
    /// the bodies are released, and removes it at the end. It costs the processes nothing. If the
    /// file cannot be had, that is a line on standard error, and the system runs.
    ///
    /// Where the program does not ask for it, the environment may: `LUNA_ANNOUNCE=1`.
    ///
    /// ```
    /// use luna::prelude::*;
    ///
    /// let mut system = System::new("feeder");
    /// system.announce();
    /// let main = system.executor("main").build()?;
    /// main.process("feeder").spawn(async { Ok(()) })?;
    /// system.run()?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn announce(&mut self) -> &mut Self {
        self.plan.settings().announced.get_or_insert_default();
        self
    }

    /// [Announces](Self::announce) the system, with an address at which it can be reached: what it
    /// is, such as `scope`, and how it is written.
    pub fn announce_address(&mut self, what: &str, address: &str) -> &mut Self {
        let mut settings = self.plan.settings();
        let addresses = settings.announced.get_or_insert_default();
        addresses.push((what.to_owned(), address.to_owned()));
        drop(settings);
        self
    }

    /// Opens devices: each once, by name, shared by its users, and closed when the last of them has
    /// finished. See [`devices`](crate::devices).
    ///
    /// ```
    /// use luna::devices::{Node, Sharing};
    /// use luna::prelude::*;
    ///
    /// const CLOCK: Node = Node::new("clock");
    /// let system = System::new("machine");
    /// let opened = system.devices().open("/dev/rtc9", CLOCK.kind(), Sharing::Exclusive, || CLOCK.open("/dev/rtc9".as_ref(), true));
    /// assert_eq!(opened.unwrap_err().to_string(), "there is no clock `/dev/rtc9`: plug it in, load its driver, or correct the name");
    /// ```
    #[cfg(unix)]
    pub fn devices(&self) -> crate::devices::DeviceManager {
        crate::devices::DeviceManager::new(self.plan.devices.clone())
    }

    /// The report of the run that has ended, also when it ended in an error.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna::End;
    ///
    /// let mut system = System::new("fails");
    /// let main = system.executor("main").build()?;
    /// main.process("drive").spawn(async { Err(luna::Error::other("no encoder")) })?;
    /// let error = system.run().unwrap_err();
    /// assert_eq!(error.to_string(), "process `drive`: no encoder");
    /// assert_eq!(system.report().unwrap().end, End::Completed);
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn report(&self) -> Option<Report> {
        self.plan.members().report.clone()
    }

    /// A spawned process, to look at and to cancel, from when the system runs. Not for the
    /// real-time path: it takes the plan's plain lock, so a process asks for its handles before its
    /// loop. Also from [`Executor::process_handle`]. None for one that has ended and is not
    /// [remembered](Self::remember_ended); a handle that was had before stays.
    pub fn process_handle(&self, id: ProcessId) -> Option<ProcessHandle> {
        self.plan.members().started.handle(id)
    }

    /// What the system is made of at this moment: a tree of threads, processes and named
    /// sub-processes, and the channels between them.
    ///
    /// Before [`run`](Self::run) it shows what was requested, then what was obtained. Since `run`
    /// keeps this thread busy, another one uses an [`observer`](Self::observer). Not for the
    /// real-time path: it allocates, and takes plain locks; each process' named sub-processes are
    /// read in pieces of a few at a time.
    ///
    /// ```
    /// use luna::prelude::*;
    ///
    /// let mut system = System::new("greeter");
    /// let main = system.executor("main").build()?;
    /// main.process("hello").priority(20).spawn(async { Ok(()) })?;
    /// let composition = system.composition();
    /// assert_eq!(composition.threads[0].processes[0].name, "hello");
    /// println!("{composition}");
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn composition(&self) -> Composition {
        self.observer().composition()
    }

    /// A handle to look at the system with while it runs, for another thread or for a process of
    /// it. Cloning it is cheap.
    pub fn observer(&self) -> Observer {
        Observer::new(self.plan.clone())
    }

    /// Runs the system: returns when all processes have ended, and `post_run` of each, and all
    /// threads.
    ///
    /// In this order: memory is locked and the threads are made, with their attributes; every
    /// process' `pre_run` runs; then all bodies are released. While they run this thread sleeps,
    /// runs `post_run` of those that end, and frees what they leave.
    ///
    /// SIGINT, SIGTERM and SIGHUP run the functions of [`on_emergency`](Self::on_emergency), then
    /// cancel all processes; the report is returned as usual, and names the signal. A second signal
    /// ends the program at once. A process that does not end within two seconds then is left
    /// behind. A signal that comes when all has ended is the report's
    /// [`late_signal`](Report::late_signal). This thread blocks those three and SIGQUIT as soon as
    /// the emergency manager's threads are there, before it opens any file, so that those take them
    /// at once; SIGHUP and SIGQUIT only if the program neither handles nor ignores them.
    ///
    /// # Errors
    ///
    /// A process whose body returns [`Error::Closed`](crate::Error::Closed) has ended in order, and
    /// is no error: its partners have ended ([`Report::ended_at`] names the channels). With any
    /// error of a run on the machine's clock, the report is printed on standard error, and
    /// [`report`](Self::report) returns it.
    ///
    /// A [`SetupError`] if the system cannot be started (also if a signal comes while a file does
    /// not answer: [`StartInterrupted`](SetupError::StartInterrupted)), is inside a process, or has
    /// been run before; the first error of a `pre_run`, with its process' name; then
    /// [`report`](Self::report) returns the report. A panic or else the first error of a process,
    /// in the order of spawning, when all have ended: when a process fails the others go on. The
    /// returned error is not printed here too, unless the system goes on for a second without the
    /// process: then it is printed on standard error while the system runs. The errors of the other
    /// processes that have failed are printed at the end. Else a panic in a
    /// [`post_run`](crate::Process::post_run), also behind a signal.
    /// [`Error::Deadlock`](crate::Error::Deadlock) if every process waits for another, and the
    /// system is [`strict`](Self::strict) or its clock is virtual.
    pub fn run(&self) -> Result<Report> {
        supervise::run(&self.plan).inspect_err(|_| self.plan.note_refusal())
    }
}

/// A system that was never run is over: what was described is dropped, also if a body or a function
/// holds an [`Executor`] of it. Any remaining handle of it can spawn nothing more.
///
/// If processes were spawned, a line on standard error reports that none of them has run. There is
/// none while the thread panics, and none after a call of the set-up, or `run`, has returned an
/// error: the program ends because of that.
impl Drop for System {
    fn drop(&mut self) {
        self.plan.abandon();
    }
}

luna_platform::debug_fields!(System, |system| name: system.plan.name());
