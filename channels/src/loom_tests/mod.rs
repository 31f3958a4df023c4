//! The protocol under every interleaving of two or three threads: the channel's own code over
//! loom's lock and atomics.
//!
//! ```text
//! RUSTFLAGS="--cfg loom" cargo test -p luna-channels --release --lib
//! ```
//!
//! Explored exhaustively up to three preemptions of a thread (waiting and ending are none), or as
//! many as `LOOM_MAX_PREEMPTIONS` says: five find nothing else and take twenty times as long. loom
//! watches the value in each node and all atomics; the links of waiting lists are plain memory to
//! it, guarded by the lock.
//!
//! With `--cfg shuttle` beside it, the same models, and the larger ones in `large`, run under many
//! random schedules instead: see `schedules`.

mod alternative;
mod barrier;
mod call;
mod channel;
mod extended;
mod fast_path;
mod hand_off_slots;
#[cfg(shuttle)]
mod large;
mod lock_sync;
mod registered;
#[cfg(shuttle)]
mod schedules;

use crate::{Receiver, RecvError, RecvOp, SendOp, Sender};
use loom::future::block_on;
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll, Waker};

fn check(model: impl Fn() + Send + Sync + 'static) {
    check_within(3, model);
}

/// For models of more threads, that take longer: fewer preemptions.
#[cfg(not(shuttle))]
fn check_within(preemptions: usize, model: impl Fn() + Send + Sync + 'static) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound.get_or_insert(preemptions);
    builder.check(model);
}

/// A random schedule has as many preemptions as it has.
#[cfg(shuttle)]
fn check_within(_preemptions: usize, model: impl Fn() + Send + Sync + 'static) {
    schedules::check(model);
}

/// Counts its drops, with an atomic that loom does not watch, since it takes no part in the
/// protocol.
struct Token {
    id: usize,
    drops: Arc<AtomicUsize>,
}

impl Drop for Token {
    fn drop(&mut self) {
        self.drops.fetch_add(1, Ordering::SeqCst);
    }
}

#[derive(Clone, Default)]
struct Drops(Arc<AtomicUsize>);

impl Drops {
    fn token(&self, id: usize) -> Token {
        Token {
            id,
            drops: self.0.clone(),
        }
    }

    fn count(&self) -> usize {
        self.0.load(Ordering::SeqCst)
    }
}

fn poll<F: Future>(future: &mut Pin<Box<F>>) -> Poll<F::Output> {
    future
        .as_mut()
        .poll(&mut Context::from_waker(Waker::noop()))
}

/// Receives a token and returns its number.
fn recv_id(receiver: &Receiver<Token>) -> Result<usize, RecvError> {
    block_on(receiver.recv()).map(|token| token.id)
}

/// A receive that waits already.
fn waiting_recv<T>(receiver: &Receiver<T>) -> Pin<Box<RecvOp<'_, T>>> {
    let mut recv = Box::pin(receiver.recv());
    assert!(poll(&mut recv).is_pending());
    recv
}

/// A send that waits already.
fn waiting_send<T>(sender: &Sender<T>, value: T) -> Pin<Box<SendOp<'_, T>>> {
    let mut send = Box::pin(sender.send(value));
    assert!(poll(&mut send).is_pending());
    send
}
