//! Which process takes part in which event, before anything is written.

use super::{Writer, lines};
use crate::file::Side;
use crate::network::{Agent, Buffering, END, Label, Network};
use crate::spin::ending::{Ending, ancestors};
use std::collections::BTreeSet;
use std::fmt::Write;

/// A process of the parallel composition.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Component {
    Agent(usize),
    /// Of a channel.
    Buffer(usize),
}

/// Who uses what, at places that some path comes to.
#[derive(Debug)]
pub(super) struct Alphabets {
    /// For each agent and place, whether a path comes to it.
    pub(super) reached: Vec<Vec<bool>>,
    /// For each channel the agents that send and receive.
    pub(super) senders: Vec<Vec<usize>>,
    pub(super) receivers: Vec<Vec<usize>>,
    /// For each channel the agents that may find that it has no receiver, or no sender.
    pub(super) no_receiver: Vec<Vec<usize>>,
    pub(super) no_sender: Vec<Vec<usize>>,
    /// Which branch may call off which agent.
    pub(super) calls_off: BTreeSet<(usize, usize)>,
    /// Which process does which action.
    pub(super) actions: BTreeSet<(String, usize)>,
}

impl Alphabets {
    pub(super) fn of(network: &Network, ending: &Ending) -> Self {
        let channels = network.channels.len();
        let agents = network.agents.iter();
        let mut found = Self {
            reached: agents.map(|agent| reached(agent, ending)).collect(),
            senders: vec![Vec::new(); channels],
            receivers: vec![Vec::new(); channels],
            no_receiver: vec![Vec::new(); channels],
            no_sender: vec![Vec::new(); channels],
            calls_off: BTreeSet::new(),
            actions: BTreeSet::new(),
        };
        for agent in 0..network.agents.len() {
            for (at, place) in network.agents[agent].code.iter().enumerate() {
                if !found.reached[agent][at] {
                    continue;
                }
                for edge in place.step.edges() {
                    if let Label::Own(name) = &edge.label {
                        found.actions.insert((name.clone(), agent));
                    }
                    if let Some((channel, side)) = edge.label.end() {
                        found.uses(network, ending, agent, channel, side);
                    }
                }
            }
        }
        found
    }

    fn uses(
        &mut self,
        network: &Network,
        ending: &Ending,
        agent: usize,
        channel: usize,
        side: Side,
    ) {
        let (users, closed) = match side {
            Side::Send => (&mut self.senders, &mut self.no_receiver),
            Side::Receive => (&mut self.receivers, &mut self.no_sender),
        };
        if users[channel].last() != Some(&agent) {
            users[channel].push(agent);
        }
        // A process does not outlive itself: one that has the other end never finds it closed.
        let own = network.agents[agent].process;
        let partners = network.channels[channel].partners(side);
        let may_close = ending.may_close(network, channel, side) && !partners.contains(&own);
        if may_close && closed[channel].last() != Some(&agent) {
            closed[channel].push(agent);
        }
        for around in std::iter::once(agent).chain(ancestors(network, agent)) {
            for &sibling in &network.agents[around].siblings {
                if sibling != around && ending.fails[sibling] {
                    self.calls_off.insert((sibling, agent));
                }
            }
        }
    }

    /// The agents that are notified that a side has nothing on the other one.
    pub(super) fn closed(&self, channel: usize, side: Side) -> &[usize] {
        match side {
            Side::Send => &self.no_receiver[channel],
            Side::Receive => &self.no_sender[channel],
        }
    }

    /// The branches that may call off an agent.
    pub(super) fn called_off_by(&self, agent: usize) -> Vec<usize> {
        let pairs = self.calls_off.iter().filter(|(_, called)| *called == agent);
        pairs.map(|(by, _)| *by).collect()
    }

