//! Explores all states of a network.

pub(crate) mod circle;
pub(crate) mod livelock;
mod moves;
mod script;
pub(crate) mod state;
pub(crate) mod unreached;
mod waiting;
pub(crate) mod words;

use crate::draw::sequence;
use crate::network::Network;
use indexmap::IndexSet;
use rustc_hash::FxBuildHasher;
use state::{MAX_DEPTH, MAX_LOCAL_STEPS, Move, Semantics, State};
use std::fmt;

/// A limit on states that needs at most a few GB and some minutes.
pub const DEFAULT_MAX_STATES: usize = 2_000_000;

/// What the exploration has found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exploration {
    /// How many states were seen.
    pub states: usize,
    /// Whether these are all: if not, what was not found may be there all the same.
    pub is_complete: bool,
    /// At most one of each kind, and one for each property; each with the shortest way to it.
    pub findings: Vec<Finding>,
    /// Branches that no run takes; empty if the exploration is not complete.
    pub unreached: Vec<Unreached>,
    /// Processes that wait for ever while others go on, where that is reached first; none if the
    /// exploration is not complete. In some models it is meant so: a hint, no error.
    pub stuck: Option<Stuck>,
}

/// Processes that wait for ever while others go on, and how it comes to that.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stuck {
    /// Their names.
    pub processes: Vec<String>,
    /// What happens up to there.
    pub trace: Vec<TraceStep>,
    /// What they wait for, a line each.
    pub there: Vec<String>,
}

/// What is wrong, and how it comes to that.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// Of what kind.
    pub kind: FindingKind,
    /// What happens up to there.
    pub trace: Vec<TraceStep>,
    /// What is the case there, a line each.
    pub there: Vec<String>,
    /// Processes of which each waits for the next, and the last for the first; empty if there is no
    /// such circle.
    pub circle: Vec<String>,
    /// Of a deadlock, unless SPIN found it: the way to it as a file that the program generated from
    /// the model follows, by `--replay FILE`.
    pub replay: Option<String>,
}

impl Finding {
    pub(crate) fn new(kind: FindingKind, trace: Vec<TraceStep>, there: Vec<String>) -> Self {
        Self {
            kind,
            trace,
            there,
            circle: Vec::new(),
            replay: None,
        }
    }

    /// An SVG file: a column for each process that does something, and a message for each
    /// communication, from the first one on; below, what is the case there.
    #[must_use]
    pub fn to_svg(&self) -> String {
        sequence(self)
    }
}

/// One step of what happens. Its text says all of it in words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TraceStep {
    /// In words.
    pub text: String,
    /// The same in parts.
    pub parts: StepParts,
}

/// The parts of a step.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StepParts {
    /// A communication.
    Communication {
        /// The process that sends; none if the value comes from a buffer.
        sender: Option<String>,
        /// The process that receives; none if the value goes into a buffer.
        receiver: Option<String>,
        /// The channel, with the value.
        what: String,
    },
    /// What a process does by itself.
    Act {
        /// The process.
        process: String,
        /// Its action.
        what: String,
    },
    /// A note between two steps.
    Note,
}

impl fmt::Display for TraceStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// Kinds of findings.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FindingKind {
    /// Nothing can happen, and not all processes have ended.
    Deadlock,
    /// Processes can go on for ever without a communication, an action or a delay.
    Livelock,
    /// An `assert` does not hold, or a value is out of its range.
    Assertion,
    /// A property of `check.always` does not hold.
    Always(String),
    /// A property of `check.ltl` does not hold: found by SPIN.
    Ltl(String),
}

impl fmt::Display for FindingKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Deadlock => f.write_str("deadlock"),
            Self::Livelock => f.write_str("livelock"),
            Self::Assertion => f.write_str("broken assertion"),
            Self::Always(title) => write!(f, "not always: {title}"),
            Self::Ltl(title) => write!(f, "property {title} does not hold"),
        }
    }
}

/// A branch that no run takes.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Unreached {
    /// In the file.
    pub line: usize,
    /// The definition of the process.
    pub process: String,
    /// What is never done.
    pub what: String,
}

/// The states in the order in which they were seen, each with the move that led to it first.
pub(crate) struct Space {
    pub(crate) states: IndexSet<State, FxBuildHasher>,
    /// The state before, and the move from there.
    pub(crate) origins: Vec<Option<(u32, Move)>>,
}

impl Space {
    /// The moves to a state, from the first one on.
    pub(crate) fn way_to(&self, state: usize) -> Vec<Move> {
        let mut way = Vec::new();
        let mut at = state;
        while let Some((before, step)) = self.origins[at] {
            way.push(step);
            at = before as usize;
        }
        way.reverse();
        way
    }
}

