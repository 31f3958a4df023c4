//! The manager's thread.

use super::{Engine, Manager};
use crate::error::{Error, Result};
use crate::safety::Emergency;
use crate::time::short;
use luna_core::current;
use luna_core::timer_queue::Due;
use luna_platform::clock::Instant;
use luna_platform::lock::PiLock;
use luna_platform::thread::{self, Attributes, Policy, Refusal, Thread};
use std::convert::Infallible;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// The thread, as the system sees it. Dropping it ends it.
pub(crate) struct ManagerThread {
    shared: Arc<Shared>,
    thread: Option<Thread<()>>,
}

struct Shared {
    manager: Arc<Manager>,
    emergency: Arc<Emergency>,
    is_to_end: AtomicBool,
    /// How many wake-ups it made.
    woken: AtomicU64,
    /// The first panic of a callback.
    panic: PiLock<Option<Error>>,
}

impl ManagerThread {
    /// Starts the thread, with room for `loops` loops.
    pub(crate) fn start(
        manager: Arc<Manager>,
        emergency: Arc<Emergency>,
        most_loops: usize,
        attributes: Attributes,
    ) -> Result<Self> {
        let shared = Arc::new(Shared {
            manager,
            emergency,
            is_to_end: AtomicBool::new(false),
            woken: AtomicU64::new(0),
            panic: PiLock::new(None),
        });
        let own = shared.clone();
        let most_calls = shared.manager.callbacks.room();
        let thread = thread::spawn(
            attributes,
            move |_| Ok::<_, Infallible>(Due::with_room_for(most_loops, most_calls)),
            move |mut due| {
                if let Some(engine) = own.manager.engine.get() {
                    own.keep_time(engine, &mut due);
                }
            },
        )
        .map_err(|error| Error::not_started("the timer manager", error))?;
        Ok(Self {
            shared,
            thread: Some(thread),
        })
    }

    /// What the thread was refused.
    pub(crate) fn shortfalls(&self) -> &[Refusal] {
        self.thread
            .as_ref()
            .map_or(&[], |thread| &thread.obtained().refusals)
    }

    /// Ends the thread; gives what it did, and the first panic of a callback.
    pub(crate) fn stop(mut self) -> (TimersReport, Option<Error>) {
        let policy = self.thread.as_ref().map(|thread| thread.obtained().policy);
        self.join();
        let shared = &self.shared;
        let (callbacks, earlier_callbacks) = shared.manager.callbacks.reports();
        let engine = shared.manager.engine.get();
        let report = TimersReport {
            policy: policy.unwrap_or_default(),
            latest: engine.map_or(Duration::ZERO, |engine| {
                Duration::from_nanos(engine.latest.load(Ordering::Relaxed))
            }),
            woken: shared.woken.load(Ordering::Relaxed),
            callbacks,
            earlier_callbacks,
        };
        (report, shared.panic.lock().take())
    }

    fn join(&mut self) {
        let Some(thread) = self.thread.take() else {
            return;
        };
        self.shared.is_to_end.store(true, Ordering::Release);
        let manager = &self.shared.manager;
        if let Some(engine) = manager.engine.get() {
            engine.queue.ask_look_now();
        }
        // A callback's panic is caught; the thread's own was reported by the panic hook.
        let _ = thread.join();
        manager.callbacks.end();
    }
}

impl Drop for ManagerThread {
    fn drop(&mut self) {
        self.join();
    }
}

/// The end of the thread's life, however it comes.
struct End<'a> {
    shared: &'a Shared,
    engine: &'a Engine,
}

impl Drop for End<'_> {
    fn drop(&mut self) {
        current::set_on_path(false);
        // A loop that still waits takes the deadlines of its own thread.
        self.engine.queue.close();
        if std::thread::panicking() {
            // A fault of the framework: the manager the system asked for does not keep time any
            // more.
            self.shared.emergency.trigger_by_panic();
        }
    }
}

impl Shared {
    /// The life of the thread.
    fn keep_time(&self, engine: &Engine, due: &mut Due) {
        let _end = End {
            shared: self,
            engine,
        };
        // For the panic hook.
        self.emergency.enter_thread();
        // A thread's first lock asks the kernel for its number: not on the path.
        drop(self.panic.lock());
        current::set_on_path(true);
        while !self.is_to_end.load(Ordering::Acquire) {
            engine
                .nap
                .0
                .sleep(|| match self.is_to_end.load(Ordering::Acquire) {
                    true => Instant::from_nanos(0),
                    false => engine.queue.next_deadline(),
                });
            let mut is_all = false;
            while !is_all {
                let now = Instant::now();
                is_all = engine.queue.take_due(now, due);
                engine.note_lateness(due.latest);
                self.woken.fetch_add(due.wake() as u64, Ordering::Relaxed);
                for callback in due.calls.drain(..) {
                    self.manager
                        .callbacks
                        .call(callback as usize, engine, |name, message| {
                            self.panicked(name, message);
                        });
                }
            }
            engine.queue.settle();
        }
    }

