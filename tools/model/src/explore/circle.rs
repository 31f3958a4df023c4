//! Which process waits for which.

use super::state::{Semantics, State};
use crate::network::Label;

/// Processes of which each waits for the next one, and the last for the first.
pub(crate) fn circle(semantics: &Semantics<'_>, state: &State) -> Option<Vec<usize>> {
    let network = semantics.network;
    let mut waits_for = vec![Vec::new(); network.processes.len()];
    for (number, agent) in network.agents.iter().enumerate() {
        for edge in semantics.edges(state, number) {
            let Some((channel, side)) = edge.label.end() else {
                continue;
            };
            debug_assert!(!matches!(edge.label, Label::Own(_)));
            if semantics.is_open(state, edge) {
                waits_for[agent.process].extend(network.channels[channel].partners(side));
            }
        }
    }
    // A depth-first search that keeps its way: the first process on it that comes again closes a
    // circle.
    let mut is_done = vec![false; waits_for.len()];
    for start in 0..waits_for.len() {
        let mut way: Vec<(usize, usize)> = vec![(start, 0)];
        while let Some(&mut (process, ref mut tried)) = way.last_mut() {
            let next = waits_for[process].get(*tried).copied();
            *tried += 1;
            match next {
                _ if is_done[process] => drop(way.pop()),
                None => {
                    is_done[process] = true;
                    way.pop();
                }
                Some(next) => {
                    if let Some(first) = way.iter().position(|(process, _)| *process == next) {
                        let circle = way[first..].iter().map(|(process, _)| *process);
                        return Some(circle.collect());
                    }
                    way.push((next, 0));
                }
            }
        }
    }
    None
}
