//! The manager's thread.

use super::report::TimersReport;
use super::{Engine, Manager};
use crate::error::{Error, Result};
use crate::safety::Emergency;
use luna_core::current;
use luna_core::timer_queue::Due;
use luna_platform::clock::Instant;
use luna_platform::lock::PiLock;
use luna_platform::thread::{self, Attributes, Refusal, Thread};
use std::convert::Infallible;
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
