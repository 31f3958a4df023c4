//! What an exploration finds, state by state and at its end.

use super::state::{MAX_DEPTH, MAX_LOCAL_STEPS, Move, Semantics, State};
use super::{Finding, FindingKind, Space, TraceStep, livelock, script, unreached, words};

/// What is found on the way.
pub(super) struct Search {
    pub(super) findings: Vec<Finding>,
    /// Moves that are neither communications nor actions: from, to, and the number of the move.
    pub(super) silent: Vec<(u32, u32, u32)>,
    pub(super) taken: unreached::Taken,
}

impl Search {
    pub(super) fn is_new(&self, kind: &FindingKind) -> bool {
        !self.findings.iter().any(|found| found.kind == *kind)
    }

    pub(super) fn add(&mut self, kind: FindingKind, trace: Vec<TraceStep>, there: Vec<String>) {
        self.findings.push(Finding::new(kind, trace, there));
    }

    /// What can be seen in a state by itself.
    pub(super) fn look(
        &mut self,
        semantics: &Semantics<'_>,
        space: &Space,
        at: usize,
        state: &State,
    ) {
        let network = semantics.network;
        for (title, property) in &network.always {
            let kind = FindingKind::Always(title.clone());
            if !semantics.holds(state, property) && self.is_new(&kind) {
                let trace = words::trace(network, &space.way_to(semantics, at));
                self.add(kind, trace, words::places(semantics, state));
            }
        }
        if let Some(agent) = semantics.spinning(state)
            && self.is_new(&FindingKind::Livelock)
        {
            let trace = words::trace(network, &space.way_to(semantics, at));
            let name = &network.agents[agent].name;
            let there = vec![format!(
                "{name} does not come to wait: not within {MAX_LOCAL_STEPS} steps, and not within \
                 {MAX_DEPTH} `par` that begin one after the other"
            )];
            self.add(FindingKind::Livelock, trace, there);
        }
    }

    pub(super) fn deadlock(
        &mut self,
        semantics: &Semantics<'_>,
        space: &Space,
        at: usize,
        state: &State,
    ) {
        if self.is_new(&FindingKind::Deadlock) {
            let way = space.way_to(semantics, at);
            let trace = words::trace(semantics.network, &way);
            let (there, circle) = words::stuck(semantics, state);
            self.findings.push(Finding {
                circle,
                replay: Some(script::script(semantics.network, &way)),
                ..Finding::new(FindingKind::Deadlock, trace, there)
            });
        }
    }

    pub(super) fn livelock(&mut self, semantics: &Semantics<'_>, space: &Space) {
        if !self.is_new(&FindingKind::Livelock) {
            return;
        }
        let Some((start, cycle)) = livelock::cycle(&self.silent, space.states.len()) else {
            return;
        };
        let way = space.way_to(semantics, start as usize);
        let cycle = cycle.iter();
        let cycle = cycle.filter_map(|&(at, number)| space.move_of(semantics, at, number));
        let both: Vec<Move> = way.iter().copied().chain(cycle).collect();
        let mut trace = words::trace(semantics.network, &both);
        let mut there = vec!["for ever:".to_owned()];
        there.extend(trace.drain(way.len()..).map(|step| step.text));
        self.add(FindingKind::Livelock, trace, there);
    }
}
