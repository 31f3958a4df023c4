//! Moves and states in the words of the model.

use super::circle::circle;
use super::state::{Broken, Move, Semantics, State};
use super::{StepParts, TraceStep};
use crate::file::Side;
use crate::network::{Edge, Label, Network, Step};

/// The moves from the first state on.
pub(crate) fn trace(network: &Network, way: &[Move]) -> Vec<TraceStep> {
    let mut semantics = Semantics::new(network);
    let (mut state, _) = semantics.first();
    let mut steps = Vec::new();
    for &step in way {
        steps.push(trace_step(&semantics, &state, step));
        state = semantics.after(&state, step).0;
    }
    steps
}

pub(crate) fn trace_step(semantics: &Semantics<'_>, state: &State, step: Move) -> TraceStep {
    let Some(edge) = semantics.edge(state, step) else {
        let name = &semantics.network.agents[step.agent].name;
        return TraceStep {
            text: format!("{name} ends"),
            parts: StepParts::Act {
                process: name.clone(),
                what: "ends".to_owned(),
            },
        };
    };
    let said = Said {
        agent: step.agent,
        edge,
        partner: step.partner.map(|(agent, _)| agent),
        value: semantics.carried(state, step),
        is_closed: step.is_closed,
    };
    said.step(semantics.network)
}

/// A move, as far as it is to be shown.
pub(crate) struct Said<'a> {
    pub(crate) agent: usize,
    pub(crate) edge: &'a Edge,
    pub(crate) partner: Option<usize>,
    pub(crate) value: Option<i32>,
    pub(crate) is_closed: bool,
}

impl Said<'_> {
    pub(crate) fn step(&self, network: &Network) -> TraceStep {
        let name = |agent: usize| network.agents[agent].name.clone();
        let end = self.edge.label.end().filter(|_| !self.is_closed);
        let parts = if let Some((channel, side)) = end {
            let value = self.value.map(|value| format!(" = {value}"));
            let (sender, receiver) = match side {
                Side::Send => (Some(name(self.agent)), self.partner.map(name)),
                Side::Receive => (None, Some(name(self.agent))),
            };
            StepParts::Communication {
                sender,
                receiver,
                what: network.channels[channel].name.clone() + &value.unwrap_or_default(),
            }
        } else {
            let what = match &self.edge.label {
                Label::Own(action) => action.clone(),
                Label::Choice => format!("branch of line {}", self.edge.line),
                Label::Skip => "skip".to_owned(),
                Label::After => "after".to_owned(),
                Label::Send(..) | Label::Receive(..) => "ends".to_owned(),
            };
            let process = name(self.agent);
            StepParts::Act { process, what }
        };
        TraceStep {
            text: self.line(network),
            parts,
        }
    }

    fn line(&self, network: &Network) -> String {
        let name = &network.agents[self.agent].name;
        let edge = self.edge;
        let with = match self.value {
            Some(value) => format!(" = {value}"),
            _ => String::new(),
        };
        let end = edge.label.end();
        let channel = end.map_or("", |(channel, _)| network.channels[channel].name.as_str());
        match (&edge.label, self.partner) {
            _ if self.is_closed => format!("{name} cannot go on with {channel}, and ends"),
            (Label::Send(..), other) => {
                let other = other.map(|other| network.agents[other].name.as_str());
                communication(channel, Some(name), other) + &with
            }
            (Label::Receive(..), _) => communication(channel, None, Some(name)) + &with,
            (Label::Own(action), _) => format!("{name}: {action}"),
            (Label::Choice, _) => format!("{name} chooses the branch of line {}", edge.line),
            (Label::Skip, _) => format!("{name} skips, line {}", edge.line),
            (Label::After, _) => format!("{name} has waited long enough, line {}", edge.line),
        }
    }
}

