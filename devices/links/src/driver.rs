//! Drivers that block in system calls, such as those for `embedded-hal`: each on a thread of its
//! own, behind a call channel.
//!
//! [`driver`] takes a driver, and a function that answers requests with it. Processes call it over
//! a [call channel](luna::channel::call_channel) without blocking their executor; only the driver's
//! thread waits for the bus. So any driver crate for `embedded-hal` is a link driver of LUNA:
//!
//! ```
//! use luna::devices::Sharing;
//! use luna::prelude::*;
//! use luna_links::driver::driver;
//! # struct Thermometer;
//! # impl Thermometer { fn read_celsius(&mut self) -> Result<f32, std::io::Error> { Ok(21.5) } }
//!
//! let mut system = System::new("oven");
//! // With an I2C bus: `i2c::open(...)`, and the crate's driver made with `I2c::new(&bus)`.
//! let bus = system.devices().open("bus", "bus", Sharing::Shared, || Ok(()))?;
//! let (thermometer, calls) = luna::channel::call_channel::<(), f32>();
//! let link = driver(&bus, Thermometer, calls, |sensor, ()| {
//!     sensor.read_celsius().map_err(luna::Error::other)
//! });
//! let counts = link.counts();
//! let main = system.executor("main").build()?;
//! main.process("thermometer").spawn(link)?;
//! main.process("controller").spawn(async move {
//!     assert_eq!(thermometer.call(()).await?, 21.5);
//!     Ok(())
//! })?;
//! system.run()?;
//! assert_eq!(counts.records(), 1);
//! # Ok::<(), luna::Error>(())
//! ```

use crate::Counts;
use crate::end::Lose;
use luna::channel::Server;
use luna::devices::Device;
use luna::external::LinkError;
use luna::{Buffer, Error, Policy, Process, Receiver, Sender};
use luna_machine::signals;
use luna_platform::clock::{Clock, Instant};
use luna_platform::thread::{self, Attributes, Thread};
use std::convert::Infallible;
use std::fmt;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

/// Creates a process that answers calls with a driver, on a thread of the driver's own.
///
/// `serve` may block. Its errors are [counted](Counts::bad), and a call that meets one ends as
/// [unanswered](luna::channel::CallError::Unanswered); after [some in a
/// row](Driver::errors_before_loss) the device is lost. If callers are to see errors, make them
/// part of the answer.
///
/// The time of each transaction is measured ([`Counts::longest`], [`Counts::late`]), and one
/// without end makes the device [lost](Driver::lost_after) while it hangs: nothing waits longer.
/// `device` is what the driver uses; if it has a handle of its own, that goes with it to the
/// thread.
///
/// On a virtual clock the system does not start.
///
/// The link ends without an error when the last client is gone. Cancel-safe: a transaction in
/// progress runs to its end on the driver's thread, and its answer is dropped. Real-time path: a
/// call takes two hand-overs between threads beside the transaction itself, and allocates nothing
/// here.
pub fn driver<X, D, Q, A>(
    device: &Device<X>,
    driver: D,
    calls: Server<Q, A>,
    serve: impl FnMut(&mut D, Q) -> luna::Result<A> + Send + 'static,
) -> Driver<D, Q, A>
where
    X: Send + Sync + 'static,
    D: Send + 'static,
    Q: Send + 'static,
    A: Send + 'static,
{
    let (jobs, taken) = luna::channel();
    let (done, answers) = luna::buffered(Buffer::fifo(1));
    let (is_safe, safe) = luna::buffered(Buffer::fifo(1));
    Driver {
        name: device.name().to_owned(),
        policy: Policy::Other,
        core: None,
        late_after: Duration::from_millis(10),
        lost_after: Duration::from_secs(1),
        most_errors: 3,
        counts: Counts::default(),
        device: Some(Box::new(device.clone())),
        calls: Some(calls.external()),
        jobs: jobs.external(),
        answers: Answers::external(answers),
        safe: Some(Receiver::external(safe)),
        work: Some(Work {
            driver,
            serve: Box::new(serve),
            make_safe: None,
            jobs: Receiver::external(taken),
            done: Some(done.external()),
            is_safe: is_safe.external(),
        }),
        thread: None,
    }
}

/// Made by [`driver`]: a link to be spawned.
#[must_use = "a link is a process: spawn it"]
pub struct Driver<D, Q, A> {
    name: String,
    policy: Policy,
    core: Option<usize>,
    late_after: Duration,
    lost_after: Duration,
    most_errors: u32,
    counts: Counts,
    device: Option<Box<dyn Lose>>,
    calls: Option<Server<Q, A>>,
    jobs: Sender<Job<Q>>,
    answers: Answers<A>,
    /// Reports to the emergency function whether the device was brought to safety.
    safe: Option<Receiver<bool>>,
    /// Until the thread has it.
    work: Option<Work<D, Q, A>>,
    thread: Option<Thread<()>>,
}

