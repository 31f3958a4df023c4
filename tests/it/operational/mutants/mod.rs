//! Tests of the checker: traces that no run shows. Beside each stands a trace that differs in the
//! false entry alone, and is allowed.

mod alternatives;
mod communication;
mod constructs;
mod random;

use crate::operational::check::{End as Fin, check};
use crate::operational::network::{
    Agent, Entry, Event, Form, Guard, Kind, Network, Offer, Outcome, Patience, Step, Value,
};

pub(super) fn send(channel: usize, value: Value) -> Guard {
    Guard::Send {
        channel,
        value,
        form: Form::Given,
    }
}

pub(super) fn recv(channel: usize) -> Guard {
    Guard::Recv { channel }
}

pub(super) fn plain(guard: Guard) -> Step {
    Step::Plain(guard, Patience::Forever)
}

pub(super) fn choice(fair: bool, guards: &[Guard], skip: bool) -> Step {
    let offers = guards
        .iter()
        .map(|&guard| Offer { guard, open: true })
        .collect();
    Step::Alternative {
        fair,
        offers,
        skip,
        dropped: None,
    }
}

pub(super) fn network<const N: usize>(channels: &[Kind], agents: [&[Step]; N]) -> Network {
    let agent = |steps: &[Step]| Agent {
        parent: None,
        strict: false,
        level: 16,
        ends: Vec::new(),
        steps: steps.to_vec(),
    };
    let mut network = Network {
        channels: channels.to_vec(),
        barriers: Vec::new(),
        agents: agents.into_iter().map(agent).collect(),
    };
    network.hand_out_ends();
    network
}

pub(super) fn begins(agent: usize, step: u8) -> Entry {
    Entry {
        agent,
        event: Event::Begins(step),
    }
}

pub(super) fn waits(agent: usize) -> Entry {
    Entry {
        agent,
        event: Event::Waits,
    }
}

pub(super) fn sees(agent: usize, outcome: Outcome) -> Entry {
    Entry {
        agent,
        event: Event::Ends(outcome),
    }
}

pub(super) fn leaves(agent: usize) -> Entry {
    Entry {
        agent,
        event: Event::Leaves,
    }
}

/// Each step from its beginning to its end, with nothing of the others in between.
pub(super) fn steps(agent: usize, first: u8, outcomes: &[Outcome]) -> Vec<Entry> {
    let step = |(step, &outcome)| [begins(agent, step), sees(agent, outcome)];
    (first..).zip(outcomes).flat_map(step).collect()
}

pub(super) fn all_leave(agents: usize) -> Vec<Entry> {
    (0..agents).map(leaves).collect()
}

#[track_caller]
pub(super) fn allowed(network: &Network, trace: &[&[Entry]], end: Fin) {
    if let Err(refusal) = check(network, &trace.concat(), end) {
        panic!("{network}{refusal}");
    }
}

/// Refused, and at this entry.
#[track_caller]
pub(super) fn refused(network: &Network, trace: &[&[Entry]], end: Fin, at: usize) {
    match check(network, &trace.concat(), end) {
        Ok(_) => panic!("this is allowed: {trace:?} of\n{network}"),
        Err(refusal) => assert_eq!(refusal.at, at, "{network}{refusal}"),
    }
}
