//! One place of each kind, and the operations on them.

use crate::common::Random;
use crate::hostile_futures::actors::{Value, strike};
use futures_lite::StreamExt;
use luna_channels::lock_sync::{Condvar, Mutex, Semaphore};
use luna_channels::{
    Alternative, Barrier, Buffer, Client, Receiver, Sender, Server, alt, buffered, call_channel,
    channel, pri_alt,
};
use luna_core::{ExecutorHandle, ProcessSpec, blocking, yield_now};
use std::future::Future;
use std::mem;
use std::pin::Pin;
use std::sync::{Arc, Mutex as Plain};
use std::task::{Context, Poll, Waker};
use std::time::Duration;

/// The result of an operation, of any type.
pub(crate) trait Keep: Send {}
impl<T: Send> Keep for T {}

/// A future with what it borrows. The fields are dropped in this order.
pub(crate) struct Operation {
    future: Pin<Box<dyn Future<Output = Box<dyn Keep>> + Send>>,
    #[expect(dead_code, reason = "kept until the future is dropped")]
    ends: Box<dyn Keep>,
}

/// The result of an operation with what it borrows.
#[expect(dead_code, reason = "kept for their drops, in this order")]
pub(crate) struct Kept(pub(crate) Box<dyn Keep>, pub(crate) Operation);

/// Boxes the result of a future. No async block: that could not be polled after a panic.
struct Boxed<F>(F);

impl<F: Future<Output: Keep + 'static>> Future for Boxed<F> {
    type Output = Box<dyn Keep>;
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: the future is pinned with the whole.
        let future = unsafe { self.map_unchecked_mut(|this| &mut this.0) };
        future.poll(cx).map(|output| Box::new(output) as _)
    }
}

