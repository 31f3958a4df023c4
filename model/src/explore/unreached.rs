//! Branches that no run takes.

use super::Unreached;
use super::state::{Move, Semantics, State};
use super::words;
use crate::network::{Network, Step};
use std::collections::BTreeMap;

/// For each agent and place, which edges were taken: the first 64 of them.
#[derive(Debug)]
pub(crate) struct Taken(Vec<Vec<u64>>);

impl Taken {
    pub(crate) fn new(network: &Network) -> Self {
        let agents = network.agents.iter();
        Self(agents.map(|agent| vec![0; agent.code.len()]).collect())
    }

    pub(crate) fn take(&mut self, _: &Semantics<'_>, state: &State, step: Move) {
        let mut mark = |agent: usize, edge: usize| {
            if let Ok(at) = usize::try_from(state[agent]) {
                self.0[agent][at] |= 1_u64.checked_shl(edge as u32).unwrap_or(0);
            }
        };
        mark(step.agent, step.edge);
        if let Some((agent, edge)) = step.partner {
            mark(agent, edge);
        }
    }

    /// What no instance of a definition takes, at places that some instance reaches.
    pub(crate) fn unreached(&self, semantics: &Semantics<'_>) -> Vec<Unreached> {
        let network = semantics.network;
        let mut found: BTreeMap<Unreached, bool> = BTreeMap::new();
        for (number, agent) in network.agents.iter().enumerate() {
            let process = &network.processes[agent.process];
            for (at, place) in agent.code.iter().enumerate() {
                if !semantics.reached[number][at] {
                    continue;
                }
                let mut add = |line: usize, what: String, is_taken: bool| {
                    let key = Unreached {
                        line,
                        process: process.definition.clone(),
                        what,
                    };
                    *found.entry(key).or_default() |= is_taken;
                };
                match &place.step {
                    Step::Wait(edges) => {
                        for (edge_number, edge) in edges.iter().enumerate().take(64) {
                            let is_taken = self.0[number][at] >> edge_number & 1 == 1;
                            // What several instances have in common: not the channel's name.
                            let what = words::kind(network, edge);
                            add(edge.line, what, is_taken);
                        }
                    }
                    Step::Branch(_, then, otherwise) => {
                        let reached = &semantics.reached[number];
                        let line = place.line;
                        add(
                            line,
                            "the branch of a true condition".to_owned(),
                            reached[*then],
                        );
                        let what = "the branch of a false condition".to_owned();
                        add(line, what, reached[*otherwise]);
                    }
                    _ => {}
                }
            }
        }
        let never = found.into_iter().filter(|(_, is_taken)| !is_taken);
        never.map(|(found, _)| found).collect()
    }
}
