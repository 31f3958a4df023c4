//! What is known of processes besides their model.

use super::Seen;
use crate::network::Network;
use crate::text::{Problem, Source, nearest};
use luna::file::{entries, parse, time};
use std::collections::BTreeMap;
use std::time::Duration;

/// What is known of one process, from a file of costs or a recording.
#[derive(Debug, Clone, Default)]
pub struct Known {
    /// The longest execution time of a job.
    pub cost: Option<Duration>,
    /// The longest poll.
    pub longest_poll: Option<Duration>,
    /// The longest time from when a job ought to be released to its end.
    pub response: Option<Duration>,
    /// When its jobs are released, for a process without a period.
    pub arrivals: Option<Seen>,
}

/// What is known of processes, by their names in the model.
#[derive(Debug, Clone, Default)]
pub struct Costs {
    pub(super) of: BTreeMap<String, Known>,
}

impl Costs {
    /// Nothing is known.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds what is known of the process `name`, in place of what was.
    pub fn insert(&mut self, name: impl Into<String>, known: Known) {
        self.of.insert(name.into(), known);
    }
}

/// Reads a file of costs for this model: a table for each process, with its longest job and its
/// longest poll.
pub(crate) fn read(network: &Network, name: &str, text: &str) -> Result<Costs, Problem> {
    let source = Source { name, text };
    let mut costs = Costs::new();
    let table = parse(source)?;
    for process in entries(source, table.get_ref()) {
        let mut stated = Known::default();
        for entry in process.table()? {
            match entry.key {
                "cost" => stated.cost = Some(time(&entry)?),
                "longest_poll" => stated.longest_poll = Some(time(&entry)?),
                _ => return Err(entry.unknown(&["cost", "longest_poll"])),
            }
        }
        let both = stated.cost.zip(stated.longest_poll);
        if both.is_some_and(|(cost, poll)| poll > cost) {
            let message = "the longest poll of this process is longer than its cost";
            let advice = "`cost` is the time of all polls of a cycle: raise it";
            return Err(source.problem(process.key_span(), message, advice));
        }
        let known = network.processes.iter().map(|known| known.name.as_str());
        if !known.clone().any(|name| name == process.key) {
            let advice = nearest(process.key, known);
            let message = "the model has no process of this name";
            return Err(source.problem(process.key_span(), message, advice));
        }
        costs.insert(process.key, stated);
    }
    Ok(costs)
}
