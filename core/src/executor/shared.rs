//! What other threads see of an executor.

use crate::current::{self, ExecutorId};
use crate::inbound::Inbound;
use crate::process::{self, ProcessRegistry, Unbuilt, panic_message};
use crate::quiescence::{Quiescence, Sleeper};
use crate::simulation::Stage;
use crate::spin::Outside;
use crate::timer_queue::DeadlineListener;
use alloc::boxed::Box;
use alloc::collections::LinkedList;
use alloc::format;
use alloc::sync::Arc;
use core::any::Any;
use core::time::Duration;
use luna_platform::futex::Futex;
use luna_platform::lock::PiLock;
use luna_platform::sync::OnceLock;
use luna_platform::sync::plain::{AtomicU8, AtomicU64, Ordering};

/// How far a thread has come: numbers, since they only rise.
pub(crate) struct Phase;

impl Phase {
    /// Processes are taken in, none runs.
    pub(crate) const HELD: u8 = 0;
    /// Processes run.
    pub(crate) const RELEASED: u8 = 1;
    /// All are cancelled, then the thread ends.
    pub(crate) const STOPPING: u8 = 2;
}

/// How many processes an executor is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Serves {
    Many,
    /// It may make blocking calls, and the thread ends with it.
    One,
    /// Without an operating system: the executor ends with the last.
    #[cfg(not(feature = "std"))]
    Cpu,
}

/// What an executor's thread shares with the others.
pub(crate) struct Shared {
    pub(crate) executor_id: ExecutorId,
    pub(super) thread_priority: AtomicU8,
    pub(crate) inbound: Inbound,
    pub(super) phase: AtomicU8,
    pub(super) arrivals: PiLock<Arrivals>,
    /// How many arrivals were taken in: what `settle` waits for.
    pub(super) settled: Futex,
    pub(crate) registry: Arc<ProcessRegistry>,
    pub(super) quiescence: Arc<Quiescence>,
    /// How long the thread looks for work before it sleeps, in nanoseconds.
    pub(super) spin: AtomicU64,
    pub(super) processor_time: OnceLock<Duration>,
    pub(crate) serves: Serves,
    /// The stage that runs it, if it has no thread of its own.
    pub(super) stage: Option<Arc<Stage>>,
    /// Its name, if it is on a stage: its thread has another.
    pub(super) name: Option<Box<str>>,
    /// Set when one on a stage has stopped.
    pub(super) stopped: Futex,
}

#[derive(Default)]
pub(super) struct Arrivals {
    /// To be built on the executor's thread.
    pub(super) waiting: LinkedList<Unbuilt>,
    pub(super) announced: u32,
    pub(super) closed: bool,
}

impl Shared {
    pub(crate) fn thread_priority(&self) -> u8 {
        self.thread_priority.load(Ordering::Relaxed)
    }

    pub(crate) fn phase(&self) -> u8 {
        self.phase.load(Ordering::Acquire)
    }

    /// Goes on to `phase` unless a later one is reached already.
    pub(crate) fn advance(&self, phase: u8) {
        self.phase.fetch_max(phase, Ordering::AcqRel);
        self.inbound.ask_attention();
    }

    /// Builds what has arrived. Allocates: off the real-time path.
    pub(crate) fn build_arrivals(&self) {
        let mut arrived = core::mem::take(&mut self.arrivals.lock().waiting);
        if arrived.is_empty() {
            return;
        }
        while let Some(process) = arrived.pop_front() {
            process.build();
            self.settled.word().fetch_add(1, Ordering::AcqRel);
        }
        self.settled.wake_all();
    }

    /// Takes in what came from other threads: new processes, and wakes that are not less urgent
    /// than the processes that are ready here; before its release all of them, since a signal that
    /// is left would keep the thread from its sleep. From then on the thread is on the real-time
    /// path.
    #[inline]
    pub(crate) fn take_in(&self) {
        let signals = self.inbound.signals();
        if signals.is_empty() {
            return;
        }
        if signals.attention() {
            self.inbound.take_attention();
            current::set_on_path(false);
            self.build_arrivals();
        }
        let is_held = self.phase() == Phase::HELD;
        current::set_on_path(!is_held);
        while let Some(level) = self.inbound.signals().highest_level()
            && (is_held || current::ready_levels() >> level <= 1)
        {
            process::queue_woken(self, level);
        }
    }

