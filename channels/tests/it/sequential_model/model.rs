//! The specification: a channel as plain lists, one step after the other.

use luna_core::current::Priority;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Kind {
    Fifo,
    Oldest,
    Newest,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Ending {
    Open,
    Closed,
    Poisoned,
}

/// What an operation has come to in the model. Values are numbers; a send has its own in mind until
/// it is done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum State {
    New,
    Listed,
    /// Its partner came; a receive has a value.
    Done(Option<usize>),
    /// As `Done`, by its own poll, which let others run.
    GaveWay(Option<usize>),
    /// When its channel ended, or by its own poll, which let others run.
    Failed(Ending),
}

#[derive(Debug)]
pub(crate) struct ModelOp {
    /// The value of a send.
    pub(crate) value: Option<usize>,
    pub(crate) state: State,
    pub(crate) wakes: usize,
}

/// A channel.
#[derive(Debug)]
pub(crate) struct Model {
    pub(crate) kind: Kind,
    pub(crate) capacity: usize,
    pub(crate) store: VecDeque<usize>,
    pub(crate) senders: Vec<(Priority, usize)>,
    pub(crate) receivers: Vec<(Priority, usize)>,
    pub(crate) ops: BTreeMap<usize, ModelOp>,
    pub(crate) ending: Ending,
    pub(crate) sender_ends: usize,
    pub(crate) receiver_ends: usize,
    pub(crate) dropped: BTreeSet<usize>,
}

impl Model {
    /// An open channel with one end of each kind.
    pub(crate) fn new(kind: Kind, capacity: usize) -> Model {
        Model {
            kind,
            capacity,
            store: VecDeque::new(),
            senders: Vec::new(),
            receivers: Vec::new(),
            ops: BTreeMap::new(),
            ending: Ending::Open,
            sender_ends: 1,
            receiver_ends: 1,
            dropped: BTreeSet::new(),
        }
    }

    fn settle(&mut self, op: usize, state: State) {
        let op = self.ops.get_mut(&op).unwrap();
        op.state = state;
        op.wakes += 1;
    }

    /// `Ok` if it was sent, else whether it can be later.
    pub(crate) fn send(&mut self, value: usize) -> Result<(), Ending> {
        if self.ending != Ending::Open {
            return Err(self.ending);
        }
        if !self.receivers.is_empty() {
            let (_, receiver) = self.receivers.remove(0);
            self.settle(receiver, State::Done(Some(value)));
            return Ok(());
        }
        if self.store.len() >= self.capacity {
            let overwritten = match self.kind {
                Kind::Fifo => return Err(Ending::Open),
                Kind::Oldest => self.store.pop_front(),
                Kind::Newest => self.store.pop_back(),
            };
            self.dropped.extend(overwritten);
        }
        self.store.push_back(value);
        Ok(())
    }

    pub(crate) fn recv(&mut self) -> Result<usize, Ending> {
        if self.ending == Ending::Poisoned {
            return Err(Ending::Poisoned);
        }
        let stored = self.store.pop_front();
        let mut next = None;
        if !self.senders.is_empty() && (stored.is_none() || self.store.len() < self.capacity) {
            let (_, sender) = self.senders.remove(0);
            next = self.ops[&sender].value;
            self.settle(sender, State::Done(None));
        }
        match stored {
            Some(value) => {
                self.store.extend(next);
                Ok(value)
            }
            None => next.ok_or(self.ending),
        }
    }

    fn give_back(&mut self, value: usize) {
        if self.ending == Ending::Poisoned {
            self.dropped.insert(value);
        } else if self.receivers.is_empty() {
            self.store.push_front(value);
            if self.store.len() > self.capacity {
                // As if the value had never left.
                let overwritten = match self.kind {
                    Kind::Fifo => None,
                    Kind::Oldest => self.store.pop_front(),
                    Kind::Newest => self.store.remove(self.store.len() - 2),
                };
                self.dropped.extend(overwritten);
            }
        } else {
            let (_, receiver) = self.receivers.remove(0);
            self.settle(receiver, State::Done(Some(value)));
        }
    }

    fn list(&mut self, op: usize, priority: Priority) {
        let list = if self.ops[&op].value.is_some() {
            &mut self.senders
        } else {
            &mut self.receivers
        };
        let place = list
            .iter()
            .position(|(other, _)| *other < priority)
            .unwrap_or(list.len());
        list.insert(place, (priority, op));
        self.ops.get_mut(&op).unwrap().state = State::Listed;
    }

    fn unlist(&mut self, op: usize) {
        self.senders.retain(|(_, other)| *other != op);
        self.receivers.retain(|(_, other)| *other != op);
    }

    pub(crate) fn end(&mut self, ending: Ending) {
        if self.ending != Ending::Poisoned {
            self.ending = ending;
        }
        let waiting: Vec<_> = self
            .senders
            .drain(..)
            .chain(self.receivers.drain(..))
            .collect();
        for (_, op) in waiting {
            self.settle(op, State::Failed(ending));
        }
        if ending == Ending::Poisoned || self.receiver_ends == 0 {
            self.dropped.extend(self.store.drain(..));
        }
    }

    pub(crate) fn drop_end(&mut self, of_sender: bool) {
        let ends = if of_sender {
            &mut self.sender_ends
        } else {
            &mut self.receiver_ends
        };
        *ends -= 1;
        if *ends == 0 {
            self.end(Ending::Closed);
        }
    }

    /// A poll; `None` if it waits.
    pub(crate) fn poll(
        &mut self,
        op: usize,
        priority: Priority,
        outranked: bool,
        branch_failed: bool,
    ) -> Option<Result<Option<usize>, Ending>> {
        let value = self.ops[&op].value;
        let outcome = match self.ops[&op].state {
            State::Done(value) | State::GaveWay(value) => Ok(value),
            State::Failed(ending) => Err(ending),
            State::New if branch_failed && outranked => {
                self.settle(op, State::Failed(Ending::Poisoned));
                return None;
            }
            State::New | State::Listed if branch_failed => {
                self.unlist(op);
                Err(Ending::Poisoned)
            }
            State::Listed => return None,
            State::New => {
                let outcome = match value {
                    Some(value) => self.send(value).map(|()| None),
                    None => self.recv().map(Some),
                };
                match outcome {
                    Err(Ending::Open) => {
                        self.list(op, priority);
                        return None;
                    }
                    Ok(value) if outranked => {
                        self.settle(op, State::GaveWay(value));
                        return None;
                    }
                    Err(ending) if outranked => {
                        self.settle(op, State::Failed(ending));
                        return None;
                    }
                    outcome => outcome,
                }
            }
        };
        self.ops.remove(&op);
        self.drop_end(value.is_some());
        Some(outcome)
    }

    pub(crate) fn drop_op(&mut self, op: usize) {
        self.unlist(op);
        let op = self.ops.remove(&op).unwrap();
        match (op.value, op.state) {
            (Some(value), State::New | State::Listed | State::Failed(_)) => {
                self.dropped.insert(value);
            }
            (None, State::Done(Some(value)) | State::GaveWay(Some(value))) => self.give_back(value),
            _ => {}
        }
        self.drop_end(op.value.is_some());
    }
}
