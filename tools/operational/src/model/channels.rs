//! What communication does to channels, and to the agents that wait on them.

use super::{Phase, State, Waiter};
use crate::network::{End, Failure, Guard, Kind, Network, Outcome, Side, Value};

impl State {
    /// Does a communication that is ready.
    pub(super) fn take(&mut self, network: &Network, number: usize, place: u8, guard: Guard) {
        let outcome = match guard {
            Guard::Send { channel, value, .. } => match self.channels[channel].ended {
                Some(failure) => Outcome::Failed(place, failure),
                None => {
                    self.put(network.channels[channel], channel, value);
                    Outcome::Sent(place)
                }
            },
            Guard::Recv { channel } => match self.get(network, channel) {
                Ok(value) => Outcome::Received(place, value),
                Err(failure) => {
                    let is_registered = self.is_registered(network, number);
                    let left_out = &mut self.agents[number].left_out;
                    if is_registered && let Err(at) = left_out.binary_search(&channel) {
                        left_out.insert(at, channel);
                    }
                    Outcome::Failed(place, failure)
                }
            },
            Guard::Sync { barrier } => {
                for Waiter { agent, guard } in std::mem::take(&mut self.barriers[barrier]) {
                    self.settle(usize::from(agent), Outcome::Synced(guard));
                }
                Outcome::Synced(place)
            }
            Guard::After(_) => unreachable!("a timeout is no communication"),
        };
        self.agents[number].phase = Phase::Settled(outcome);
    }

    fn put(&mut self, kind: Kind, number: usize, value: Value) {
        let channel = &mut self.channels[number];
        if let Some(Waiter { agent, guard }) = channel.receivers.first().copied() {
            self.settle(usize::from(agent), Outcome::Received(guard, value));
            return;
        }
        if channel.store.len() >= kind.capacity() {
            match kind {
                Kind::OverwriteOldest(_) => drop(channel.store.remove(0)),
                Kind::OverwriteNewest(_) => drop(channel.store.pop()),
                Kind::Rendezvous | Kind::Fifo(_) => unreachable!("it was ready"),
            }
        }
        channel.store.push(value);
    }

    fn get(&mut self, network: &Network, number: usize) -> Result<Value, Failure> {
        let channel = &mut self.channels[number];
        if channel.ended == Some(Failure::Poisoned) {
            return Err(Failure::Poisoned);
        }
        if !channel.store.is_empty() {
            let value = channel.store.remove(0);
            // A sender that waited for room moves up.
            if channel.store.len() < network.channels[number].capacity()
                && let Some(next) = self.take_waiting_sender(network, number)
            {
                self.channels[number].store.push(next);
            }
            return Ok(value);
        }
        self.take_waiting_sender(network, number)
            .ok_or(Failure::Closed)
    }

    fn take_waiting_sender(&mut self, network: &Network, number: usize) -> Option<Value> {
        let Waiter { agent, guard } = *self.channels[number].senders.first()?;
        let agent = usize::from(agent);
        let offers = self.open_guards(network, agent);
        let offered = offers.iter().find(|(place, _)| *place == guard);
        let Some((_, Guard::Send { value, .. })) = offered else {
            unreachable!("a sender waits by an output guard");
        };
        let value = *value;
        self.settle(agent, Outcome::Sent(guard));
        Some(value)
    }

    /// A waiting agent goes on with this outcome: none of its guards is offered any more.
    pub(super) fn settle(&mut self, number: usize, outcome: Outcome) {
        self.withdraw(number, |_| true);
        self.agents[number].phase = Phase::Settled(outcome);
    }

    /// A waiting agent withdraws these guards.
    pub(super) fn withdraw(&mut self, number: usize, which: impl Fn(u8) -> bool) {
        let stays = |waiter: &Waiter| usize::from(waiter.agent) != number || !which(waiter.guard);
        for channel in &mut self.channels {
            channel.senders.retain(stays);
            channel.receivers.retain(stays);
        }
        for barrier in &mut self.barriers {
            barrier.retain(stays);
        }
    }

    /// Notifies an `Alternative` that a guard is ready.
    pub(super) fn look_again(&mut self, number: usize) {
        self.settle(number, Outcome::Done);
        self.agents[number].phase = Phase::Begun;
    }

    pub(super) fn settled(&self, number: usize, outcome: Outcome) -> State {
        self.changed(|after| after.agents[number].phase = Phase::Settled(outcome))
    }

