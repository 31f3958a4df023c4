//! Explores all states of a network.

pub(crate) mod circle;
pub(crate) mod livelock;
mod moves;
mod script;
mod search;
pub(crate) mod state;
pub(crate) mod store;
pub(crate) mod unreached;
mod waiting;
pub(crate) mod words;

use crate::draw::sequence;
use crate::memory::{Reserved, default_memory};
use crate::network::Network;
use search::Search;
use state::{Move, Semantics};
use std::fmt;
use store::{Store, push, vec_bytes};

/// A limit on states that needs some minutes.
pub const DEFAULT_MAX_STATES: usize = 2_000_000;

/// After so many states the progress is reported.
const REPORT_EVERY: usize = 64;

/// What an exploration may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Limits {
    /// So many states.
    pub states: usize,
    /// So many bytes of memory, for the states and what is found of them. The model itself and the
    /// text of what is found come on top.
    pub bytes: u64,
}

impl Limits {
    /// So many states, in [half of what is free](default_memory()).
    #[must_use]
    pub fn of_states(states: usize) -> Self {
        Self {
            states,
            bytes: default_memory(),
        }
    }

    /// With another bound of memory.
    #[must_use]
    pub fn bytes(self, bytes: u64) -> Self {
        Self { bytes, ..self }
    }
}

/// Which limit has ended an exploration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Limit {
    /// That of states.
    States(usize),
    /// That of memory (bytes).
    Memory(u64),
}

/// What the exploration has found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exploration {
    /// How many states were looked at.
    pub states: usize,
    /// Whether these are all: if not, what was not found may be there all the same.
    pub is_complete: bool,
    /// The limit that was reached, if they are not.
    pub limit: Option<Limit>,
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
    pub(crate) states: Store,
    /// The state before, and the number of the move from there; of the first state, nothing.
    origins: Vec<(u32, u32)>,
}

impl Space {
    /// The moves to a state, from the first one on.
    pub(crate) fn way_to(&self, semantics: &Semantics<'_>, state: usize) -> Vec<Move> {
        let mut way = Vec::new();
        let mut at = state;
        while at > 0 {
            let (before, number) = self.origins[at];
            way.extend(self.move_of(semantics, before, number));
            at = before as usize;
        }
        way.reverse();
        way
    }

    /// A move of a state, by its number.
    fn move_of(&self, semantics: &Semantics<'_>, state: u32, number: u32) -> Option<Move> {
        let mut moves = Vec::new();
        semantics.moves(&self.states.get(state), &mut moves);
        moves.get(number as usize).copied()
    }
}

/// Explores breadth first, so that the first way to each state is a shortest one. Calls `progress`
/// with the states that were looked at and those that are known.
pub(crate) fn explore(
    network: &Network,
    limits: Limits,
    progress: &mut dyn FnMut(usize, usize),
) -> Exploration {
    let _reserved = Reserved::new(limits.bytes);
    let mut semantics = Semantics::new(network);
    let (first, broken) = semantics.first();
    let mut space = Space {
        states: Store::new(first.len()),
        origins: vec![(0, 0)],
    };
    space.states.add(&first, true);
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
            limit: None,
            findings: search.findings,
            unreached: Vec::new(),
            stuck: None,
        };
    }
    let mut limit = None;
    let mut after = waiting::Moves::default();
    let mut moves = Vec::new();
    let mut at = 0;
    'all: while at < space.states.len() {
        if at % REPORT_EVERY == 0 {
            progress(at, space.states.len());
        }
        let state = space.states.unfold(at as u32);
        search.look(&semantics, &space, at, &state);
        semantics.moves(&state, &mut moves);
        if moves.is_empty() && !semantics.is_over(&state) && semantics.spinning(&state).is_none() {
            search.deadlock(&semantics, &space, at, &state);
        }
        // It is of use only if all states are looked at.
        if limit.is_none() {
            after.begin();
        }
        for (move_number, &step) in moves.iter().enumerate() {
            search.taken.take(&state, step);
            let (next, broken) = semantics.after(&state, step);
            if let Some(broken) = broken {
                if search.is_new(&FindingKind::Assertion) {
                    let mut way = space.way_to(&semantics, at);
                    way.push(step);
                    let trace = words::trace(network, &way);
                    let there = vec![words::broken(network, &broken)];
                    search.add(FindingKind::Assertion, trace, there);
                }
                continue;
            }
            let stop = reached(&limits, &space, &after, &search);
            if matches!(stop, Some(Limit::Memory(_))) {
                limit = stop;
                break 'all;
            }
            let Some((number, is_new)) = space.states.add(&next, stop.is_none()) else {
                limit = stop;
                continue;
            };
            if is_new {
                push(&mut space.origins, (at as u32, move_number as u32));
            }
            if limit.is_none() {
                after.add(number);
            }
            let edge = semantics.edge(&state, step);
            if edge.is_some_and(|edge| edge.label.is_silent()) {
                push(&mut search.silent, (at as u32, number, move_number as u32));
            }
        }
        at += 1;
    }
    let is_out_of_memory = matches!(limit, Some(Limit::Memory(_)));
    search.livelock(&semantics, &space);
    search.findings.sort_by(|a, b| a.kind.cmp(&b.kind));
    let is_complete = limit.is_none();
    Exploration {
        states: match is_out_of_memory {
            true => at,
            false => space.states.len(),
        },
        is_complete,
        limit,
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

/// The limit that one more state would be beyond, if there is one.
fn reached(
    limits: &Limits,
    space: &Space,
    after: &waiting::Moves,
    search: &Search,
) -> Option<Limit> {
    /// What the searches at the end need for a state and a silent move, at most.
    const EACH_STATE: u64 = 72;
    const EACH_SILENT: u64 = 8;
    let states = space.states.len();
    let bytes = space.states.bytes()
        + vec_bytes(&space.origins, 1)
        + after.bytes()
        + vec_bytes(&search.silent, 1)
        + states as u64 * EACH_STATE
        + search.silent.len() as u64 * EACH_SILENT;
    if bytes > limits.bytes || !space.states.has_numbers() {
        return Some(Limit::Memory(limits.bytes));
    }
    (states >= limits.states).then_some(Limit::States(limits.states))
}
