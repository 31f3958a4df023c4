//! LUNA behind the traits that its peers implement: a system with one executor, and named,
//! prioritized processes.

use crate::channels::{Channel, Received, Receiving, Sending};
use crate::executors::Executor;
use core_affinity::CoreId;
use luna::System;
use luna::system::ProcessBuilder;
use std::cell::{Cell, RefCell, RefMut};
use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

/// A rendezvous of LUNA.
#[derive(Debug)]
pub struct LunaChannel;

impl Channel for LunaChannel {
    type Sender = luna::Sender<u64>;
    type Receiver = luna::Receiver<u64>;

    fn new_pair() -> (Self::Sender, Self::Receiver) {
        luna::channel()
    }

    fn buffered(capacity: usize) -> (Self::Sender, Self::Receiver) {
        luna::buffered(luna::Buffer::fifo(capacity))
    }

    fn between_executors(
        (output, input): (Self::Sender, Self::Receiver),
    ) -> (Self::Sender, Self::Receiver) {
        // Each executor has a system of its own, which would otherwise take the other end's silence
        // for a deadlock.
        (output.external(), input.external())
    }
}

impl Sending for luna::Sender<u64> {
    fn send(&mut self, value: u64) -> impl Future<Output = Result<(), impl Sized>> + Send {
        luna::Sender::send(self, value)
    }
}

impl Receiving for luna::Receiver<u64> {
    fn recv(&mut self) -> impl Future<Output = impl Received> + Send {
        luna::Receiver::recv(self)
    }
}

/// A system with one executor on the bench's core, without a real-time policy, like its peers.
pub type Luna = LunaSystem<false, true, false>;

/// The same without room for the statistics of periodic loops, which is 0.8 MB by default.
pub type LunaWithoutLoops = LunaSystem<false, false, false>;

/// As [`Luna`], with an executor that polls for work for a while before it sleeps.
pub type LunaThatSpins = LunaSystem<false, true, true>;

/// A system of OS-thread processes on the bench's core, without a real-time policy.
pub type LunaThreads = LunaSystem<true, true, false>;

/// As [`LunaThreads`], with threads that poll for a wake-up for a while before they sleep.
pub type LunaThreadsThatSpin = LunaSystem<true, true, true>;

/// How long they look: longer than a partner that is awake takes.
const SPIN: Duration = Duration::from_micros(50);

/// See [`Luna`], [`LunaWithoutLoops`], [`LunaThatSpins`], [`LunaThreads`] and
/// [`LunaThreadsThatSpin`].
#[derive(Debug)]
pub struct LunaSystem<const THREADS: bool, const LOOPS: bool, const SPINS: bool> {
    system: RefCell<System>,
    core: CoreId,
    /// None if each process has a thread.
    executor: Option<luna::Executor>,
    spawned: Cell<u32>,
}

impl<const THREADS: bool, const LOOPS: bool, const SPINS: bool> LunaSystem<THREADS, LOOPS, SPINS> {
    /// The executor, to spawn processes of LUNA's own kinds on.
    ///
    /// # Panics
    ///
    /// Each process has a thread.
    pub fn executor(&self) -> &luna::Executor {
        self.executor.as_ref().expect("the processes share one")
    }

    /// The system, to configure it before it runs, or for its report.
    pub fn system(&self) -> RefMut<'_, System> {
        self.system.borrow_mut()
    }

    /// A process to be, with a name that no other one has.
    pub fn process(&self) -> ProcessBuilder {
        let name = self.spawned.replace(self.spawned.get() + 1).to_string();
        if let Some(executor) = &self.executor {
            return executor.process(name);
        }
        let mut thread = self.system().thread(&name).core(self.core.id);
        if SPINS {
            thread = thread.spin_before_sleep(SPIN);
        }
        thread.process(&name)
    }
}