impl Operation {
    fn new<E, F>(ends: E, make: impl FnOnce(&'static mut E) -> F) -> Option<Self>
    where
        E: Send + 'static,
        F: Future<Output: Send> + Send + 'static,
    {
        let ends = Box::into_raw(Box::new(ends));
        // SAFETY: the future, and what it comes to, are dropped before the box, and no other code
        // uses that.
        let future = Box::pin(Boxed(make(unsafe { &mut *ends })));
        Some(Operation {
            future,
            // SAFETY: the pointer is that of the box.
            ends: unsafe { Box::from_raw(ends) },
        })
    }

    /// Polls. The result is to be dropped before the operation.
    pub(crate) fn poll(&mut self, cx: &mut Context<'_>) -> Poll<Box<dyn Keep>> {
        self.future.as_mut().poll(cx)
    }
}

/// Ends that go at random.
struct Ends<S, R>(Plain<Option<S>>, Plain<Option<R>>);

impl<S: Clone, R: Clone> Ends<S, R> {
    fn new((sender, receiver): (S, R)) -> Self {
        Self(Plain::new(Some(sender)), Plain::new(Some(receiver)))
    }

    fn sender(&self) -> Option<S> {
        self.0.lock().unwrap().clone()
    }

    fn receiver(&self) -> Option<R> {
        self.1.lock().unwrap().clone()
    }

    fn both(&self) -> Option<(S, R)> {
        Some((self.sender()?, self.receiver()?))
    }

    fn lose(&self, random: &mut Random) {
        // Dropped without the test's own lock.
        match random.below(2) {
            0 => {
                let _sender = self.0.lock().unwrap().take();
            }
            _ => {
                let _receiver = self.1.lock().unwrap().take();
            }
        }
    }
}

type Channel = Ends<Sender<Value>, Receiver<Value>>;

pub(crate) struct World {
    channels: [Channel; 3],
    calls: Ends<Client<Value, Value>, Server<Value, Value>>,
    mutex: Mutex<Value>,
    condition: Condvar,
    semaphore: Semaphore,
    barrier: Barrier,
    /// Where processes are spawned, if the world is one of executors.
    executor: Option<ExecutorHandle>,
    /// Whether values panic in their drops.
    values_panic: bool,
}

/// How many operations there are that do not wait.
const TOUCHES: usize = 15;

/// How many kinds of operations there are on plain threads; the rest need timers.
pub(crate) const PLAIN_KINDS: usize = 19;
pub(crate) const KINDS: usize = PLAIN_KINDS + 9;

impl World {
    pub(crate) fn new(executor: Option<ExecutorHandle>, values_panic: bool) -> Arc<Self> {
        Arc::new(Self {
            channels: [
                Ends::new(channel()),
                Ends::new(buffered(Buffer::fifo(2))),
                Ends::new(buffered(Buffer::overwrite_oldest(1))),
            ],
            calls: Ends::new(call_channel()),
            mutex: Mutex::new(Value::new(false)),
            condition: Condvar::new(),
            semaphore: Semaphore::new(1),
            barrier: Barrier::new(2),
            executor,
            values_panic,
        })
    }

    /// Whether its processes have timers.
    pub(crate) fn has_timers(&self) -> bool {
        self.executor.is_some()
    }

    fn value(&self, random: &mut Random) -> Value {
        Value::new(self.values_panic && random.chance(40))
    }

    /// Calls an operation that does not wait.
    pub(crate) fn touch(&self, random: &mut Random) {
        let which = random.below(TOUCHES);
        self.touch_at(which, random);
    }

    /// Calls all operations that do not wait, so that every waiter goes on.
    pub(crate) fn touch_all(&self, random: &mut Random, each: fn(&mut dyn FnMut())) {
        for which in 0..TOUCHES {
            each(&mut || self.touch_at(which, random));
        }
    }

    fn touch_at(&self, which: usize, random: &mut Random) {
        match which {
            0..3 => drop(
                self.channels[which]
                    .sender()
                    .map(|sender| sender.try_send(self.value(random))),
            ),
            3..6 => drop(
                self.channels[which - 3]
                    .receiver()
                    .map(|receiver| receiver.try_recv()),
            ),
            6 => {
                let server = self.calls.receiver();
                let accepted = server.as_ref().map(|server| server.try_accept());
                if let Some(Ok(call)) = accepted {
                    drop(call.reply(self.value(random)));
                }
            }
            7 => drop(self.mutex.try_lock()),
            8 => self.condition.notify_one(),
            9 => self.condition.notify_all(),
            10 => drop(self.semaphore.try_acquire()),
            11 if self.semaphore.available_permits() < 4 => self.semaphore.add_permits(1),
            12 => drop(self.barrier.enroll()),
            // Where there are timers, one is armed and taken back.
            13 => {
                if luna_core::current::timers().is_some() {
                    let mut delay = std::pin::pin!(luna_channels::after(Duration::from_secs(9)));
                    let cx = &mut Context::from_waker(Waker::noop());
                    assert!(delay.as_mut().poll(cx).is_pending());
                }
            }
            _ => {
                // One party less, and then as many as before.
                self.barrier.resign();
                mem::forget(self.barrier.enroll());
            }
        }
    }

    /// Poisons a channel, or loses an end.
    pub(crate) fn break_something(&self, random: &mut Random) {
        let which = random.below(4);
        match (self.channels.get(which), random.below(3)) {
            (Some(channel), 0) => drop(channel.sender().map(|sender| sender.poison())),
            (Some(channel), 1) => drop(channel.receiver().map(|receiver| receiver.poison())),
            (Some(channel), _) => channel.lose(random),
            (None, 0) => drop(self.calls.sender().map(|client| client.poison())),
            (None, _) => self.calls.lose(random),
        }
    }

    /// A new operation of this kind, if its ends are there.
    pub(crate) fn operation(
        self: &Arc<Self>,
        kind: usize,
        random: &mut Random,
    ) -> Option<Operation> {
        let channel = &self.channels[random.below(3)];
        let rendezvous = &self.channels[0];
        let panics = self.values_panic && random.chance(40);
        // Made only where it is used: if the drop of an unused one panicked, the compiler would
        // forget what is returned (rust-lang/rust#47949).
        let value = move || Value::new(panics);
        // Where an operation that has a value beside its output is dropped with that, for the same
        // reason.
        let calm = || Value::new(false);
        let time = Duration::from_micros(random.next() % 300);
        let strikes = random.chance(40);
        let world = self.clone();
        match kind {
            0 => Operation::new(channel.sender()?, |sender| sender.send(value())),
            1 => Operation::new(rendezvous.sender()?, |sender| sender.send(value())),
            2 => Operation::new((channel.sender()?, Some(value())), |(sender, slot)| {
                sender.send_from(slot)
            }),
            3 => Operation::new(channel.sender()?, |sender| {
                sender.send_with(move || {
                    let value = value();
                    if strikes {
                        strike();
                    }
                    value
                })
            }),
            4 => Operation::new(channel.receiver()?, |receiver| receiver.recv()),
            5 => Operation::new(rendezvous.receiver()?, |receiver| receiver.recv()),
            6 => Operation::new(channel.receiver()?, |receiver| receiver.recv_extended()),
            7 => Operation::new(channel.sender()?, |sender| sender.ended()),
            8 => Operation::new(channel.receiver()?, |receiver| receiver.poisoned()),
            9 => Operation::new(channel.receiver()?, |receiver| async {
                std::pin::pin!(receiver.stream()).next().await
            }),
            10 => Operation::new(
                (rendezvous.both()?, channel.both()?),
                |((left, from_left), (right, from_right))| async move {
                    alt! {
                        received = from_left.recv() => drop(received),
                        sent = right.send(calm()) => drop(sent),
                        received = from_right.recv_extended() => drop(received),
                        sent = left.send_with(move || { if strikes { strike(); } Value::new(false) }) => drop(sent),
                    }
                },
            ),
            11 => Operation::new(
                (rendezvous.both()?, world),
                |((sender, receiver), world)| async move {
                    pri_alt! {
                        () = world.barrier.sync() => {}
                        received = receiver.recv() => drop(received),
                        sent = sender.send(calm()) => drop(sent),
                    }
                },
            ),
            12 => Operation::new(
                [rendezvous.receiver()?, channel.receiver()?],
                |receivers| async {
                    let mut inputs = Alternative::fair(&*receivers);
                    let first = inputs.recv().await;
                    drop(first);
                    inputs.recv().await
                },
            ),
            13 => Operation::new(world, |world| world.barrier.sync()),
            14 => Operation::new(self.calls.sender()?, |client| client.call(value())),
            15 => Operation::new(self.calls.receiver()?, |server| server.accept()),
            16 => Operation::new(world, |world| world.mutex.lock()),
            17 => Operation::new(world, |world| world.semaphore.acquire()),
            18 => {
                let guard = self.mutex.try_lock();
                let guard = match guard {
                    Ok(guard) => guard,
                    Err(_) => return None,
                };
                // SAFETY: the world is kept as long as the operation is.
                let guard = unsafe {
                    mem::transmute::<
                        luna_channels::lock_sync::MutexGuard<'_, Value>,
                        luna_channels::lock_sync::MutexGuard<'static, Value>,
                    >(guard)
                };
                Operation::new(world, |world| world.condition.wait(guard))
            }
            _ if !self.has_timers() => None,
            19 => Operation::new(channel.sender()?, |sender| {
                sender.send_timeout(value(), time)
            }),
            20 => Operation::new(channel.receiver()?, |receiver| receiver.recv_timeout(time)),
            21 => Operation::new(world, |world| world.mutex.lock_timeout(time)),
            22 => Operation::new(world, |world| world.semaphore.acquire_timeout(time)),
            23 => Operation::new((), |()| luna_channels::after(time)),
            24 => Operation::new(rendezvous.both()?, |(sender, receiver)| async move {
                alt! {
                    received = receiver.recv() => drop(received),
                    sent = sender.send(calm()) => drop(sent),
                    () = luna_channels::after(time) => {}
                }
            }),
            25 => Operation::new(world, |world| async move {
                if let Ok(guard) = world.mutex.try_lock() {
                    drop(world.condition.wait_timeout(guard, time).await);
                }
            }),
            26 => {
                let executor = self.executor.as_ref()?;
                let spec = ProcessSpec::new("short");
                let process = executor.spawn(spec, || async { yield_now().await });
                Operation::new(process, |process| process.join())
            }
            _ => Operation::new((), |()| blocking(|| 7)),
        }
    }
}