    fn panicked(&self, name: String, message: String) {
        self.panic
            .lock()
            .get_or_insert(Error::Callback { name, message });
        self.emergency.trigger_by_panic();
    }
}

/// What the timer manager did: part of the [`Report`](crate::Report) of a system with
/// [`Timers::Manager`](crate::time::Timers::Manager).
///
/// What the loops did of their slots stands in their own
/// [`LoopReport`](crate::report::LoopReport)s: a tick that the manager was late for, and a slot
/// that a loop missed, are different faults.
///
/// ```
/// use luna::prelude::*;
/// use luna::time::Timers;
/// use std::time::Duration;
///
/// let mut system = System::new("servo");
/// system.timers(Timers::Manager);
/// let main = system.executor("main").build()?;
/// for (name, millis) in [("servo", 1), ("planner", 2)] {
///     main.process(name).spawn(async move {
///         let mut tick = luna::periodic(name, Duration::from_millis(millis))?;
///         for _ in 0..6 / millis {
///             tick.next().await;
///         }
///         Ok(())
///     })?;
/// }
/// let report = system.run()?;
/// let timers = report.timers.unwrap();
/// // Fewer than slots, where a loop came late.
/// println!("{} wake-ups, {:?} late at most", timers.woken, timers.latest);
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct TimersReport {
    /// The policy that its thread had, read back from the system.
    pub policy: Policy,
    /// How many wake-ups of loops it made.
    pub woken: u64,
    /// The longest time from a slot of a loop, or of a periodic callback, until the manager dealt
    /// with it: its own lateness.
    pub latest: Duration,
    /// The callbacks, in the order of their making.
    pub callbacks: Vec<CallbackReport>,
    /// How many callbacks were dropped while the system ran and made room for others: they do not
    /// stand in the list.
    pub earlier_callbacks: u64,
}

/// One callback.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct CallbackReport {
    /// Its name.
    pub name: String,
    /// How often it was called.
    pub calls: u64,
    /// The slots that passed whole without a call.
    pub missed: u64,
    /// How many calls took longer than 100 µs.
    pub too_long: u64,
    /// The longest call, on the wall's clock.
    pub longest: Duration,
    /// The longest time from a slot, or an instant, until the call.
    pub latest: Duration,
    /// Whether it panicked, which ended it and the system.
    pub panicked: bool,
}

/// How many callbacks the table shows.
const CALLBACKS_SHOWN: usize = 16;

impl fmt::Display for TimersReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "timer manager: {}, {} wake-ups, {} late at most",
            self.policy,
            self.woken,
            short(self.latest)
        )?;
        for one in self.callbacks.iter().take(CALLBACKS_SHOWN) {
            write!(
                f,
                "\n  callback `{}`: {} calls, {} missed, {} at most, {} late at most",
                one.name,
                one.calls,
                one.missed,
                short(one.longest),
                short(one.latest)
            )?;
            if one.too_long > 0 {
                write!(f, ", {} times too long", one.too_long)?;
            }
            if one.panicked {
                f.write_str(", panicked")?;
            }
        }
        let others = self.callbacks.len().saturating_sub(CALLBACKS_SHOWN);
        if others > 0 {
            write!(f, "\n  and {others} callbacks more")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_tells_both_sides_overruns() {
        let report = TimersReport {
            policy: Policy::fifo(98),
            woken: 2_000,
            latest: Duration::from_micros(4_200),
            callbacks: vec![
                CallbackReport {
                    name: "sample".to_owned(),
                    calls: 10,
                    missed: 2,
                    too_long: 1,
                    longest: Duration::from_micros(150),
                    ..CallbackReport::default()
                };
                CALLBACKS_SHOWN + 1
            ],
            ..TimersReport::default()
        };
        let text = report.to_string();
        for part in [
            "fifo:98, 2000 wake-ups, 4.20 ms late at most",
            "`sample`: 10 calls, 2 missed, 150.0 µs at most",
            "1 times too long",
            "and 1 callbacks more",
        ] {
            assert!(text.contains(part), "`{part}` is not in: {text}");
        }
    }
}
