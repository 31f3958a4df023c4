//! LUNA behind the names that its peers are measured by: a system with one executor, and named, prioritized processes.

use crate::channels::{Channel, Received, Receiving, Sending};
use crate::executors::Executor;
use core_affinity::CoreId;
use luna::{ProcessBuilder, System};
use std::cell::{Cell, RefCell};
use std::future::Future;
use std::sync::{Arc, Mutex, PoisonError};

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
        // Each executor has a system of its own, which else takes the other end's silence for a deadlock.
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

/// A system with one executor on the bench's core, without a real-time policy: what its peers have too.
pub type Luna = LunaSystem<true>;

/// The same without room for the statistics of periodic loops, which is 12 MB by default.
pub type LunaWithoutLoops = LunaSystem<false>;

/// See [`Luna`] and [`LunaWithoutLoops`].
#[derive(Debug)]
pub struct LunaSystem<const LOOPS: bool> {
    system: RefCell<System>,
    executor: luna::Executor,
    spawned: Cell<u32>,
}

impl<const LOOPS: bool> LunaSystem<LOOPS> {
    /// The executor, to spawn processes of LUNA's own kinds on.
    pub fn executor(&self) -> &luna::Executor {
        &self.executor
    }

    /// A process to be, with a name that no other one has.
    pub fn process(&self) -> ProcessBuilder {
        self.executor.process(&next_name(&self.spawned))
    }
}

impl<const LOOPS: bool> Executor for LunaSystem<LOOPS> {
    fn new(core: CoreId) -> Self {
        let mut system = System::new("bench");
        if !LOOPS {
            system.max_loops(0);
        }
        let executor = system.executor("bench").core(core.id).build();
        LunaSystem {
            system: RefCell::new(system),
            executor: executor.expect(OUR_CORE),
            spawned: Cell::new(0),
        }
    }

    fn spawn<T: Send + 'static>(
        &self,
        process: impl Future<Output = T> + Send + 'static,
    ) -> impl Future<Output = T> {
        spawn_as(self.process(), process)
    }

    fn start(&self, process: impl Future<Output = ()> + Send + 'static) {
        start_as(self.process(), process);
    }

    fn yield_now() -> impl Future<Output = ()> + Send + 'static {
        luna::yield_now()
    }

    fn block_on<T>(&self, future: impl Future<Output = T>) -> T {
        run_to_end(&self.system, future)
    }
}

/// A system of OS-thread processes on the bench's core, without a real-time policy.
#[derive(Debug)]
pub struct LunaThreads {
    system: RefCell<System>,
    core: CoreId,
    spawned: Cell<u32>,
}

impl LunaThreads {
    fn process(&self) -> ProcessBuilder {
        let name = next_name(&self.spawned);
        let thread = self.system.borrow_mut().thread(&name).core(self.core.id);
        thread.process(&name)
    }
}

impl Executor for LunaThreads {
    fn new(core: CoreId) -> Self {
        LunaThreads {
            system: RefCell::new(System::new("bench")),
            core,
            spawned: Cell::new(0),
        }
    }

    fn spawn<T: Send + 'static>(
        &self,
        process: impl Future<Output = T> + Send + 'static,
    ) -> impl Future<Output = T> {
        spawn_as(self.process(), process)
    }

    fn start(&self, process: impl Future<Output = ()> + Send + 'static) {
        start_as(self.process(), process);
    }

    fn yield_now() -> impl Future<Output = ()> + Send + 'static {
        luna::yield_now()
    }

    fn block_on<T>(&self, future: impl Future<Output = T>) -> T {
        run_to_end(&self.system, future)
    }
}

const OUR_CORE: &str = "the core is one of the machine's";

fn next_name(spawned: &Cell<u32>) -> String {
    spawned.replace(spawned.get() + 1).to_string()
}

fn spawn_as<T: Send + 'static>(
    builder: ProcessBuilder,
    process: impl Future<Output = T> + Send + 'static,
) -> impl Future<Output = T> {
    let result = Arc::new(Mutex::new(None));
    let place = result.clone();
    start_as(builder, async move {
        let value = process.await;
        *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(value);
    });
    async move {
        let value = result.lock().unwrap_or_else(PoisonError::into_inner).take();
        value.expect("the system has been run")
    }
}

fn start_as(builder: ProcessBuilder, process: impl Future<Output = ()> + Send + 'static) {
    let process = async move {
        process.await;
        Ok(())
    };
    builder.spawn(process).expect("the names differ");
}

fn run_to_end<T>(system: &RefCell<System>, future: impl Future<Output = T>) -> T {
    let ended = system.borrow_mut().run();
    ended.expect("a process of a bench panics when its check fails");
    // All processes have ended, so nothing is left to wait for.
    futures_lite::future::block_on(future)
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
