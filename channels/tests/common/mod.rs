//! What the tests share: counted drops, counted wakes, polls by hand, random numbers with a seed,
//! and a watchdog.

#![allow(dead_code, unused_imports, reason = "each test file uses a part of it")]

#[path = "../../../tests/shared/mod.rs"]
mod shared;

pub(crate) use shared::{Random, Watchdog};
use std::fmt;
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll, Wake, Waker};

/// Counts the drops of numbered tokens.
#[derive(Clone)]
pub(crate) struct Ledger(Arc<Vec<AtomicUsize>>);

impl Ledger {
    /// For the tokens 0 to `tokens - 1`.
    pub(crate) fn new(tokens: usize) -> Self {
        Self(Arc::new((0..tokens).map(|_| AtomicUsize::new(0)).collect()))
    }

    /// Makes a token: once for each number.
    pub(crate) fn token(&self, id: usize) -> Token {
        Token {
            id,
            ledger: self.clone(),
        }
    }

    /// How often a token was dropped.
    pub(crate) fn drops(&self, id: usize) -> usize {
        self.0[id].load(Ordering::SeqCst)
    }

    /// Which tokens were dropped. Fails if one was dropped twice.
    #[track_caller]
    pub(crate) fn dropped(&self) -> Vec<usize> {
        for id in 0..self.0.len() {
            assert!(
                self.drops(id) <= 1,
                "token {id} was dropped {} times",
                self.drops(id)
            );
        }
        (0..self.0.len())
            .filter(|&id| self.drops(id) == 1)
            .collect()
    }

    /// Every token was dropped exactly once.
    #[track_caller]
    pub(crate) fn assert_all_dropped_once(&self) {
        for id in 0..self.0.len() {
            assert_eq!(self.drops(id), 1, "drops of token {id}");
        }
    }
}

/// A value with a counted drop. On the heap too, so that a double drop shows in a memory checker.
pub(crate) struct Token {
    pub(crate) id: usize,
    ledger: Ledger,
}

impl Drop for Token {
    fn drop(&mut self) {
        self.ledger.0[self.id].fetch_add(1, Ordering::SeqCst);
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "token {}", self.id)
    }
}

/// A waker that counts.
#[derive(Default)]
pub(crate) struct Wakes(AtomicUsize);

impl Wakes {
    pub(crate) fn new() -> (Arc<Wakes>, Waker) {
        let wakes = Arc::new(Wakes::default());
        (wakes.clone(), Waker::from(wakes))
    }

    pub(crate) fn count(&self) -> usize {
        self.0.load(Ordering::SeqCst)
    }
}

impl Wake for Wakes {
    fn wake(self: Arc<Self>) {
        self.0.fetch_add(1, Ordering::SeqCst);
    }
}

/// Polls once with `waker`.
pub(crate) fn poll_with<F: Future + ?Sized>(
    future: &mut Pin<Box<F>>,
    waker: &Waker,
) -> Poll<F::Output> {
    future.as_mut().poll(&mut Context::from_waker(waker))
}

/// Polls once; its waker wakes no task.
pub(crate) fn poll<F: Future + ?Sized>(future: &mut Pin<Box<F>>) -> Poll<F::Output> {
    poll_with(future, Waker::noop())
}

/// Polls once and expects that the future waits.
#[track_caller]
pub(crate) fn pending<F: Future + ?Sized>(future: &mut Pin<Box<F>>) {
    assert!(poll(future).is_pending(), "was expected to wait");
}

/// Polls once and expects the result.
#[track_caller]
pub(crate) fn ready<F: Future + ?Sized>(future: &mut Pin<Box<F>>) -> F::Output {
    match poll(future) {
        Poll::Ready(output) => output,
        Poll::Pending => panic!("was expected to be done"),
    }
}

/// Gives way to other threads until so many wait at the place of this name.
pub(crate) fn until_waiting(name: &str, count: usize) {
    let waiting = || {
        let places = luna_channels::inspect::wait_points();
        let place = places
            .iter()
            .find(|place| place.name.as_deref() == Some(name));
        place.map_or(0, |place| place.waiting.len())
    };
    while waiting() != count {
        std::thread::yield_now();
    }
}

/// Calls `f` while a process of this level is ready on this thread, which has no other: operations
/// that complete at once let it run.
pub(crate) fn beside_a_ready_process<R>(level: u8, f: impl FnOnce() -> R) -> R {
    use luna_core::current::{self, ExecutorId, Methods, Process, ProcessId, QueueEnd};
    use std::ptr::NonNull;

    static METHODS: Methods = Methods::without_body(|_, _| {}, |_| {});
    let process = Process::new(ProcessId::new(), ExecutorId::new(), 0, level);
    let process = NonNull::from(&process);
    // SAFETY: the process stays where it is, is never polled, and is taken out before it dies: it
    // is the only one that is ready on this thread.
    unsafe {
        Process::set_methods(process, &METHODS);
        process.as_ref().ready_at(level, QueueEnd::Back);
        let result = f();
        assert_eq!(current::next_ready(), Some(process));
        result
    }
}