    /// All processes of the composition.
    pub(super) fn components(&self, network: &Network) -> Vec<Component> {
        let agents = (0..network.agents.len()).map(Component::Agent);
        let is_buffer = |channel: &usize| {
            let is_used =
                !self.senders[*channel].is_empty() || !self.receivers[*channel].is_empty();
            network.channels[*channel].kind != Buffering::Rendezvous && is_used
        };
        let buffers = (0..network.channels.len()).filter(is_buffer);
        agents.chain(buffers.map(Component::Buffer)).collect()
    }
}

/// The places of an agent that a run may come to.
fn reached(agent: &Agent, ending: &Ending) -> Vec<bool> {
    let mut from = vec![agent.start];
    // A process that fails goes on at its end.
    if agent.parent.is_none() && ending.processes[agent.process] {
        from.push(END);
    }
    agent.reached(from)
}

impl Writer<'_> {
    pub(super) fn agents(&self, agents: &[usize]) -> String {
        let names = agents.iter().map(|&agent| &*self.names.agents[agent]);
        format!("{{{}}}", names.collect::<Vec<_>>().join(", "))
    }

    /// The agents of the processes that a side waits for: it is notified when none of them is left.
    pub(super) fn partners(&self, channel: usize, side: Side) -> Vec<usize> {
        let partners = self.network.channels[channel].partners(side).iter();
        partners
            .map(|&process| self.network.processes[process].agent)
            .collect()
    }

    /// Whether all processes may end.
    pub(super) fn may_be_over(&self) -> bool {
        self.ending.processes.iter().all(|ends| *ends)
    }

    pub(super) fn channels(&self, text: &mut String) {
        let network = self.network;
        text.push_str("-- Communications: sender, receiver and value\n");
        for (number, channel) in network.channels.iter().enumerate() {
            let senders = &self.alphabets.senders[number];
            let receivers = &self.alphabets.receivers[number];
            let is_rendezvous = channel.kind == Buffering::Rendezvous;
            let values = channel.values.map(|(low, high)| range(low, high));
            let mut declare = |name: &str, users: &[&Vec<usize>]| {
                let several = users.iter().filter(|users| users.len() > 1);
                let mut fields: Vec<String> = several.map(|users| self.agents(users)).collect();
                fields.extend(values.clone());
                let fields = match fields.is_empty() {
                    true => String::new(),
                    false => format!(" : {}", fields.join(".")),
                };
                let _ = writeln!(text, "channel {name}{fields} -- {}", comment_of(channel));
            };
            let names = &self.names.channels[number];
            if is_rendezvous && !senders.is_empty() && !receivers.is_empty() {
                declare(&names.plain, &[senders, receivers]);
            }
            if !is_rendezvous && !senders.is_empty() {
                declare(&names.put, &[senders]);
            }
            if !is_rendezvous && !receivers.is_empty() {
                declare(&names.get, &[receivers]);
            }
        }
        text.push_str("\n-- All else: actions, time that passes, ends of processes, branches\n");
        for (action, name) in &self.names.actions {
            let does = self
                .alphabets
                .actions
                .iter()
                .filter(|(known, _)| known == action);
            let does: Vec<usize> = does.map(|(_, agent)| *agent).collect();
            let _ = writeln!(text, "channel {name} : {}", self.agents(&does));
        }
        for (number, names) in self.names.channels.iter().enumerate() {
            for side in Side::BOTH {
                let name = names.closed(side);
                let notified = self.alphabets.closed(number, side);
                if !notified.is_empty() {
                    let _ = writeln!(text, "channel {name} : {}", self.agents(notified));
                }
            }
        }
        let lines = lines(network).join(", ");
        let _ = writeln!(
            text,
            "channel after, ends, start, done, failed, step : Agent\n\
             channel called_off : Agent.Agent\n\
             channel choose, broken : Agent.{{{lines}}}\n\
             channel over"
        );
        for (&(_, agent, slot), name) in &self.names.hands {
            let variable = &network.variables[slot];
            let range = range(variable.low, variable.high);
            let branch = super::comment(&network.agents[agent].name);
            let _ = writeln!(
                text,
                "channel {name} : {range} -- {}, {branch}",
                variable.name
            );
        }
    }

    pub(super) fn silent(&self) -> Vec<String> {
        let plain = ["choose", "start", "done", "failed", "step"].map(str::to_owned);
        plain
            .into_iter()
            .chain(self.names.hands.values().cloned())
            .collect()
    }

    /// The events in which a process of the composition takes part.
    pub(super) fn alphabet(&self, component: Component) -> Vec<String> {
        match component {
            Component::Agent(agent) => self.agent_events(agent),
            Component::Buffer(channel) => self.buffer_events(channel),
        }
    }

    fn agent_events(&self, agent: usize) -> Vec<String> {
        let (network, alphabets) = (self.network, &self.alphabets);
        let found = &network.agents[agent];
        let own = &self.names.agents[agent];
        let mut events: Vec<String> = ["after", "broken", "choose", "step"]
            .iter()
            .map(|word| format!("{word}.{own}"))
            .collect();
        let actions = alphabets.actions.iter().filter(|(_, does)| *does == agent);
        events.extend(actions.map(|(action, _)| format!("{}.{own}", self.names.actions[action])));
        for (number, channel) in network.channels.iter().enumerate() {
            let names = &self.names.channels[number];
            let (senders, receivers) = (&alphabets.senders[number], &alphabets.receivers[number]);
            let of_one = |name: &str, users: &[usize]| match users.len() {
                1 => name.to_owned(),
                _ => format!("{name}.{own}"),
            };
            if channel.kind != Buffering::Rendezvous {
                if senders.contains(&agent) {
                    events.push(of_one(&names.put, senders));
                }
                if receivers.contains(&agent) {
                    events.push(of_one(&names.get, receivers));
                }
            } else if !senders.is_empty() && !receivers.is_empty() {
                if senders.contains(&agent) {
                    events.push(of_one(&names.plain, senders));
                }
                if receivers.contains(&agent) {
                    let from = match senders.len() {
                        1 => vec![names.plain.clone()],
                        _ => senders
                            .iter()
                            .map(|&sender| format!("{}.{}", names.plain, self.names.agents[sender]))
                            .collect(),
                    };
                    events.extend(from.iter().map(|from| of_one(from, receivers)));
                }
            }
            for side in Side::BOTH {
                let name = names.closed(side);
                let notified = alphabets.closed(number, side);
                if notified.contains(&agent) {
                    events.push(format!("{name}.{own}"));
                }
                if !notified.is_empty() && self.partners(number, side).contains(&agent) {
                    events.push(name.clone());
                }
            }
        }
        events.extend(self.observing(agent));
        let calls = alphabets
            .calls_off
            .iter()
            .filter(|(by, called)| *by == agent || *called == agent);
        events.extend(calls.map(|&(by, called)| {
            format!(
                "called_off.{}.{}",
                self.names.agents[by], self.names.agents[called]
            )
        }));
        if found.parent.is_none() {
            events.push(format!("ends.{own}"));
            if self.may_be_over() {
                events.push("over".to_owned());
            }
        }
        // A branch, and what it is a branch of, begin and end it together.
        let branches = (0..network.agents.len()).filter(|&one| {
            one == agent && found.parent.is_some() || network.agents[one].parent == Some(agent)
        });
        for branch in branches {
            let name = &self.names.agents[branch];
            events.extend(["start", "done", "failed"].map(|word| format!("{word}.{name}")));
            let hands = self
                .names
                .hands
                .iter()
                .filter(|((_, of, _), _)| *of == branch);
            events.extend(hands.map(|(_, name)| name.clone()));
        }
        events
    }
}

fn comment_of(channel: &crate::network::Channel) -> String {
    super::comment(&channel.name)
}

/// All values from one number to another.
fn range(low: i32, high: i32) -> String {
    format!(
        "{{{}..{}}}",
        super::arithmetic::number(low),
        super::arithmetic::number(high)
    )
}