type Answers<A> = Receiver<luna::Result<A>>;
type Serve<D, Q, A> = Box<dyn FnMut(&mut D, Q) -> luna::Result<A> + Send>;
type MakeSafe<D> = Box<dyn FnMut(&mut D) + Send>;

enum Job<Q> {
    Serve(Q),
    MakeSafe,
    End,
}

/// What the thread does.
struct Work<D, Q, A> {
    driver: D,
    serve: Serve<D, Q, A>,
    make_safe: Option<MakeSafe<D>>,
    jobs: Receiver<Job<Q>>,
    /// None after a panic of `serve`: that ends the link, and the driver stays for its emergency
    /// function.
    done: Option<Sender<luna::Result<A>>>,
    /// Whether the emergency function has ended; none before.
    is_safe: Sender<bool>,
}

impl<D: Send + 'static, Q: Send + 'static, A: Send + 'static> Driver<D, Q, A> {
    /// The policy of the driver's thread; without this it has no priority.
    pub fn policy(mut self, policy: Policy) -> Self {
        self.policy = policy;
        self
    }

    /// The core of the driver's thread; any if not stated.
    pub fn core(mut self, core: usize) -> Self {
        self.core = Some(core);
        self
    }

    /// Counts a transaction as late that took longer; 10 ms if not stated.
    pub fn late_after(mut self, time: Duration) -> Self {
        self.late_after = time;
        self
    }

    /// The limit of a transaction; default 1 s. Beyond it the device is lost, even while the
    /// transaction hangs, and the thread is detached.
    pub fn lost_after(mut self, time: Duration) -> Self {
        self.lost_after = time;
        self
    }

    /// The device is lost after this many failed transactions in a row; default 3, and 0 counts as
    /// 1.
    pub fn errors_before_loss(mut self, errors: u32) -> Self {
        self.most_errors = errors;
        self
    }

    /// What the driver does in an emergency. It runs on the driver's thread, after the transaction
    /// in progress, and no call is answered from then on. The emergency thread waits for it to
    /// begin, and to end, at most the time of [`lost_after`](Self::lost_after) each: set that
    /// before. It also runs after a panic in a transaction, with the driver as the panic left it.
    ///
    /// The report marks it as [panicked](luna::report::FunctionOutcome::Panicked), so that a
    /// guardian acts, if it cannot be done: a transaction hangs; `make_safe` panics (as it should
    /// if it fails) or takes too long; the link does not run yet; or it has ended before the
    /// emergency while the device is still open elsewhere.
    ///
    /// # Errors
    ///
    /// As for [`Device::on_emergency`].
    ///
    /// # Panics
    ///
    /// When called twice.
    pub fn on_emergency(
        mut self,
        make_safe: impl FnMut(&mut D) + Send + 'static,
    ) -> luna::Result<Self> {
        let safe = self
            .safe
            .take()
            .expect("a driver has one emergency function");
        let (jobs, limit) = (self.jobs.clone(), self.lost_after);
        if let (Some(device), Some(work)) = (&self.device, &mut self.work) {
            work.make_safe = Some(Box::new(make_safe));
            let name = self.name.clone();
            let function = move || {
                let asked = jobs.blocking_send_timeout(Job::MakeSafe, limit);
                if asked.as_ref().is_err_and(|error| error.is_timeout()) {
                    panic!("the driver of `{name}` hangs: it was not brought to safety");
                }
                match safe.blocking_recv_timeout(limit) {
                    Ok(true) => {}
                    Ok(false) => panic!("the driver of `{name}` failed to bring it to safety"),
                    Err(error) if error.is_timeout() => {
                        panic!("the driver of `{name}` takes too long to bring it to safety")
                    }
                    Err(_) => {
                        panic!("the driver of `{name}` has ended: it was not brought to safety")
                    }
                }
            };
            // Both waits, and a little for what it does in between.
            device.on_emergency("driver", limit * 3, Box::new(function))?;
        }
        Ok(self)
    }

    /// What it counts.
    pub fn counts(&self) -> Counts {
        self.counts.clone()
    }
}

