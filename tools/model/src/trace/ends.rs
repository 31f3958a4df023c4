//! Which processes can have ended after the last communication.
//!
//! A process then takes hidden moves of its own alone, up to its end, or to a channel that it finds
//! closed. What another process does makes a difference to it only by its end. So each process is
//! looked at by itself, again when others have ended.

use super::automaton::{Automaton, TooMany};
use crate::explore::state::State;
use indexmap::IndexSet;
use rustc_hash::FxBuildHasher;

/// A process that has more states than this after its last communication may have ended.
const MAX_STATES: usize = 10_000;

impl Automaton<'_> {
    /// Which of these processes cannot have ended, in the state in which most can. Processes that
    /// hidden communications connect may have ended.
    pub(super) fn cannot_end(
        &mut self,
        sets: impl Iterator<Item = u32>,
        ended: &[usize],
    ) -> Result<Vec<usize>, TooMany> {
        let mut best: Option<Vec<usize>> = None;
        if ended.is_empty() {
            return Ok(Vec::new());
        }
        let connected: Vec<usize> = (0..self.groups.len())
            .filter(|&one| {
                let mut others = self.groups.iter().enumerate();
                others.any(|(other, group)| other != one && *group == self.groups[one])
            })
            .collect();
        let mut looked_at = 0;
        for set in sets {
            for state in self.members(set) {
                let after = self.after_ends(state, &connected, &mut looked_at)?;
                let alive = |process: &&usize| !self.semantics.has_ended(&after, **process);
                let alive: Vec<usize> = ended.iter().filter(alive).copied().collect();
                if alive.is_empty() {
                    return Ok(alive);
                }
                if best.as_ref().is_none_or(|best| alive.len() < best.len()) {
                    best = Some(alive);
                }
            }
        }
        Ok(best.unwrap_or_default())
    }

    /// The state when all have ended that can.
    fn after_ends(
        &mut self,
        mut state: State,
        connected: &[usize],
        looked_at: &mut usize,
    ) -> Result<State, TooMany> {
        let count = self.network().processes.len();
        for &process in connected {
            self.semantics.end(&mut state, process);
        }
        loop {
            let mut is_new = false;
            for process in 0..count {
                if !self.semantics.has_ended(&state, process)
                    && let Some(after) = self.end_of(&state, process, looked_at)?
                {
                    state = after;
                    is_new = true;
                }
            }
            if !is_new {
                return Ok(state);
            }
        }
    }

    /// The state when the process has ended, if it can.
    fn end_of(
        &mut self,
        state: &State,
        process: usize,
        looked_at: &mut usize,
    ) -> Result<Option<State>, TooMany> {
        let mut seen: IndexSet<State, FxBuildHasher> = IndexSet::default();
        seen.insert(state.clone());
        let mut moves = Vec::new();
        let mut at = 0;
        while let Some(state) = seen.get_index(at).cloned() {
            if self.semantics.has_ended(&state, process) {
                return Ok(Some(state));
            }
            *looked_at += 1;
            if *looked_at > self.max_states {
                return Err(TooMany);
            }
            if seen.len() > MAX_STATES {
                let mut state = state;
                self.semantics.end(&mut state, process);
                return Ok(Some(state));
            }
            self.semantics.moves(&state, &mut moves);
            for &step in &moves {
                let is_own = step.is_closed || step.is_end || self.is_hidden(&state, step);
                if self.process(step.agent) != process || !is_own {
                    continue;
                }
                let (next, broken) = self.semantics.after(&state, step);
                if broken.is_none() {
                    seen.insert(next);
                }
            }
            at += 1;
        }
        Ok(None)
    }
}
