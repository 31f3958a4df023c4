//! Which processes may end, so that channels may be closed.

use crate::file::Side;
use crate::network::{Agent, END, Network, Step};

/// What may end or fail.
#[derive(Debug)]
pub(crate) struct Ending {
    /// For each process, whether it may come to its end.
    pub(crate) processes: Vec<bool>,
    /// For each agent, whether it may find a channel closed, or be called off.
    pub(crate) fails: Vec<bool>,
}

impl Ending {
    pub(crate) fn of(network: &Network) -> Self {
        let ends = |agent: &Agent| agent.reached(vec![agent.start])[END];
        let mut found = Self {
            processes: network
                .processes
                .iter()
                .map(|process| ends(&network.agents[process.agent]))
                .collect(),
            fails: vec![false; network.agents.len()],
        };
        // What may fail makes others fail: until nothing changes.
        loop {
            let mut has_changed = false;
            for (number, agent) in network.agents.iter().enumerate() {
                if found.fails[number] {
                    continue;
                }
                let branch_fails = |branch: &usize| found.fails[*branch];
                let called_off = |agent: &Agent| agent.siblings.iter().any(branch_fails);
                let fails = agent.code.iter().any(|place| match &place.step {
                    Step::Join(branches, _) => branches.iter().any(branch_fails),
                    Step::Wait(edges) => edges.iter().any(|edge| {
                        edge.label.end().is_some_and(|(channel, side)| {
                            found.may_close(network, channel, side)
                                || called_off(agent)
                                || ancestors(network, number)
                                    .any(|around| called_off(&network.agents[around]))
                        })
                    }),
                    _ => false,
                });
                if fails {
                    found.fails[number] = true;
                    if agent.parent.is_none() {
                        found.processes[agent.process] = true;
                    }
                    has_changed = true;
                }
            }
            if !has_changed {
                return found;
            }
        }
    }

    /// Whether what is on this side of a channel may find it closed.
    pub(crate) fn may_close(&self, network: &Network, channel: usize, side: Side) -> bool {
        let partners = network.channels[channel].partners(side);
        partners.iter().all(|&process| self.processes[process])
    }
}

/// The agents around an agent, the nearest first.
pub(crate) fn ancestors(network: &Network, agent: usize) -> impl Iterator<Item = usize> {
    std::iter::successors(network.agents[agent].parent, |&around| {
        network.agents[around].parent
    })
}