impl<D: Send + 'static, Q: Send + 'static, A: Send + 'static> Process for Driver<D, Q, A> {
    /// Starts the driver's thread. Refused attributes are reported on standard error.
    ///
    /// # Errors
    ///
    /// No thread can be created, or its policy or core is invalid. The system runs on a virtual
    /// clock: a bus takes real time, and virtual time would exceed every limit meanwhile.
    fn pre_run(&mut self) -> luna::Result<()> {
        if Clock::is_virtual_here() {
            return Err(Error::other(format!(
                "the driver of `{}` takes real time, which a virtual clock does not wait for: simulate the device instead",
                self.name
            )));
        }
        let Some(work) = self.work.take() else {
            return Err(LinkError::NotPrepared.into());
        };
        let mut attributes = Attributes::new(self.name.as_str()).policy(self.policy);
        if let Some(core) = self.core {
            attributes = attributes.core(core);
        }
        let (counts, late_after) = (self.counts.clone(), self.late_after);
        let thread = thread::spawn(
            attributes,
            |_| Ok::<_, Infallible>(()),
            move |()| work.run(&counts, late_after),
        )
        .map_err(Error::other)?;
        for shortfall in &thread.obtained().refusals {
            notice(format_args!("the driver of `{}`: {shortfall}", self.name));
        }
        self.thread = Some(thread);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        let (Some(calls), Some(device)) = (self.calls.take(), &self.device) else {
            return Err(LinkError::NotPrepared.into());
        };
        let limit = self.lost_after;
        let silent = || device.lost(LinkError::Silent { limit }.into());
        let panicked = || device.lost(Error::Panicked("the driver's thread".to_owned()));
        let mut errors = 0;
        loop {
            let (request, reply) = match calls.accept().await {
                Ok(call) => call.into_parts(),
                Err(error) if error.is_closed() => return Ok(()),
                Err(error) => return Err(error.into()),
            };
            let deadline = luna::now() + limit;
            let job = Job::Serve(request);
            match self.jobs.send_deadline(job, deadline).await {
                Ok(()) => {}
                Err(error) if error.is_timeout() => return Err(silent()),
                Err(_) => return Err(panicked()),
            }
            match self.answers.recv_deadline(deadline).await {
                Ok(Ok(answer)) => {
                    errors = 0;
                    // The client is gone.
                    drop(reply.send(answer));
                }
                Ok(Err(error)) => {
                    drop(reply);
                    self.counts.one_bad();
                    errors += 1;
                    if errors >= self.most_errors {
                        return Err(device.lost(error));
                    }
                }
                Err(error) if error.is_timeout() => return Err(silent()),
                Err(_) => return Err(panicked()),
            }
        }
    }

    /// Ends the thread. One that still hangs after [`lost_after`](Self::lost_after) is detached,
    /// with a message on standard error.
    fn post_run(&mut self) {
        self.calls = None;
        if let Some(thread) = self.thread.take() {
            let requested = self.jobs.blocking_send_timeout(Job::End, self.lost_after);
            if requested.as_ref().is_err_and(|error| error.is_timeout()) {
                notice(format_args!(
                    "the driver of `{}` hangs in a transaction; its thread is detached, and its device stays open",
                    self.name
                ));
            } else {
                // Its panic was reported by the hook.
                let _ = thread.join();
            }
        }
        self.work = None;
        self.device = None;
    }
}

impl<D, Q: Send, A: Send> Work<D, Q, A> {
    fn run(mut self, counts: &Counts, late_after: Duration) {
        let mut is_safe = false;
        while let Ok(job) = self.jobs.blocking_recv() {
            match job {
                Job::Serve(_) if self.done.is_none() => {}
                Job::Serve(request) => {
                    let answer = if is_safe {
                        Err(Error::other("its driver has brought it to safety"))
                    } else {
                        let begin = Instant::now_real();
                        let served = catch_unwind(AssertUnwindSafe(|| {
                            (self.serve)(&mut self.driver, request)
                        }));
                        counts.took(Instant::now_real() - begin, late_after);
                        let Ok(answer) = served else {
                            // The hook has reported it; the link notices that no more answers come.
                            self.done = None;
                            continue;
                        };
                        answer
                    };
                    if let Some(done) = &self.done {
                        // There is room: the next request follows the last answer. If the link has
                        // ended, `jobs` is closed.
                        let _ = done.try_send(answer);
                    }
                }
                Job::MakeSafe => {
                    if !std::mem::replace(&mut is_safe, true) {
                        self.make_safe();
                    }
                }
                Job::End => return,
            }
        }
    }

    fn make_safe(&mut self) {
        if let Some(make_safe) = &mut self.make_safe {
            let made = catch_unwind(AssertUnwindSafe(|| make_safe(&mut self.driver)));
            // There is room: it is sent once.
            let _ = self.is_safe.try_send(made.is_ok());
        }
    }
}

luna_platform::debug_fields!(
    impl[D, Q, A] Driver<D, Q, A>, |driver|
    name: driver.name,
    late_after: driver.late_after,
    lost_after: driver.lost_after,
    counts: driver.counts
);

/// Writes a line to standard error, which may be a pipe without a reader or a file at its limit: a
/// machine does not end by that.
fn notice(line: fmt::Arguments<'_>) {
    let line = format!("luna: {line}\n");
    let _ = signals::without_write_signals(|| std::io::stderr().write_all(line.as_bytes()));
}