    /// Offers all its guards: behind those of its level, before those below. Within one level,
    /// offers that stay registered come last.
    pub(super) fn waiting(&self, network: &Network, number: usize) -> State {
        let mut after = self.clone();
        after.agents[number].phase = Phase::Waiting;
        let rank = |number: usize| {
            let is_last = self.is_registered(network, number);
            (network.agents[number].level, !is_last)
        };
        for (guard, offered) in self.open_guards(network, number) {
            let waiter = Waiter {
                agent: number as u8,
                guard,
            };
            if let Guard::Sync { barrier } = offered {
                // An agent that offers the barrier twice comes once.
                let come = &mut after.barriers[barrier];
                if come.iter().all(|other| other.agent != waiter.agent) {
                    come.push(waiter);
                }
            }
            let Some(end) = offered.end() else { continue };
            let channel = &mut after.channels[end.channel];
            let list = match end.side {
                Side::Sender => &mut channel.senders,
                Side::Receiver => &mut channel.receivers,
            };
            let place = list
                .iter()
                .position(|other| rank(usize::from(other.agent)) < rank(number))
                .unwrap_or(list.len());
            list.insert(place, waiter);
        }
        after
    }

    /// The future of an operation is dropped when its partner has already gone on. A value that the
    /// operation received goes back to the head of the channel; a value that it sent stays sent.
    pub(super) fn give_back(&mut self, network: &Network, number: usize, outcome: Outcome) {
        let step = &network.agents[number].steps[usize::from(self.agents[number].step)];
        let expired = step.dropped_at().expect("only such a step is dropped");
        self.agents[number].phase = Phase::Settled(Outcome::Expired(expired));
        let Outcome::Received(guard, value) = outcome else {
            return;
        };
        let guards = self.open_guards(network, number);
        let received = guards.iter().find(|(place, _)| *place == guard);
        let Some(&(_, Guard::Recv { channel: place })) = received else {
            unreachable!("only a receive receives");
        };
        let channel = &mut self.channels[place];
        if channel.ended == Some(Failure::Poisoned) {
            return;
        }
        if let Some(Waiter { agent, guard }) = channel.receivers.first().copied() {
            self.settle(usize::from(agent), Outcome::Received(guard, value));
            return;
        }
        channel.store.insert(0, value);
        let kind = network.channels[place];
        // As if the value had never left.
        match kind {
            Kind::OverwriteOldest(capacity) if channel.store.len() > capacity => {
                channel.store.remove(0);
            }
            Kind::OverwriteNewest(capacity) if channel.store.len() > capacity => {
                channel.store.remove(channel.store.len() - 2);
            }
            _ => {}
        }
    }

    pub(super) fn drop_end(&mut self, number: usize, end: End) {
        let channel = &mut self.channels[end.channel];
        let ends = match end.side {
            Side::Sender => &mut channel.sender_ends,
            Side::Receiver => &mut channel.receiver_ends,
        };
        *ends -= 1;
        if *ends == 0 {
            self.end(number, end.channel, Failure::Closed);
        }
    }

    /// From now on each arriving agent sees that the channel has ended. The waiting agents are
    /// notified one by one.
    pub(super) fn end(&mut self, number: usize, place: usize, failure: Failure) {
        let channel = &mut self.channels[place];
        if channel.ended == Some(Failure::Poisoned) {
            return;
        }
        channel.ended = Some(failure);
        if failure == Failure::Poisoned || channel.receiver_ends == 0 {
            channel.store.clear();
        }
        self.agents[number].ending = Some((place as u8, failure));
        self.stop_telling(number);
    }

    pub(super) fn notify_one(
        &mut self,
        network: &Network,
        number: usize,
        place: u8,
        failure: Failure,
    ) {
        let channel = &self.channels[usize::from(place)];
        let mut waiting = channel.senders.iter().chain(&channel.receivers);
        if let Some(&Waiter { agent, guard }) = waiting.next() {
            let agent = usize::from(agent);
            if self.is_registered(network, agent) {
                self.look_again(agent);
            } else {
                self.settle(agent, Outcome::Failed(guard, failure));
            }
        }
        self.stop_telling(number);
    }

    fn stop_telling(&mut self, number: usize) {
        if let Some((place, _)) = self.agents[number].ending {
            let channel = &self.channels[usize::from(place)];
            if channel.senders.is_empty() && channel.receivers.is_empty() {
                self.agents[number].ending = None;
            }
        }
    }
}
