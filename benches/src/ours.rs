//! LUNA behind the names that its peers are measured by: a system with one executor, and named, prioritized processes.

use crate::channels::{Channel, Received, Receiving, Sending};
use crate::executors::Executor;
use core_affinity::CoreId;
use luna::System;
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
#[derive(Debug)]
pub struct Luna {
    system: RefCell<System>,
    executor: luna::Executor,
    spawned: Cell<u32>,
}

impl Executor for Luna {
    fn new(core: CoreId) -> Self {
        let mut system = System::new("bench");
        let executor = system
            .executor("bench")
            .core(core.id)
            .build()
            .expect("the core is one of the machine's");
        Luna {
            system: RefCell::new(system),
            executor,
            spawned: Cell::new(0),
        }
    }

    fn spawn<T: Send + 'static>(
        &self,
        process: impl Future<Output = T> + Send + 'static,
    ) -> impl Future<Output = T> {
        let number = self.spawned.replace(self.spawned.get() + 1);
        let result = Arc::new(Mutex::new(None));
        let place = result.clone();
        let process = async move {
            let value = process.await;
            *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(value);
            Ok(())
        };
        let spawned = self
            .executor
            .process(&format!("process {number}"))
            .spawn(process);
        spawned.expect("the names differ");
        async move {
            let value = result.lock().unwrap_or_else(PoisonError::into_inner).take();
            value.expect("the system has been run")
        }
    }

    fn block_on<T>(&self, future: impl Future<Output = T>) -> T {
        self.system
            .borrow_mut()
            .run()
            .expect("a process of a bench panics when its check fails");
        // All processes have ended, so nothing is left to wait for.
        futures_lite::future::block_on(future)
    }
}