/// Explores breadth first, so that the first way to each state is a shortest one.
pub(crate) fn explore(network: &Network, max_states: usize) -> Exploration {
    let mut semantics = Semantics::new(network);
    let (first, broken) = semantics.first();
    let mut space = Space {
        states: IndexSet::default(),
        origins: vec![None],
    };
    space.states.insert(first);
    let mut search = Search {
        findings: Vec::new(),
        silent: Vec::new(),
        taken: unreached::Taken::new(network),
    };
    if let Some(broken) = broken {
        let there = vec![words::broken(network, &broken)];
        search.add(FindingKind::Assertion, Vec::new(), there);
        // There is no run.
        return Exploration {
            states: 1,
            is_complete: true,
            findings: search.findings,
            unreached: Vec::new(),
            stuck: None,
        };
    }
    let mut is_complete = true;
    let mut after = waiting::Moves::default();
    let mut moves = Vec::new();
    let mut at = 0;
    while let Some(state) = space.states.get_index(at).cloned() {
        search.look(&semantics, &space, at, &state);
        semantics.moves(&state, &mut moves);
        if moves.is_empty() && !semantics.is_over(&state) && semantics.spinning(&state).is_none() {
            search.deadlock(&semantics, &space, at, &state);
        }
        after.begin();
        for &step in &moves {
            search.taken.take(&state, step);
            let (next, broken) = semantics.after(&state, step);
            if let Some(broken) = broken {
                if search.is_new(&FindingKind::Assertion) {
                    let mut way = space.way_to(at);
                    way.push(step);
                    let trace = words::trace(network, &way);
                    let there = vec![words::broken(network, &broken)];
                    search.add(FindingKind::Assertion, trace, there);
                }
                continue;
            }
            let number = match space.states.get_index_of(&next) {
                Some(number) => number,
                None if space.states.len() >= max_states => {
                    is_complete = false;
                    continue;
                }
                None => {
                    space.origins.push(Some((at as u32, step)));
                    space.states.insert_full(next).0
                }
            };
            after.add(number);
            let edge = semantics.edge(&state, step);
            if edge.is_some_and(|edge| edge.label.is_silent()) {
                search.silent.push((at as u32, number as u32, step));
            }
        }
        at += 1;
    }
    search.livelock(&semantics, &space);
    search.findings.sort_by(|a, b| a.kind.cmp(&b.kind));
    Exploration {
        states: space.states.len(),
        is_complete,
        findings: search.findings,
        unreached: match is_complete {
            true => search.taken.unreached(&semantics),
            false => Vec::new(),
        },
        stuck: match is_complete {
            true => waiting::stuck(&semantics, &space, &after),
            false => None,
        },
    }
}

struct Search {
    findings: Vec<Finding>,
    /// Moves that are neither communications nor actions.
    silent: Vec<(u32, u32, Move)>,
    taken: unreached::Taken,
}

impl Search {
    fn is_new(&self, kind: &FindingKind) -> bool {
        !self.findings.iter().any(|found| found.kind == *kind)
    }

    fn add(&mut self, kind: FindingKind, trace: Vec<TraceStep>, there: Vec<String>) {
        self.findings.push(Finding::new(kind, trace, there));
    }

    /// What can be seen in a state by itself.
    fn look(&mut self, semantics: &Semantics<'_>, space: &Space, at: usize, state: &State) {
        let network = semantics.network;
        for (title, property) in &network.always {
            let kind = FindingKind::Always(title.clone());
            if !semantics.holds(state, property) && self.is_new(&kind) {
                let trace = words::trace(network, &space.way_to(at));
                self.add(kind, trace, words::places(semantics, state));
            }
        }
        if let Some(agent) = semantics.spinning(state)
            && self.is_new(&FindingKind::Livelock)
        {
            let trace = words::trace(network, &space.way_to(at));
            let name = &network.agents[agent].name;
            let there = vec![format!(
                "{name} does not come to wait: not within {MAX_LOCAL_STEPS} steps, and not within \
                 {MAX_DEPTH} `par` that begin one after the other"
            )];
            self.add(FindingKind::Livelock, trace, there);
        }
    }

    fn deadlock(&mut self, semantics: &Semantics<'_>, space: &Space, at: usize, state: &State) {
        if self.is_new(&FindingKind::Deadlock) {
            let way = space.way_to(at);
            let trace = words::trace(semantics.network, &way);
            let (there, circle) = words::stuck(semantics, state);
            self.findings.push(Finding {
                circle,
                replay: Some(script::script(semantics.network, &way)),
                ..Finding::new(FindingKind::Deadlock, trace, there)
            });
        }
    }

    fn livelock(&mut self, semantics: &Semantics<'_>, space: &Space) {
        if !self.is_new(&FindingKind::Livelock) {
            return;
        }
        let Some((start, cycle)) = livelock::cycle(&self.silent) else {
            return;
        };
        let way = space.way_to(start as usize);
        let both: Vec<Move> = way.iter().chain(&cycle).copied().collect();
        let mut trace = words::trace(semantics.network, &both);
        let mut there = vec!["for ever:".to_owned()];
        there.extend(trace.drain(way.len()..).map(|step| step.text));
        self.add(FindingKind::Livelock, trace, there);
    }
}
