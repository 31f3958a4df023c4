//! Random sequences of operations, polled by hand on one thread, held against a sequential model of
//! a channel: after each step the results, the wakes, what was dropped and what is buffered are as
//! the model says.

#![cfg(not(loom))]

use crate::common;
mod model;

use common::{Ledger, Random, Token, Wakes};
use luna_channels::{
    Buffer, Receiver, RecvError, SendError, Sender, TryRecvError, TrySendError, buffered, channel,
};
use luna_core::current::{self, ExecutorId, Priority, Process, ProcessId};
use model::{Ending, Kind, Model, ModelOp, State};
use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

enum Op {
    Send(Pin<Box<dyn Future<Output = Result<(), SendError<Token>>>>>),
    Recv(Pin<Box<dyn Future<Output = Result<Token, RecvError>>>>),
}

struct RealOp {
    op: Op,
    wakes: Arc<Wakes>,
    waker: Waker,
}

/// Polls as a process of `priority`, as one that is outranked, or in a branch with a failed
/// sibling.
fn poll_as<T>(
    priority: Option<Priority>,
    outranked: bool,
    branch_failed: bool,
    poll: impl FnOnce() -> T,
) -> T {
    let branch = || current::with_branch_below(branch_failed, 0, 0, poll);
    let poll = || match priority {
        None => branch(),
        Some(Priority { thread, level }) => {
            // Without a waker of its own it is woken by that of the poll.
            let process = Process::new(ProcessId::new(), ExecutorId::new(), thread, level);
            // SAFETY: a process without a waker has no references to it, so it may be anywhere.
            unsafe { current::with_process(&process, branch) }
        }
    };
    match outranked {
        true => crate::common::beside_a_ready_process(31, poll),
        false => poll(),
    }
}

/// Prints what led to a failure.
struct History(Vec<String>);

impl Drop for History {
    fn drop(&mut self) {
        if std::thread::panicking() {
            println!("{}", self.0.join("\n"));
        }
    }
}

const STEPS: usize = 80;

