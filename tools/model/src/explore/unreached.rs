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

    pub(crate) fn take(&mut self, state: &State, step: Move) {
        if step.is_closed || step.is_end {
            return;
        }
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
        // All instances have the same places: a branch is known by its agent within the process,
        // its place and its number.
        let mut found: BTreeMap<(&str, usize, usize, usize), (bool, Unreached)> = BTreeMap::new();
        for (number, agent) in network.agents.iter().enumerate() {
            let process = &network.processes[agent.process];
            let reached = &semantics.reached[number];
            for (at, place) in agent.code.iter().enumerate().filter(|(at, _)| reached[*at]) {
                let mut add = |branch: usize, line: usize, what: String, is_taken: bool| {
                    let key = (&*process.definition, number - process.agent, at, branch);
                    let branch = found.entry(key).or_insert_with(|| {
                        let process = process.definition.clone();
                        (
                            false,
                            Unreached {
                                line,
                                process,
                                what,
                            },
                        )
                    });
                    branch.0 |= is_taken;
                };
                match &place.step {
                    Step::Wait(edges) => {
                        for (edge_number, edge) in edges.iter().enumerate().take(64) {
                            let is_taken = self.0[number][at] >> edge_number & 1 == 1;
                            add(edge_number, edge.line, words::kind(network, edge), is_taken);
                        }
                    }
                    Step::Branch(_, then, otherwise) => {
                        let branches = [("true", then), ("false", otherwise)];
                        for (branch, (condition, next)) in branches.into_iter().enumerate() {
                            let what = format!("the branch of a {condition} condition");
                            add(branch, place.line, what, reached[*next]);
                        }
                    }
                    Step::End | Step::Goto(_) | Step::Assign(..) | Step::Assert(..) => {}
                    Step::Fork(..) | Step::Join(..) => {}
                }
            }
        }
        let mut never: Vec<Unreached> = found
            .into_values()
            .filter(|(is_taken, _)| !is_taken)
            .map(|(_, branch)| branch)
            .collect();
        never.sort();
        never.dedup();
        never
    }
}
