//! The way to a deadlock as a file that a generated program follows: `--replay FILE`.
//!
//! A line for each step, in the words of the model. `src/generate/replay.rs.txt` reads them, and
//! says what each of them does:
//!
//! ```text
//! deadlock philosophers              the head: the name of the model
//! # a: think                         what the program does by itself
//! a -> b: c = 3                      a communication; of a buffer: a -> (buffer): c
//! a chooses 1                        the branch of a `choose`, from 0 on
//! a ends                             drops its ends of channels
//! a finds closed: c                  and ends
//! a waits: send c                    at the end; receive c, stop
//! ```
//!
//! Names of a model have no spaces, `:`, `>`, `(` or `#`, so the lines are distinct.

use super::state::{Move, Semantics, State};
use super::words;
use crate::file::Side;
use crate::network::{Label, Network, Step};
use std::collections::BTreeSet;
use std::fmt::Write;

/// Where a buffer takes part.
const BUFFER: &str = "(buffer)";

/// The moves from the first state to the deadlock.
pub(crate) fn script(network: &Network, way: &[Move]) -> String {
    let mut semantics = Semantics::new(network);
    let (mut state, _) = semantics.first();
    let name = network.name.replace(char::is_control, " ");
    let mut text = format!("deadlock {name}\n");
    for &step in way {
        let _ = writeln!(text, "{}", line(&semantics, &state, step));
        state = semantics.after(&state, step).0;
    }
    for wait in waits(&semantics, &state) {
        let _ = writeln!(text, "{wait}");
    }
    text
}

fn line(semantics: &Semantics<'_>, state: &State, step: Move) -> String {
    let network = semantics.network;
    let process = |agent: usize| {
        let process = network.agents[agent].process;
        network.processes[process].name.as_str()
    };
    let this = process(step.agent);
    let Some(edge) = semantics.edge(state, step) else {
        return format!("{this} ends");
    };
    let value = semantics.carried(state, step);
    let value = value.map_or(String::new(), |value| format!(" = {value}"));
    match edge.label.end() {
        Some((channel, side)) if step.is_closed => {
            let found = &network.channels[channel];
            let length = semantics.length(state, channel);
            if semantics.is_closed(state, found, side, length) {
                return format!("{this} finds closed: {}", found.name);
            }
        }
        Some((channel, side)) => {
            let channel = &network.channels[channel].name;
            let partner = step.partner.map_or(BUFFER, |(agent, _)| process(agent));
            return match side {
                Side::Send => format!("{this} -> {partner}: {channel}{value}"),
                Side::Receive => format!("{BUFFER} -> {this}: {channel}{value}"),
            };
        }
        None => {}
    }
    // A single branch is no choice in the program.
    if let (Label::Choice, branches) = (&edge.label, semantics.edges(state, step.agent))
        && branches.len() > 1
    {
        return format!("{this} chooses {}", step.edge);
    }
    format!("# {}", words::trace_step(semantics, state, step))
}

/// What is waited for, each once: branches of a process are not distinguished.
fn waits(semantics: &Semantics<'_>, state: &State) -> BTreeSet<String> {
    let network = semantics.network;
    let mut found = BTreeSet::new();
    for (number, agent) in network.agents.iter().enumerate() {
        let Ok(at) = usize::try_from(state[number]) else {
            continue;
        };
        let Step::Wait(edges) = &agent.code[at].step else {
            continue;
        };
        let name = &network.processes[agent.process].name;
        let open = edges.iter().filter(|edge| semantics.is_open(state, edge));
        let mut ends = open.filter_map(|edge| edge.label.end()).peekable();
        if ends.peek().is_none() {
            found.insert(format!("{name} waits: stop"));
        }
        for (channel, side) in ends {
            let what = match side {
                Side::Send => "send",
                Side::Receive => "receive",
            };
            found.insert(format!(
                "{name} waits: {what} {}",
                network.channels[channel].name
            ));
        }
    }
    found
}
