//! Traces made by the model itself: what a runtime might show that does exactly as it says.

use crate::check::End;
use crate::generate::Random;
use crate::model::State;
use crate::network::{Entry, Event, Network};

/// One run along a random path.
pub fn simulate(network: &Network, random: &mut Random) -> (Vec<Entry>, End) {
    let mut state = State::initial(network);
    let mut trace = Vec::new();
    let mut next = Vec::new();
    loop {
        state.internal(network, &mut next);
        let mut notes: Vec<Entry> = (0..network.agents.len())
            .filter_map(|agent| {
                Some(Entry {
                    agent,
                    event: state.notes(network, agent)?,
                })
            })
            .collect();
        notes.extend(waits(network, &state, &trace));
        let choices = next.len() + notes.len();
        if choices == 0 {
            let end = if state.all_left(network) {
                End::Complete
            } else {
                End::Stuck
            };
            return (trace, end);
        }
        // What has been called is mostly tried soon, as on a machine with few processors.
        let choice = if !next.is_empty() && random.chance(70) {
            random.below(next.len())
        } else {
            random.below(choices)
        };
        state = match choice.checked_sub(next.len()) {
            None => next.swap_remove(choice),
            Some(note) => {
                trace.push(notes[note]);
                state
                    .note(network, notes[note])
                    .expect("the model can do what it says it can")
            }
        };
        next.clear();
    }
}

/// The agents that can now find that they have to wait, and have not found it yet in this step.
fn waits(network: &Network, state: &State, trace: &[Entry]) -> Vec<Entry> {
    let entries = (0..network.agents.len()).map(|agent| Entry {
        agent,
        event: Event::Waits,
    });
    entries
        .filter(|entry| {
            let last = trace.iter().rfind(|former| former.agent == entry.agent);
            last.is_some_and(|last| matches!(last.event, Event::Begins(_)))
                && state.note(network, *entry).is_some()
        })
        .collect()
}
