//! The peers' executors behind one trait. Each keeps its processes on the thread, or at least on
//! the core, of its caller.

use std::{cell::RefCell, future::Future, thread};

use core_affinity::CoreId;
use futures_lite::future;
use tokio::{runtime, task};

use crate::cores::{on_core, one_core};

/// Runs processes.
pub trait Executor: 'static {
    /// Makes an executor for `core`, to which the calling thread is pinned.
    fn new(core: CoreId) -> Self;

    /// Starts a process; the future returns its result, and panics if the process did.
    ///
    /// Put the measured work in a process: the future given to [`block_on`](Executor::block_on)
    /// takes a slower path in some executors.
    fn spawn<T: Send + 'static>(
        &self,
        process: impl Future<Output = T> + Send + 'static,
    ) -> impl Future<Output = T>;

    /// Starts a detached process. It ends by itself, or with the executor.
    fn start(&self, process: impl Future<Output = ()> + Send + 'static);

    /// Lets the others run.
    fn yield_now() -> impl Future<Output = ()> + Send + 'static {
        future::yield_now()
    }

    /// Runs the processes until `future` ends.
    fn block_on<T>(&self, future: impl Future<Output = T>) -> T;
}

/// Runs `work` with an executor for the first core, on a thread that is pinned to it.
///
/// # Panics
///
/// As [`on_core`].
pub fn on_one_core<E: Executor, T: Send>(work: impl FnOnce(&E) -> T + Send) -> T {
    let core = one_core();
    on_core(core, || work(&E::new(core)))
}

const ENDED_WELL: &str = "a process of a bench panics when its check fails";

/// tokio's current-thread runtime, with `tokio::spawn`.
#[derive(Debug)]
pub struct Tokio {
    runtime: runtime::Runtime,
}

fn tokio_runtime() -> runtime::Runtime {
    // No driver for timers or files: an idle runtime parks on a condition variable, which is its
    // fastest way.
    let runtime = runtime::Builder::new_current_thread().build();
    runtime.expect("a runtime without drivers needs no system resources")
}

impl Executor for Tokio {
    fn new(_: CoreId) -> Self {
        let runtime = tokio_runtime();
        Tokio { runtime }
    }

    fn spawn<T: Send + 'static>(
        &self,
        process: impl Future<Output = T> + Send + 'static,
    ) -> impl Future<Output = T> {
        let task = self.runtime.spawn(process);
        async { task.await.expect(ENDED_WELL) }
    }

    fn start(&self, process: impl Future<Output = ()> + Send + 'static) {
        self.runtime.spawn(process);
    }

    fn yield_now() -> impl Future<Output = ()> + Send + 'static {
        task::yield_now()
    }

    fn block_on<T>(&self, future: impl Future<Output = T>) -> T {
        self.runtime.block_on(future)
    }
}

/// tokio's `LocalSet` on its current-thread runtime, with `spawn_local`.
#[derive(Debug)]
pub struct TokioLocal {
    local: task::LocalSet,
    runtime: runtime::Runtime,
}

impl Executor for TokioLocal {
    fn new(_: CoreId) -> Self {
        TokioLocal {
            local: task::LocalSet::new(),
            runtime: tokio_runtime(),
        }
    }

    fn spawn<T: Send + 'static>(
        &self,
        process: impl Future<Output = T> + Send + 'static,
    ) -> impl Future<Output = T> {
        let task = self.local.spawn_local(process);
        async { task.await.expect(ENDED_WELL) }
    }

    fn start(&self, process: impl Future<Output = ()> + Send + 'static) {
        self.local.spawn_local(process);
    }

    fn block_on<T>(&self, future: impl Future<Output = T>) -> T {
        self.local.block_on(&self.runtime, future)
    }
}

/// smol's `LocalExecutor`.
#[derive(Debug)]
pub struct Smol {
    executor: async_executor::LocalExecutor<'static>,
}

impl Executor for Smol {
    fn new(_: CoreId) -> Self {
        let executor = async_executor::LocalExecutor::new();
        Smol { executor }
    }

    fn spawn<T: Send + 'static>(
        &self,
        process: impl Future<Output = T> + Send + 'static,
    ) -> impl Future<Output = T> {
        self.executor.spawn(process)
    }

    fn start(&self, process: impl Future<Output = ()> + Send + 'static) {
        self.executor.spawn(process).detach();
    }

    fn block_on<T>(&self, future: impl Future<Output = T>) -> T {
        future::block_on(self.executor.run(future))
    }
}

/// An operating-system thread for each process; on Linux it inherits the core of the spawning
/// thread.
#[derive(Debug, Default)]
pub struct Threads {
    started: RefCell<Vec<thread::JoinHandle<()>>>,
}

impl Executor for Threads {
    fn new(_: CoreId) -> Self {
        Threads::default()
    }

    fn spawn<T: Send + 'static>(
        &self,
        process: impl Future<Output = T> + Send + 'static,
    ) -> impl Future<Output = T> {
        let thread = thread::spawn(|| future::block_on(process));
        // The caller has nothing to do meanwhile but to wait.
        async { thread.join().expect(ENDED_WELL) }
    }

    fn start(&self, process: impl Future<Output = ()> + Send + 'static) {
        let builder = thread::Builder::new().stack_size(1 << 16);
        let thread = builder.spawn(|| future::block_on(process));
        let thread = thread.expect("the system has room for one more");
        self.started.borrow_mut().push(thread);
    }

    fn yield_now() -> impl Future<Output = ()> + Send + 'static {
        thread::yield_now();
        std::future::ready(())
    }

    fn block_on<T>(&self, future: impl Future<Output = T>) -> T {
        let result = future::block_on(future);
        for thread in self.started.take() {
            thread.join().expect(ENDED_WELL);
        }
        result
    }
}