    /// One that is held, on a thread of its own or on a stage's.
    pub(super) fn new(
        thread_priority: u8,
        registry: Arc<ProcessRegistry>,
        quiescence: Arc<Quiescence>,
        serves: Serves,
        stage: Option<(Arc<Stage>, &str)>,
    ) -> Arc<Self> {
        let name = stage.as_ref().map(|(_, name)| Box::from(*name));
        Arc::new(Shared {
            executor_id: ExecutorId::new(),
            thread_priority: AtomicU8::new(thread_priority),
            inbound: Inbound::new(),
            phase: AtomicU8::new(Phase::HELD),
            arrivals: PiLock::new(Arrivals::default()),
            settled: Futex::new(0),
            registry,
            quiescence,
            spin: AtomicU64::new(0),
            processor_time: OnceLock::new(),
            serves,
            stage: stage.map(|(stage, _)| stage),
            name,
            stopped: Futex::new(0),
        })
    }

    /// Its name, on a stage.
    pub(crate) fn name(&self) -> &str {
        self.name.as_deref().unwrap_or_default()
    }

    /// It has stopped, on a stage.
    pub(crate) fn set_stopped(&self) {
        self.stopped.word().store(1, Ordering::Release);
        self.stopped.wake_all();
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.stopped.word().load(Ordering::Acquire) != 0
    }

    /// Its stage had ended before it came.
    pub(crate) fn refuse_all(&self) {
        self.advance(Phase::STOPPING);
        self.close();
        self.set_stopped();
    }

    /// Ends the executor after a panic outside of any process, on its thread. A process may rely on
    /// what was to be done there, so none is polled any more: all have panicked with it. Their
    /// bodies are dropped, and the channel ends in them poison their channels, so that partners
    /// elsewhere do not wait for them. O(processes), and what their drops take.
    pub(crate) fn give_up(&self, payload: Box<dyn Any + Send>) {
        let why = format!(
            "its executor's thread panicked outside of any process, as a waker does that is not LUNA's: {}",
            panic_message(&*payload)
        );
        // Dropping it could panic in turn.
        core::mem::forget(payload);
        // Nothing is built here from now on.
        self.advance(Phase::STOPPING);
        current::give_up(|| process::end_all(&why));
        self.close();
    }

    /// Takes in no more, and returns `true`; `false` if one waits to be taken in.
    #[cfg(not(feature = "std"))]
    pub(super) fn close_if_none_waits(&self) -> bool {
        let mut arrivals = self.arrivals.lock();
        arrivals.closed = arrivals.waiting.is_empty();
        arrivals.closed
    }

    /// Takes in no more; those that wait end unstarted.
    pub(crate) fn close(&self) {
        let mut refused = {
            let mut arrivals = self.arrivals.lock();
            arrivals.closed = true;
            core::mem::take(&mut arrivals.waiting)
        };
        while let Some(process) = refused.pop_front() {
            drop(process);
            self.settled.word().fetch_add(1, Ordering::AcqRel);
        }
        self.settled.wake_all();
    }
}

impl Sleeper for Shared {
    fn quiescence(&self) -> &Quiescence {
        &self.quiescence
    }

    fn is_woken(&self) -> bool {
        self.inbound.is_signalled()
    }
}

impl Outside for Shared {
    fn is_called(&self) -> bool {
        self.inbound.is_signalled() || self.time().is_zero()
    }

    fn time(&self) -> Duration {
        Duration::from_nanos(self.spin.load(Ordering::Relaxed))
    }
}

impl DeadlineListener for Shared {
    fn ask_look(&self) {
        self.inbound.ask_look();
    }
}
