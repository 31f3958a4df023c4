//! What the agents of a network share while it runs: they note what they see by one clock.

use crate::operational::network::{Entry, Event, Network};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};

/// A network under way, and what its agents have noted.
pub(crate) struct Job {
    pub(crate) network: Network,
    /// Whether its processes may block their threads.
    pub(crate) may_block: bool,
    clock: AtomicU32,
    /// One list for each agent, so that no agent waits for another to note an event.
    notes: Vec<Mutex<Vec<(u32, Event)>>>,
}

impl Job {
    pub(crate) fn new(network: Network, may_block: bool) -> Job {
        Job {
            clock: AtomicU32::new(0),
            notes: network
                .agents
                .iter()
                .map(|_| Mutex::new(Vec::with_capacity(32)))
                .collect(),
            network,
            may_block,
        }
    }

    pub(crate) fn note(&self, agent: usize, event: Event) {
        let mut notes = self.notes[agent].lock().unwrap();
        // One total order: an agent that reads a later number has seen what was done before an
        // earlier one.
        let time = self.clock.fetch_add(1, Ordering::SeqCst);
        notes.push((time, event));
    }

    /// What was noted so far, up to the first note that is under way.
    pub(crate) fn trace(&self) -> Vec<Entry> {
        let mut trace = Vec::new();
        for (agent, notes) in self.notes.iter().enumerate() {
            let notes = notes.lock().unwrap();
            trace.extend(
                notes
                    .iter()
                    .map(|&(time, event)| (time, Entry { agent, event })),
            );
        }
        trace.sort_unstable_by_key(|&(time, _)| time);
        let whole = (0..)
            .zip(&trace)
            .take_while(|(place, (time, _))| place == time)
            .count();
        trace.truncate(whole);
        trace.into_iter().map(|(_, entry)| entry).collect()
    }
}
