//! The operational semantics: what state a network is in, and which steps it may take from there.
//!
//! A state holds, for each channel, what is stored and which agents wait, in order; for each agent,
//! its current step and how far it has come. Three actions of an agent are visible to all: it
//! begins a step, learns the outcome of the step, and leaves ([`State::note`]). Between them lie
//! *internal* steps ([`State::internal`]), each of which happens at one instant. An operation is
//! tried, and either communicates or waits where its partners find it. A timeout fires. An end is
//! dropped. An agent that waits on a channel learns that the channel has ended. An alternative is
//! tried at one instant, too: this makes `pri_alt!` exact, and `skip` a statement about all its
//! guards. A state without internal steps, in which every agent is in a step of its own, is
//! *stable*. Its agents refuse all that they do not offer. If some agents have not left, it is a
//! deadlock.

mod channels;
mod steps;

use crate::network::{
    Agent, Chosen, End, Entry, Event, Failure, Guard, Kind, Network, Outcome, Side, Step, Value,
};

/// An agent that waits on a channel, and the place of the guard by which it waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Waiter {
    agent: u8,
    guard: u8,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Channel {
    store: Vec<Value>,
    senders: Vec<Waiter>,
    receivers: Vec<Waiter>,
    ended: Option<Failure>,
    sender_ends: u8,
    receiver_ends: u8,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Phase {
    /// A branch of a parallel construct that has not begun.
    Unstarted,
    /// About to begin its next step, or to leave.
    Between,
    /// Its operation was called, and has not been tried.
    Begun,
    /// An `Alternative` that found nothing ready and does not wait yet: no partner finds it.
    Opening,
    /// In the lists of all its open guards, or until its branches have left.
    Waiting,
    /// Its operation has come to this, and it does not know yet.
    Settled(Outcome),
    /// Drops the end at this place next; then it has ended as `failed` says.
    Leaving {
        next: u8,
        failed: bool,
    },
    Left {
        failed: bool,
    },
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Status {
    step: u8,
    phase: Phase,
    /// What its fair alternatives have chosen, the last one last.
    chosen: Vec<Chosen>,
    /// The channels that its `Alternative` has found ended, in order. They are not chosen from
    /// again until all have ended.
    left_out: Vec<usize>,
    /// A channel that this agent has ended. It notifies the agents that wait there one by one, and
    /// has come to this one.
    ending: Option<(u8, Failure)>,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct State {
    channels: Vec<Channel>,
    agents: Vec<Status>,
    /// For each barrier, the agents that have come, or offer to.
    barriers: Vec<Vec<Waiter>>,
}

impl State {
    pub fn initial(network: &Network) -> State {
        let count = |end: End| {
            let holders = network
                .agents
                .iter()
                .filter(|agent| agent.ends.contains(&end));
            holders.count() as u8
        };
        let channel = |channel: usize| Channel {
            store: Vec::new(),
            senders: Vec::new(),
            receivers: Vec::new(),
            ended: None,
            sender_ends: count(End {
                channel,
                side: Side::Sender,
            }),
            receiver_ends: count(End {
                channel,
                side: Side::Receiver,
            }),
        };
        let mut state = State {
            channels: (0..network.channels.len()).map(channel).collect(),
            agents: Vec::new(),
            barriers: vec![Vec::new(); network.barriers.len()],
        };
        for agent in &network.agents {
            let (step, phase) = match agent.parent {
                None => before_step(agent, 0),
                Some(_) => (0, Phase::Unstarted),
            };
            state.agents.push(Status {
                step,
                phase,
                chosen: Vec::new(),
                left_out: Vec::new(),
                ending: None,
            });
        }
        // A channel is made with one end of each side. Ends that no agent has are dropped before
        // any agent runs.
        for channel in &mut state.channels {
            if channel.sender_ends == 0 || channel.receiver_ends == 0 {
                channel.ended = Some(Failure::Closed);
            }
        }
        state
    }

    /// What an agent does by itself; `None` if it cannot do that here.
    pub fn note(&self, network: &Network, entry: Entry) -> Option<State> {
        let status = &self.agents[entry.agent];
        let agent = &network.agents[entry.agent];
        if status.ending.is_some() {
            return None;
        }
        let (step, phase) = match (entry.event, status.phase) {
            (Event::Begins(step), Phase::Between) if step == status.step => (step, Phase::Begun),
            // Its partner may have come in the meantime.
            (Event::Waits, Phase::Waiting | Phase::Settled(_)) => (status.step, status.phase),
            // It is about to be dropped where it waits.
            (
                Event::Waits,
                Phase::Leaving {
                    next: 0,
                    failed: true,
                },
            ) => (status.step, status.phase),
            // An alternative that stays registered may have been notified to look again.
            (Event::Waits, Phase::Begun | Phase::Opening)
                if self.is_registered(network, entry.agent) =>
            {
                (status.step, status.phase)
            }
            (Event::Ends(outcome), Phase::Settled(settled)) if outcome == settled => {
                if outcome.is_failure()
                    && (agent.strict || agent.steps[usize::from(status.step)] == Step::Fail)
                {
                    (
                        status.step,
                        Phase::Leaving {
                            next: 0,
                            failed: true,
                        },
                    )
                } else {
                    before_step(agent, status.step + 1)
                }
            }
            (Event::Leaves, Phase::Leaving { next, failed })
                if usize::from(next) == self.ends_to_drop(network, entry.agent).len() =>
            {
                (status.step, Phase::Left { failed })
            }
            _ => return None,
        };
        let chosen = match entry.event {
            Event::Ends(outcome) => chosen_by(&agent.steps[usize::from(status.step)], outcome),
            _ => None,
        };
        let mut after = self.clone();
        let status = &mut after.agents[entry.agent];
        if let Event::Begins(step) = entry.event
            && is_first_selection(agent, usize::from(step))
        {
            status
                .chosen
                .retain(|past| !matches!(past, Chosen::Input(_)));
            status.left_out.clear();
        }
        (status.step, status.phase) = (step, phase);
        if let Some(end) = chosen {
            status.chosen.retain(|&other| other != end);
            status.chosen.push(end);
        }
        Some(after)
    }

    /// What the agent may do by itself here; beside that, it may find that it has to wait.
    pub fn notes(&self, network: &Network, agent: usize) -> Option<Event> {
        let status = &self.agents[agent];
        match status.phase {
            _ if status.ending.is_some() => None,
            Phase::Between => Some(Event::Begins(status.step)),
            Phase::Settled(outcome) => Some(Event::Ends(outcome)),
            Phase::Leaving { next, .. }
                if usize::from(next) == self.ends_to_drop(network, agent).len() =>
            {
                Some(Event::Leaves)
            }
            _ => None,
        }
    }

    /// Whether the agent's outcome may yet change, so that learning it is a choice.
    pub fn may_withdraw(&self, network: &Network, agent: usize) -> bool {
        let status = &self.agents[agent];
        let Phase::Settled(outcome) = status.phase else {
            return false;
        };
        let dropped_at = network.agents[agent].steps[usize::from(status.step)].dropped_at();
        dropped_at.is_some_and(|place| outcome != Outcome::Expired(place))
    }

    /// Whether nothing can happen any more.
    pub fn is_final(&self, network: &Network) -> bool {
        let mut next = Vec::new();
        self.internal(network, &mut next);
        next.is_empty() && (0..self.agents.len()).all(|agent| self.notes(network, agent).is_none())
    }

    /// Whether all processes have left: of a final state, that it is no deadlock.
    pub fn all_left(&self, network: &Network) -> bool {
        network
            .processes()
            .all(|agent| matches!(self.agents[agent].phase, Phase::Left { .. }))
    }

    fn changed(&self, change: impl FnOnce(&mut State)) -> State {
        let mut after = self.clone();
        change(&mut after);
        after
    }

    /// Whether the agent selects by an `Alternative`.
    fn is_registered(&self, network: &Network, number: usize) -> bool {
        let step = usize::from(self.agents[number].step);
        let step = network.agents[number].steps.get(step);
        matches!(step, Some(Step::Registered { .. }))
    }

    /// The guards of the agent's step that have no false precondition, with their places.
    fn open_guards(&self, network: &Network, number: usize) -> Vec<(u8, Guard)> {
        match &network.agents[number].steps[usize::from(self.agents[number].step)] {
            Step::Plain(guard, _) => vec![(0, *guard)],
            Step::Registered { inputs, .. } => {
                let left_out = &self.agents[number].left_out;
                let guards = inputs.iter().map(|&channel| Guard::Recv { channel });
                let is_open = |channel: &usize| !left_out.contains(channel);
                let all_ended = !inputs.iter().any(is_open);
                (0..)
                    .zip(guards)
                    .filter(|(place, _)| all_ended || is_open(&inputs[usize::from(*place)]))
                    .collect()
            }
            Step::Sync(barrier) => vec![(0, Guard::Sync { barrier: *barrier })],
            Step::Alternative { offers, .. } => (0..)
                .zip(offers)
                .filter(|(_, offer)| offer.open)
                .map(|(place, offer)| (place, offer.guard))
                .collect(),
            _ => Vec::new(),
        }
    }

    /// Whether a communication would end at once, be it by failing.
    fn is_ready(&self, network: &Network, guard: Guard) -> bool {
        match guard {
            Guard::After(_) => false,
            Guard::Sync { barrier } => {
                self.barriers[barrier].len() + 1 >= network.barriers[barrier]
            }
            Guard::Recv { channel } => {
                let channel = &self.channels[channel];
                channel.ended.is_some() || !channel.store.is_empty() || !channel.senders.is_empty()
            }
            Guard::Send {
                channel: number, ..
            } => {
                let channel = &self.channels[number];
                let kind = network.channels[number];
                channel.ended.is_some()
                    || !channel.receivers.is_empty()
                    || channel.store.len() < kind.capacity()
                    || matches!(kind, Kind::OverwriteOldest(_) | Kind::OverwriteNewest(_))
            }
        }
    }

    /// The ends that a leaving agent has not dropped before, and those of its branches that never
    /// started.
    fn ends_to_drop(&self, network: &Network, number: usize) -> Vec<End> {
        let agent = &network.agents[number];
        let done = &agent.steps[..usize::from(self.agents[number].step)];
        let mut ends = agent.ends.clone();
        ends.retain(|&end| !done.contains(&Step::Drop(end)));
        for (branch, status) in self.agents.iter().enumerate() {
            if network.agents[branch].parent == Some(number) && status.phase == Phase::Unstarted {
                ends.extend(self.ends_to_drop(network, branch));
            }
        }
        ends
    }
}

/// Whether an `Alternative` is made for this step.
fn is_first_selection(agent: &Agent, step: usize) -> bool {
    let is_selection = matches!(agent.steps[step], Step::Registered { .. });
    is_selection && (step == 0 || agent.steps[step - 1] != agent.steps[step])
}

/// What a fair alternative has chosen.
fn chosen_by(step: &Step, outcome: Outcome) -> Option<Chosen> {
    let (Outcome::Sent(place)
    | Outcome::Received(place, _)
    | Outcome::Failed(place, _)
    | Outcome::Synced(place)) = outcome
    else {
        return None;
    };
    match step {
        Step::Alternative {
            fair: true, offers, ..
        } => offers[usize::from(place)].guard.memory(),
        Step::Registered { fair: true, inputs } => Some(Chosen::Input(inputs[usize::from(place)])),
        _ => None,
    }
}

/// About to begin this step, or the next that means something, or to leave.
fn before_step(agent: &Agent, mut step: u8) -> (u8, Phase) {
    while agent.steps.get(usize::from(step)) == Some(&Step::Yield) {
        step += 1;
    }
    let phase = if usize::from(step) == agent.steps.len() {
        Phase::Leaving {
            next: 0,
            failed: false,
        }
    } else {
        Phase::Between
    };
    (step, phase)
}