fn run(random: &mut Random, kind: Kind, capacity: usize) {
    let (sender, receiver) = match (capacity, kind) {
        (0, _) => channel::<Token>(),
        (_, Kind::Fifo) => buffered(Buffer::fifo(capacity)),
        (_, Kind::Oldest) => buffered(Buffer::overwrite_oldest(capacity)),
        (_, Kind::Newest) => buffered(Buffer::overwrite_newest(capacity)),
    };
    let ledger = Ledger::new(STEPS);
    let mut model = Model::new(kind, capacity);
    let mut history = History(vec![format!("{kind:?} of {capacity}")]);
    let (mut senders, mut receivers): (Vec<Sender<Token>>, Vec<Receiver<Token>>) =
        (vec![sender], vec![receiver]);
    let mut ops: BTreeMap<usize, RealOp> = BTreeMap::new();
    let mut values = 0;
    for step in 0..STEPS {
        let action = random.below(100);
        let some_op = (!ops.is_empty()).then(|| *ops.keys().nth(random.below(ops.len())).unwrap());
        let mut note = |text: String| history.0.push(format!("{step}: {text}"));
        match (action, senders.last(), receivers.last(), some_op) {
            (0..15, Some(sender), _, _) => {
                let (sender, token) = (sender.clone(), ledger.token(values));
                note(format!("op {step} will send {values}"));
                let (wakes, waker) = Wakes::new();
                ops.insert(
                    step,
                    RealOp {
                        op: Op::Send(Box::pin(async move { sender.send(token).await })),
                        wakes,
                        waker,
                    },
                );
                model.ops.insert(
                    step,
                    ModelOp {
                        value: Some(values),
                        state: State::New,
                        wakes: 0,
                    },
                );
                model.sender_ends += 1;
                values += 1;
            }
            (15..30, _, Some(receiver), _) => {
                let receiver = receiver.clone();
                note(format!("op {step} will receive"));
                let (wakes, waker) = Wakes::new();
                ops.insert(
                    step,
                    RealOp {
                        op: Op::Recv(Box::pin(async move { receiver.recv().await })),
                        wakes,
                        waker,
                    },
                );
                model.ops.insert(
                    step,
                    ModelOp {
                        value: None,
                        state: State::New,
                        wakes: 0,
                    },
                );
                model.receiver_ends += 1;
            }
            (30..65, _, _, Some(id)) => {
                let priority = (random.below(3) > 0).then(|| Priority {
                    thread: random.below(2) as u8 * 50,
                    level: random.below(3) as u8,
                });
                let outranked = priority.is_some() && random.below(3) == 0;
                let branch_failed = random.below(15) == 0;
                let expected =
                    model.poll(id, priority.unwrap_or_default(), outranked, branch_failed);
                note(format!(
                    "poll op {id} as {priority:?}, outranked {outranked}, failed {branch_failed}: {expected:?}"
                ));
                let real = ops.get_mut(&id).unwrap();
                let mut cx = Context::from_waker(&real.waker);
                let mut dropped = None;
                let outcome = poll_as(priority, outranked, branch_failed, || match &mut real.op {
                    Op::Send(send) => send.as_mut().poll(&mut cx).map(|sent| match sent {
                        Ok(()) => Ok(None),
                        Err(error) => {
                            let ending = if error.is_poisoned() {
                                Ending::Poisoned
                            } else {
                                Ending::Closed
                            };
                            dropped = Some(error.into_inner().id);
                            Err(ending)
                        }
                    }),
                    Op::Recv(recv) => recv.as_mut().poll(&mut cx).map(|received| match received {
                        Ok(token) => Ok(Some(token.id)),
                        Err(RecvError::Poisoned) => Err(Ending::Poisoned),
                        Err(RecvError::Closed) => Err(Ending::Closed),
                    }),
                });
                assert_eq!(outcome, expected.map_or(Poll::Pending, Poll::Ready));
                if let Poll::Ready(outcome) = outcome {
                    ops.remove(&id);
                    // The test drops what it received, or got back.
                    model.dropped.extend(outcome.ok().flatten());
                    model.dropped.extend(dropped);
                }
            }
            (65..75, _, _, Some(id)) => {
                note(format!("drop op {id} in {:?}", model.ops[&id].state));
                drop(ops.remove(&id));
                model.drop_op(id);
            }
            (75..82, Some(sender), _, _) => {
                note(format!("try_send {values}"));
                let expected = model.send(values);
                let outcome = sender
                    .try_send(ledger.token(values))
                    .map_err(|error| match error {
                        TrySendError::Full(_) => Ending::Open,
                        TrySendError::Closed(_) => Ending::Closed,
                        TrySendError::Poisoned(_) => Ending::Poisoned,
                    });
                assert_eq!(outcome, expected);
                model.dropped.extend(expected.is_err().then_some(values));
                values += 1;
            }
            (82..89, _, Some(receiver), _) => {
                note("try_recv".to_owned());
                let outcome =
                    receiver
                        .try_recv()
                        .map(|token| token.id)
                        .map_err(|error| match error {
                            TryRecvError::Empty => Ending::Open,
                            TryRecvError::Closed => Ending::Closed,
                            TryRecvError::Poisoned => Ending::Poisoned,
                        });
                assert_eq!(outcome, model.recv());
                model.dropped.extend(outcome.ok());
            }
            (89..93, Some(sender), Some(receiver), _) => {
                note("clone both ends".to_owned());
                let ends = (sender.clone(), receiver.clone());
                senders.push(ends.0);
                receivers.push(ends.1);
                model.sender_ends += 1;
                model.receiver_ends += 1;
            }
            (93..96, Some(_), _, _) => {
                note("drop a sender".to_owned());
                senders.pop();
                model.drop_end(true);
            }
            (96..99, _, Some(_), _) => {
                note("drop a receiver".to_owned());
                receivers.pop();
                model.drop_end(false);
            }
            (99, _, Some(receiver), _) if random.below(3) == 0 => {
                note("poison".to_owned());
                receiver.poison();
                model.end(Ending::Poisoned);
            }
            _ => {}
        }
        for (id, real) in &ops {
            assert_eq!(
                real.wakes.count(),
                model.ops[id].wakes,
                "wakes of op {id} after step {step}"
            );
        }
        assert_eq!(
            ledger.dropped(),
            model.dropped.iter().copied().collect::<Vec<_>>(),
            "drops after step {step}"
        );
        if let Some(receiver) = receivers.last() {
            assert_eq!(receiver.buffered(), model.store.len(), "after step {step}");
        }
    }
    drop((ops, senders, receivers));
    assert_eq!(
        ledger.dropped(),
        (0..values).collect::<Vec<_>>(),
        "all that was made is dropped with the channel"
    );
}

#[test]
fn random_sequences_go_as_the_model_says() {
    let mut random = Random::seeded();
    let kinds = [
        (Kind::Fifo, 0),
        (Kind::Fifo, 1),
        (Kind::Fifo, 3),
        (Kind::Oldest, 1),
        (Kind::Oldest, 2),
        (Kind::Newest, 1),
        (Kind::Newest, 3),
    ];
    for _ in 0..300 {
        for (kind, capacity) in kinds {
            run(&mut random, kind, capacity);
        }
    }
}
