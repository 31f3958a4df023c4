//! Processes that wait for ever while others go on: no deadlock, since something always happens.
//!
//! What can happen again and again without a way out is a component of the states that no move
//! leaves. A process that has not ended, and takes part in no move of such a component, never goes
//! on.

use super::state::{Move, Semantics};
use super::store::{push, vec_bytes};
use super::words;
use super::{Space, Stuck};
use std::collections::BTreeSet;

/// The states after each state.
#[derive(Debug, Default)]
pub(super) struct Moves {
    /// For each state where its own begin.
    starts: Vec<usize>,
    to: Vec<u32>,
}

impl Moves {
    /// What is added next is of the next state.
    pub(super) fn begin(&mut self) {
        push(&mut self.starts, self.to.len());
    }

    pub(super) fn add(&mut self, to: u32) {
        push(&mut self.to, to);
    }

    /// The bytes that it takes, also while it grows.
    pub(super) fn bytes(&self) -> u64 {
        vec_bytes(&self.starts, 1) + vec_bytes(&self.to, 1)
    }

    fn of(&self, state: usize) -> &[u32] {
        let end = self.starts.get(state + 1).copied();
        &self.to[self.starts[state]..end.unwrap_or(self.to.len())]
    }

    /// The components that no move leaves, each with its states (Tarjan's algorithm).
    fn last_components(&self) -> Vec<Vec<u32>> {
        const NEW: u32 = u32::MAX;
        let count = self.starts.len();
        let mut numbers = vec![NEW; count];
        let mut lowest = vec![0_u32; count];
        let mut component = vec![NEW; count];
        let (mut stack, mut open) = (Vec::new(), vec![(0_usize, 0_usize)]);
        let (mut next, mut components) = (0_u32, 0_u32);
        let mut found = Vec::new();
        while let Some((state, at)) = open.pop() {
            if at == 0 {
                (numbers[state], lowest[state]) = (next, next);
                next += 1;
                stack.push(state as u32);
            }
            if let Some(&to) = self.of(state).get(at) {
                open.push((state, at + 1));
                let to = to as usize;
                if numbers[to] == NEW {
                    open.push((to, 0));
                } else if component[to] == NEW {
                    lowest[state] = lowest[state].min(numbers[to]);
                }
                continue;
            }
            if lowest[state] == numbers[state] {
                let first = stack.iter().rposition(|&one| one as usize == state);
                let states = stack.split_off(first.unwrap_or(0));
                for &one in &states {
                    component[one as usize] = components;
                }
                let is_left = |&one: &u32| {
                    let mut all = self.of(one as usize).iter();
                    all.any(|&to| component[to as usize] != components)
                };
                if !states.iter().any(is_left) {
                    found.push(states);
                }
                components += 1;
            }
            if let Some(&(before, _)) = open.last() {
                lowest[before] = lowest[before].min(lowest[state]);
            }
        }
        found
    }
}

/// The processes that wait for ever in the component that is reached first.
pub(super) fn stuck(semantics: &Semantics<'_>, space: &Space, moves: &Moves) -> Option<Stuck> {
    let network = semantics.network;
    let mut found: Option<(u32, Vec<usize>)> = None;
    let mut possible: Vec<Move> = Vec::new();
    for states in moves.last_components() {
        let first = states.iter().copied().min()?;
        let goes_on = states.iter().any(|&one| !moves.of(one as usize).is_empty());
        if !goes_on || found.as_ref().is_some_and(|(known, _)| *known < first) {
            continue;
        }
        let mut active = BTreeSet::new();
        for &one in &states {
            semantics.moves(&space.states.get(one), &mut possible);
            for step in &possible {
                let agents = std::iter::once(step.agent);
                let agents = agents.chain(step.partner.map(|(partner, _)| partner));
                active.extend(agents.map(|agent| network.agents[agent].process));
            }
            if active.len() == network.processes.len() {
                break;
            }
        }
        let state = space.states.get(first);
        let all = 0..network.processes.len();
        let waiting = all.filter(|one| !active.contains(one) && !semantics.has_ended(&state, *one));
        let waiting: Vec<usize> = waiting.collect();
        if !waiting.is_empty() {
            found = Some((first, waiting));
        }
    }
    let (first, waiting) = found?;
    let state = space.states.get(first);
    let agents = network.agents.iter().enumerate();
    let agents = agents.filter(|(_, agent)| waiting.contains(&agent.process));
    let there = agents.filter_map(|(agent, _)| words::place(semantics, &state, agent));
    let names = waiting
        .iter()
        .map(|&one| network.processes[one].name.clone());
    Some(Stuck {
        processes: names.collect(),
        trace: words::trace(network, &space.way_to(semantics, first as usize)),
        there: there.collect(),
    })
}
