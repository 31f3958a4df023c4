//! Checks a trace against the model: does some run of the network show it?
//!
//! The trace is in the order of one clock. An agent read the clock before it called an operation,
//! and again when the operation had returned. The effect of the operation lies somewhere in
//! between. So the order of two operations is known only if one had returned before the other was
//! called. The check carries all states that the network may be in after each entry. If none is
//! left, no run shows the trace.

use crate::model::State;
use crate::network::{Entry, Event, Network};
use crate::states::States;
use std::fmt;

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// All processes have ended.
    Complete,
    /// Nothing happens any more, and some process waits.
    Stuck,
}

/// No run of the network shows the trace.
pub struct Refusal {
    /// The first entry that none shows; beyond the last one, it is the end.
    pub at: usize,
    /// The states that the network may have been in.
    before: Vec<State>,
}

/// More states than these are not followed: a machine that holds many processes between two notes
/// leaves too much open.
const MAX_STATES: usize = 50_000;

/// `Ok` with the largest number of states that had to be carried; `None` if there were too many to
/// count.
pub fn check(network: &Network, trace: &[Entry], end: End) -> Result<Option<usize>, Refusal> {
    let mut states = States::from_iter([State::initial(network)]);
    let mut most = 1;
    for (at, &entry) in trace.iter().enumerate() {
        // The begin of a step changes nothing for others, so what may happen before it may as well
        // happen after it. But a branch must have been started.
        let is_branch = network.agents[entry.agent].parent.is_some();
        let changes_nothing = matches!(entry.event, Event::Begins(step) if step > 0 || !is_branch);
        if !changes_nothing && !close(network, &mut states) {
            return Ok(None);
        }
        most = most.max(states.len());
        let after: States = states
            .iter()
            .filter_map(|state| state.note(network, entry))
            .collect();
        if after.is_empty() {
            return Err(Refusal {
                at,
                before: states.into_iter().collect(),
            });
        }
        states = after;
    }
    if !close(network, &mut states) {
        return Ok(None);
    }
    let allowed = |state: &State| {
        state.is_final(network) && state.all_left(network) == (end == End::Complete)
    };
    if states.iter().any(allowed) {
        Ok(Some(most.max(states.len())))
    } else {
        Err(Refusal {
            at: trace.len(),
            before: states.into_iter().collect(),
        })
    }
}

/// Adds all that internal steps lead to; says whether they are few enough.
fn close(network: &Network, states: &mut States) -> bool {
    let mut open: Vec<State> = states.iter().cloned().collect();
    let mut next = Vec::new();
    while let Some(state) = open.pop() {
        state.internal(network, &mut next);
        for state in next.drain(..) {
            if !states.contains(&state) {
                states.insert(state.clone());
                open.push(state);
            }
        }
        if states.len() > MAX_STATES {
            return false;
        }
    }
    true
}

/// What a network may come to, on any path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Fate {
    /// It ends on every path.
    Ends,
    /// It deadlocks on every path.
    Deadlocks,
    /// It depends on the path.
    Either,
}

/// Follows all paths: `None` if there are more states than `most`.
pub fn fate(network: &Network, most: usize) -> Option<Fate> {
    let uses = network.uses();
    let settled = |state| settled(network, &uses, state);
    let mut known = States::default();
    let mut open = vec![settled(State::initial(network))];
    let (mut ends, mut deadlocks) = (false, false);
    let mut next = Vec::new();
    while let Some(state) = open.pop() {
        if known.contains(&state) {
            continue;
        }
        if known.len() == most {
            return None;
        }
        state.internal(network, &mut next);
        for agent in 0..network.agents.len() {
            if let Some(event) = state.notes(network, agent) {
                next.extend(state.note(network, Entry { agent, event }));
            }
        }
        if next.is_empty() {
            match state.all_left(network) {
                true => ends = true,
                false => deadlocks = true,
            }
        }
        open.extend(next.drain(..).map(settled));
        known.insert(state);
    }
    Some(match (ends, deadlocks) {
        (true, false) => Fate::Ends,
        (false, true) => Fate::Deadlocks,
        (true, true) => Fate::Either,
        (false, false) => unreachable!("a finite network comes to an end"),
    })
}

/// Takes the internal steps of each agent that change nothing for others, whether they happen now
/// or later. Two steps are left out: learning an outcome that may still change, and leaving a
/// parallel construct (its other branches learn whether it failed).
fn settled(network: &Network, uses: &[Vec<(usize, u8)>], mut state: State) -> State {
    loop {
        let step = (0..network.agents.len()).find_map(|agent| {
            let event = state.notes(network, agent)?;
            let matters = match event {
                Event::Begins(_) | Event::Waits => false,
                Event::Ends(_) => state.may_withdraw(network, agent),
                Event::Leaves => network.agents[agent].parent.is_some(),
            };
            (!matters).then_some(Entry { agent, event })
        });
        match step.and_then(|entry| state.note(network, entry)) {
            Some(after) => state = after,
            None if state.drop_unseen(network, uses) => {}
            None => return state,
        }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "refused at entry {}; the network may have been in {} states, the first of them:",
            self.at,
            self.before.len()
        )?;
        for state in self.before.iter().take(3) {
            writeln!(f, "  {state:?}")?;
        }
        Ok(())
    }
}
