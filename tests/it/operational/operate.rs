//! Plain operations as a user writes them, and what they come to.

use crate::operational::network::{Failure, Form, Guard, Outcome, Patience, Value};
use crate::operational::play::Ends;
use futures_lite::future::or;
use luna::{
    Receiver, RecvError, RecvTimeoutError, SendError, SendTimeoutError, Sender, TryRecvError,
    TrySendError,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// A send or a receive alone.
pub(crate) async fn plain(
    ends: &Ends,
    guard: Guard,
    patience: Patience,
    blocking: bool,
) -> Outcome {
    match (guard, patience) {
        (Guard::Recv { channel }, _) => recv(ends.receiver(channel), patience, blocking).await,
        (
            Guard::Send {
                channel,
                value,
                form: form @ (Form::From | Form::With),
            },
            Patience::Forever,
        ) if !blocking => send_by(form, ends.sender(channel), value).await,
        (Guard::Send { channel, value, .. }, _) => {
            send(ends.sender(channel), value, patience, blocking).await
        }
        (Guard::Sync { .. } | Guard::After(_), _) => unreachable!("no plain operation"),
    }
}

async fn send_by(form: Form, sender: &Sender<Value>, value: Value) -> Outcome {
    let (mut slot, made) = (Some(value), Arc::new(AtomicU32::new(0)));
    let count = made.clone();
    let make = move || {
        count.fetch_add(1, Ordering::Relaxed);
        value
    };
    let result = match form {
        Form::From => sender.send_from(&mut slot).await,
        _ => sender.send_with(make).await,
    };
    let taken = match form {
        Form::From => u32::from(slot.is_none()),
        _ => made.load(Ordering::Relaxed),
    };
    match result {
        Ok(()) if taken == 1 => Outcome::Sent(0),
        Err(error) if taken == 0 => Outcome::Failed(0, failure(error.is_poisoned())),
        _ => Outcome::Broken("a value was taken that was not sent, or not taken once that was"),
    }
}

async fn send(sender: &Sender<Value>, value: Value, patience: Patience, blocking: bool) -> Outcome {
    match patience {
        Patience::Forever if blocking => sent(0, value, sender.blocking_send(value)),
        Patience::Forever => sent(0, value, sender.send(value).await),
        Patience::Timeout(micros) => {
            let after = Duration::from_micros(micros.into());
            let back = match sender.send_timeout(value, after).await {
                Ok(()) => return Outcome::Sent(0),
                Err(SendTimeoutError::Timeout(back)) => (back, Outcome::Expired(1)),
                Err(SendTimeoutError::Closed(back)) => (back, Outcome::Failed(0, Failure::Closed)),
                Err(SendTimeoutError::Poisoned(back)) => {
                    (back, Outcome::Failed(0, Failure::Poisoned))
                }
            };
            given_back(value, back.0, back.1)
        }
        Patience::Dropped(micros) => {
            let send = async { sent(0, value, sender.send(value).await) };
            dropping(send, micros, Outcome::Expired(1)).await
        }
        Patience::Try => {
            let back = match sender.try_send(value) {
                Ok(()) => return Outcome::Sent(0),
                Err(TrySendError::Full(back)) => (back, Outcome::Skipped),
                Err(TrySendError::Closed(back)) => (back, Outcome::Failed(0, Failure::Closed)),
                Err(TrySendError::Poisoned(back)) => (back, Outcome::Failed(0, Failure::Poisoned)),
            };
            given_back(value, back.0, back.1)
        }
    }
}

async fn recv(receiver: &Receiver<Value>, patience: Patience, blocking: bool) -> Outcome {
    match patience {
        Patience::Forever if blocking => received(0, receiver.blocking_recv()),
        Patience::Forever => received(0, receiver.recv().await),
        Patience::Timeout(micros) => {
            let after = Duration::from_micros(micros.into());
            match receiver.recv_timeout(after).await {
                Ok(value) => Outcome::Received(0, value),
                Err(RecvTimeoutError::Timeout) => Outcome::Expired(1),
                Err(RecvTimeoutError::Closed) => Outcome::Failed(0, Failure::Closed),
                Err(RecvTimeoutError::Poisoned) => Outcome::Failed(0, Failure::Poisoned),
            }
        }
        Patience::Dropped(micros) => {
            let recv = async { received(0, receiver.recv().await) };
            dropping(recv, micros, Outcome::Expired(1)).await
        }
        Patience::Try => match receiver.try_recv() {
            Ok(value) => Outcome::Received(0, value),
            Err(TryRecvError::Empty) => Outcome::Skipped,
            Err(TryRecvError::Closed) => Outcome::Failed(0, Failure::Closed),
            Err(TryRecvError::Poisoned) => Outcome::Failed(0, Failure::Poisoned),
        },
    }
}

/// Drops the operation when the time has come, whatever it has come to.
pub(crate) async fn dropping(
    operation: impl Future<Output = Outcome>,
    micros: u32,
    expired: Outcome,
) -> Outcome {
    let expiry = async {
        luna::after(Duration::from_micros(micros.into())).await;
        expired
    };
    or(expiry, operation).await
}

pub(crate) fn sent(place: u8, value: Value, result: Result<(), SendError<Value>>) -> Outcome {
    match result {
        Ok(()) => Outcome::Sent(place),
        Err(error) => {
            let outcome = Outcome::Failed(place, failure(error.is_poisoned()));
            given_back(value, error.into_inner(), outcome)
        }
    }
}

pub(crate) fn failure(is_poisoned: bool) -> Failure {
    if is_poisoned {
        Failure::Poisoned
    } else {
        Failure::Closed
    }
}

pub(crate) fn received(place: u8, result: Result<Value, RecvError>) -> Outcome {
    match result {
        Ok(value) => Outcome::Received(place, value),
        Err(RecvError::Closed) => Outcome::Failed(place, Failure::Closed),
        Err(RecvError::Poisoned) => Outcome::Failed(place, Failure::Poisoned),
    }
}

fn given_back(value: Value, back: Value, outcome: Outcome) -> Outcome {
    if value == back {
        outcome
    } else {
        Outcome::Broken("another value came back than was offered")
    }
}