/// A communication; without a receiver or a sender it is one with the channel's buffer.
///
/// ```
/// use luna_model::communication;
///
/// assert_eq!(communication("left", Some("a"), Some("b")), "a -> b: left");
/// assert_eq!(communication("left", Some("a"), None), "a -> left");
/// assert_eq!(communication("left", None, Some("b")), "left -> b");
/// ```
#[must_use]
pub fn communication(channel: &str, sender: Option<&str>, receiver: Option<&str>) -> String {
    match (sender, receiver) {
        (Some(sender), Some(receiver)) => format!("{sender} -> {receiver}: {channel}"),
        (Some(sender), None) => format!("{sender} -> {channel}"),
        (None, Some(receiver)) => format!("{channel} -> {receiver}"),
        (None, None) => channel.to_owned(),
    }
}

pub(crate) fn broken(network: &Network, broken: &Broken) -> String {
    let name = &network.agents[broken.agent].name;
    format!("{name} {}, line {}", broken.what, broken.line)
}

/// An edge, without what differs from instance to instance.
pub(crate) fn kind(network: &Network, edge: &Edge) -> String {
    let without_parts = |channel: usize| {
        let name = &network.channels[channel].name;
        let name = name.rsplit('.').next().unwrap_or(name);
        name.split('[').next().unwrap_or(name).to_owned()
    };
    match &edge.label {
        Label::Send(channel, _) => format!("the send on {}", without_parts(*channel)),
        Label::Receive(channel, _) => format!("the receive from {}", without_parts(*channel)),
        Label::Choice => "this branch".to_owned(),
        Label::Skip => "the `skip`".to_owned(),
        Label::After => "the `after`".to_owned(),
        Label::Own(name) => format!("the action {name}"),
    }
}

/// Where all processes are that have not ended.
pub(crate) fn places(semantics: &Semantics<'_>, state: &State) -> Vec<String> {
    let network = semantics.network;
    let agents = 0..network.agents.len();
    let mut lines: Vec<String> = agents
        .filter_map(|agent| place(semantics, state, agent))
        .collect();
    let first = network
        .variables
        .iter()
        .enumerate()
        .map(|(slot, variable)| {
            let process = &network.processes[variable.process].name;
            let value = semantics.variable(state, slot);
            format!("{process}.{} = {value}", variable.name)
        });
    let values: Vec<String> = first.collect();
    lines.extend(values.chunks(8).map(|chunk| chunk.join(", ")));
    lines
}

/// Where an agent is, if it waits for something.
pub(crate) fn place(semantics: &Semantics<'_>, state: &State, agent: usize) -> Option<String> {
    let network = semantics.network;
    let at = usize::try_from(state[agent]).ok()?;
    let agent = &network.agents[agent];
    let place = &agent.code[at];
    let name = &agent.name;
    let Step::Wait(edges) = &place.step else {
        return None;
    };
    if edges.is_empty() {
        return Some(format!("{name} has stopped, line {}", place.line));
    }
    let open = edges.iter().filter(|edge| semantics.is_open(state, edge));
    let offers: Vec<String> = open
        .map(|edge| match &edge.label {
            Label::Send(channel, _) => format!("send on {}", network.channels[*channel].name),
            Label::Receive(channel, _) => {
                format!("receive from {}", network.channels[*channel].name)
            }
            Label::Own(name) => name.clone(),
            Label::Choice => "choose".to_owned(),
            Label::Skip => "skip".to_owned(),
            Label::After => "wait for a time".to_owned(),
        })
        .collect();
    Some(match &offers[..] {
        [] => format!("{name} has no open guard, line {}", place.line),
        _ => format!("{name} is to {}, line {}", offers.join(" or "), place.line),
    })
}

/// A deadlock: where all are, and a circle of processes if there is one; the circle also alone.
pub(crate) fn stuck(semantics: &Semantics<'_>, state: &State) -> (Vec<String>, Vec<String>) {
    let mut lines = places(semantics, state);
    let circle = circle(semantics, state).unwrap_or_default();
    let circle = circle.into_iter();
    let names = circle.map(|process| semantics.network.processes[process].name.clone());
    let names: Vec<String> = names.collect();
    if let Some(first) = names.first() {
        let around = names.join(" -> ");
        lines.push(format!(
            "circle, each waits for the next: {around} -> {first}"
        ));
    }
    (lines, names)
}