impl<const THREADS: bool, const LOOPS: bool, const SPINS: bool> Executor
    for LunaSystem<THREADS, LOOPS, SPINS>
{
    fn new(core: CoreId) -> Self {
        let mut system = System::new("bench");
        if !LOOPS {
            system.max_loops(0);
        }
        let executor = (!THREADS).then(|| {
            let mut executor = system.executor("bench").core(core.id);
            if SPINS {
                executor = executor.spin_before_sleep(SPIN);
            }
            executor.build().expect("the core is one of the machine's")
        });
        LunaSystem {
            system: RefCell::new(system),
            core,
            executor,
            spawned: Cell::new(0),
        }
    }

    fn spawn<T: Send + 'static>(
        &self,
        process: impl Future<Output = T> + Send + 'static,
    ) -> impl Future<Output = T> {
        let result = Arc::new(Mutex::new(None));
        let place = result.clone();
        self.start(async move {
            let value = process.await;
            *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(value);
        });
        async move {
            let value = result.lock().unwrap_or_else(PoisonError::into_inner).take();
            value.expect("the system has been run")
        }
    }

    fn start(&self, process: impl Future<Output = ()> + Send + 'static) {
        let spawned = self.process().spawn(EndsWell(process));
        spawned.expect("the names differ");
    }

    fn yield_now() -> impl Future<Output = ()> + Send + 'static {
        luna::yield_now()
    }

    fn block_on<T>(&self, future: impl Future<Output = T>) -> T {
        let ended = self.system().run();
        ended.expect("a process of a bench panics when its check fails");
        // All processes have ended, so nothing is left to wait for.
        futures_lite::future::block_on(future)
    }
}

/// As [`Luna`], with a loop at 1 kHz and a hundred timeouts that do not come on the same executor.
#[derive(Debug)]
pub struct LunaWithDeadlines {
    luna: Luna,
    /// The processes that have not ended, one reference each: the loop ends with them.
    running: Arc<()>,
}

/// A process that is running as long as this lives.
struct Running<F> {
    process: F,
    _one: Arc<()>,
}

impl<F: Future> Future for Running<F> {
    type Output = F::Output;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: it is pinned with the whole, and never moved.
        unsafe { self.map_unchecked_mut(|this| &mut this.process) }.poll(cx)
    }
}

impl LunaWithDeadlines {
    fn running<F>(&self, process: F) -> Running<F> {
        Running {
            process,
            _one: self.running.clone(),
        }
    }
}

impl Executor for LunaWithDeadlines {
    fn new(core: CoreId) -> Self {
        const PERIOD: Duration = Duration::from_millis(1);
        const TIMEOUTS: u64 = 100;
        const FAR: Duration = Duration::from_secs(1000);
        let luna = Luna::new(core);
        let running = Arc::new(());
        let others = running.clone();
        let beside = luna.process().priority(31);
        let beside = beside.spawn(move || async move {
            let timeouts = (0..TIMEOUTS).map(|n| luna::after(FAR + Duration::from_secs(n)));
            let mut timeouts: Vec<_> = timeouts.map(Box::pin).collect();
            poll_fn(|cx| {
                for timeout in &mut timeouts {
                    assert!(timeout.as_mut().poll(cx).is_pending());
                }
                Poll::Ready(())
            })
            .await;
            let mut tick = luna::periodic("beside", PERIOD)?;
            // The bench's executor has a reference itself.
            while Arc::strong_count(&others) > 2 {
                tick.next().await;
            }
            Ok(())
        });
        beside.expect("the names differ");
        Self { luna, running }
    }

    fn spawn<T: Send + 'static>(
        &self,
        process: impl Future<Output = T> + Send + 'static,
    ) -> impl Future<Output = T> {
        self.luna.spawn(self.running(process))
    }

    fn start(&self, process: impl Future<Output = ()> + Send + 'static) {
        self.luna.start(self.running(process));
    }

    fn yield_now() -> impl Future<Output = ()> + Send + 'static {
        luna::yield_now()
    }

    fn block_on<T>(&self, future: impl Future<Output = T>) -> T {
        self.luna.block_on(future)
    }
}

/// A peer's process as one of LUNA's, with a result. Not an async block around it: that would hold
/// the process twice, as its argument and while it waits for it.
struct EndsWell<F>(F);

impl<F: Future<Output = ()>> Future for EndsWell<F> {
    type Output = luna::Result<()>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: it is pinned with the whole, and never moved.
        let process = unsafe { self.map_unchecked_mut(|this| &mut this.0) };
        process.poll(cx).map(Ok)
    }
}

/// [`delta`](crate::processes::delta) with both outputs at once, by `par!`.
pub async fn parallel_delta(
    input: luna::Receiver<u64>,
    first: luna::Sender<u64>,
    second: luna::Sender<u64>,
) {
    while let Ok(number) = input.recv().await {
        if luna::par!(first.send(number), second.send(number))
            .await
            .is_err()
        {
            break;
        }
    }
}
