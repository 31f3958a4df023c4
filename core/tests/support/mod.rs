//! What the tests share: a watchdog, things to wait at, counters and seeded numbers.

#![allow(
    dead_code,
    unreachable_pub,
    unused_imports,
    missing_debug_implementations,
    reason = "each test is a program that uses a part"
)]

#[path = "../../../tests/shared/mod.rs"]
#[macro_use]
mod shared;

use luna_core::Executor;
use luna_platform::thread::Attributes;
pub(crate) use shared::{Random, Watchdog, skip, watchdog};
use std::future::Future;
use std::pin::Pin;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Waker};

/// An executor, held, without a real-time policy.
pub fn executor() -> Executor {
    Executor::start(Attributes::new("test")).unwrap()
}

/// Gives way to other threads until `condition` holds.
pub fn until(mut condition: impl FnMut() -> bool) {
    while !condition() {
        std::thread::yield_now();
    }
}

/// What happened, in order.
#[derive(Debug)]
pub struct Log<T>(Arc<Mutex<Vec<T>>>);

impl<T> Clone for Log<T> {
    fn clone(&self) -> Self {
        Log(self.0.clone())
    }
}

impl<T> Log<T> {
    pub fn new() -> Self {
        Log(Arc::default())
    }

    pub fn add(&self, entry: T) {
        self.0.lock().unwrap().push(entry);
    }

    pub fn len(&self) -> usize {
        self.0.lock().unwrap().len()
    }

    pub fn take(&self) -> Vec<T> {
        std::mem::take(&mut self.0.lock().unwrap())
    }
}

/// Counts how often its clones were dropped.
#[derive(Debug, Default)]
pub struct Drops(Arc<AtomicUsize>);

impl Drops {
    pub fn count(&self) -> usize {
        self.0.load(Ordering::SeqCst)
    }

    /// A value that counts when it is dropped.
    pub fn token(&self) -> Token {
        Token(self.0.clone())
    }
}

#[derive(Debug)]
pub struct Token(Arc<AtomicUsize>);

impl Drop for Token {
    fn drop(&mut self) {
        self.0.fetch_add(1, Ordering::SeqCst);
    }
}

/// Keeps each arrival until it is opened, from any thread. It uses wakers, as other people's
/// futures do.
#[derive(Clone, Default)]
pub struct Gate(Arc<Mutex<State>>);

#[derive(Default)]
struct State {
    is_open: bool,
    waiting: Vec<Waker>,
}

impl Gate {
    pub fn open(&self) {
        let waiting = {
            let mut state = self.0.lock().unwrap();
            state.is_open = true;
            std::mem::take(&mut state.waiting)
        };
        waiting.into_iter().for_each(Waker::wake);
    }

    /// How many wakers it holds.
    pub fn waiting(&self) -> usize {
        self.0.lock().unwrap().waiting.len()
    }

    /// Copies of the wakers that it holds.
    pub fn wakers(&self) -> Vec<Waker> {
        self.0.lock().unwrap().waiting.clone()
    }

    pub fn pass(&self) -> Pass {
        Pass(self.clone())
    }
}

pub struct Pass(Gate);

impl Future for Pass {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let mut state = self.0.0.lock().unwrap();
        if state.is_open {
            return Poll::Ready(());
        }
        state.waiting.push(cx.waker().clone());
        Poll::Pending
    }
}

/// Polls once.
pub async fn poll_once<F: Future + Unpin>(future: &mut F) -> Option<F::Output> {
    std::future::poll_fn(|cx| {
        Poll::Ready(match Pin::new(&mut *future).poll(cx) {
            Poll::Ready(output) => Some(output),
            Poll::Pending => None,
        })
    })
    .await
}

/// How often the stress tests go round: fewer times under an instrument that slows them down.
pub fn rounds(usual: usize) -> usize {
    std::env::var("LUNA_STRESS")
        .ok()
        .and_then(|percent| percent.parse::<usize>().ok())
        .map_or(usual, |percent| (usual * percent / 100).max(1))
}

/// The messages of panics that tests cause on purpose do not belong in the output.
pub fn quiet_panics() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        let usual = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            let text = info.payload_as_str().unwrap_or_default();
            if !text.starts_with("on purpose") {
                usual(info);
            }
        }));
    });
}
