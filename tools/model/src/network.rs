//! A model with all its arrays and compositions laid out: what is explored, exported and drawn.

use crate::elaborate::Scope;
use crate::file::{At, Side};
use crate::language::expr::Expr;
use crate::language::temporal::Formula;
use std::collections::BTreeSet;
use std::time::Duration;

/// What a channel holds, and what a send does if that is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Buffering {
    Rendezvous,
    Fifo(usize),
    OverwriteOldest(usize),
    OverwriteNewest(usize),
}

impl Buffering {
    /// Whether it always takes a value.
    pub(crate) const fn overwrites(self) -> bool {
        match self {
            Self::Rendezvous | Self::Fifo(_) => false,
            Self::OverwriteOldest(_) | Self::OverwriteNewest(_) => true,
        }
    }

    pub(crate) const fn capacity(self) -> usize {
        match self {
            Self::Rendezvous => 0,
            Self::Fifo(n) | Self::OverwriteOldest(n) | Self::OverwriteNewest(n) => n,
        }
    }
}

/// A whole model.
#[derive(Debug, Default)]
pub(crate) struct Network {
    pub(crate) name: String,
    /// The system first; a group stands behind the one that it is in.
    pub(crate) groups: Vec<Group>,
    pub(crate) channels: Vec<Channel>,
    pub(crate) processes: Vec<Process>,
    pub(crate) agents: Vec<Agent>,
    pub(crate) variables: Vec<Variable>,
    pub(crate) always: Vec<(String, Expr<Atom>)>,
    pub(crate) ltl: Vec<(String, Formula<Atom>)>,
    pub(crate) max_states: Option<usize>,
    /// Where processes run.
    pub(crate) executors: Vec<Executor>,
    /// By so much a release may be late.
    pub(crate) latency: Option<Duration>,
}

impl Network {
    /// The variables that an agent and its branches use, and those that they set.
    pub(crate) fn uses(&self, agent: usize) -> (BTreeSet<usize>, BTreeSet<usize>) {
        let (mut used, mut set) = (BTreeSet::new(), BTreeSet::new());
        for place in &self.agents[agent].code {
            match &place.step {
                Step::Assign(slot, value, _) => {
                    value.each(&mut |slot| used.extend([*slot]));
                    set.insert(*slot);
                }
                Step::Branch(condition, ..) | Step::Assert(condition, _) => {
                    condition.each(&mut |slot| used.extend([*slot]));
                }
                Step::Fork(branches, _) => {
                    for &branch in branches {
                        let (inner_used, inner_set) = self.uses(branch);
                        used.extend(inner_used);
                        set.extend(inner_set);
                    }
                }
                Step::Wait(edges) => {
                    for edge in edges {
                        if let Some(condition) = &edge.condition {
                            condition.each(&mut |slot| used.extend([*slot]));
                        }
                        match &edge.label {
                            Label::Send(_, Some(value)) => {
                                value.each(&mut |slot| used.extend([*slot]));
                            }
                            Label::Receive(_, Some(slot)) => set.extend([*slot]),
                            Label::Send(_, None) | Label::Receive(_, None) => {}
                            Label::Choice | Label::Skip | Label::After | Label::Own(_) => {}
                        }
                    }
                }
                Step::End | Step::Goto(_) | Step::Join(..) => {}
            }
        }
        used.extend(&set);
        (used, set)
    }
}

/// An executor or a thread, and where it is.
#[derive(Debug)]
pub(crate) struct Executor {
    pub(crate) name: String,
    pub(crate) is_thread: bool,
    /// Empty if it is not stated.
    pub(crate) host: String,
    pub(crate) core: Option<u16>,
    pub(crate) policy: Option<String>,
}

/// The system, or a part that is made of parts.
#[derive(Debug)]
pub(crate) struct Group {
    pub(crate) name: String,
    pub(crate) parent: Option<usize>,
    pub(crate) at: Option<At>,
}

#[derive(Debug)]
pub(crate) struct Channel {
    /// With the parts that it is in: `cell.ready[1]`.
    pub(crate) name: String,
    pub(crate) kind: Buffering,
    pub(crate) type_name: String,
    /// The values that the check follows.
    pub(crate) values: Option<(i32, i32)>,
    /// The processes that hold its ends.
    pub(crate) senders: Vec<usize>,
    pub(crate) receivers: Vec<usize>,
}

impl Channel {
    /// The processes on the other side.
    pub(crate) fn partners(&self, side: Side) -> &[usize] {
        match side {
            Side::Send => &self.receivers,
            Side::Receive => &self.senders,
        }
    }
}

/// A process that has a body.
#[derive(Debug)]
pub(crate) struct Process {
    /// With the parts that it is in: `cell.feeder[1]`.
    pub(crate) name: String,
    pub(crate) definition: String,
    pub(crate) group: usize,
    pub(crate) at: Option<At>,
    /// The agent that is its body; its branches have the same process.
    pub(crate) agent: usize,
    pub(crate) priority: Option<u8>,
    pub(crate) period: Option<Duration>,
    pub(crate) on: Option<String>,
    /// The longest execution time of a job, and the longest poll.
    pub(crate) cost: Option<Duration>,
    pub(crate) longest_poll: Option<Duration>,
    pub(crate) deadline: Option<Duration>,
    /// Its parameters, and the channels behind its ports.
    pub(crate) scope: Scope,
}

/// The body of a process, or a branch of `par` in it.
#[derive(Debug)]
pub(crate) struct Agent {
    pub(crate) process: usize,
    pub(crate) name: String,
    pub(crate) parent: Option<usize>,
    /// The branches of the same `par`, itself among them.
    pub(crate) siblings: Vec<usize>,
    pub(crate) start: usize,
    pub(crate) code: Vec<Place>,
}

/// The place in each code at which it ends.
pub(crate) const END: usize = 0;

/// A place in a body.
#[derive(Debug)]
pub(crate) struct Place {
    pub(crate) step: Step,
    /// In the file.
    pub(crate) line: usize,
}

#[derive(Debug)]
pub(crate) enum Step {
    End,
    Goto(usize),
    Assign(usize, Expr<usize>, usize),
    Branch(Expr<usize>, usize, usize),
    Assert(Expr<usize>, usize),
    Fork(Vec<usize>, usize),
    Join(Vec<usize>, usize),
    /// Waits for one of these.
    Wait(Vec<Edge>),
}

impl Agent {
    /// Which places a path from these comes to.
    pub(crate) fn reached(&self, mut open: Vec<usize>) -> Vec<bool> {
        let mut reached = vec![false; self.code.len()];
        while let Some(at) = open.pop() {
            if !std::mem::replace(&mut reached[at], true) {
                open.extend(self.code[at].step.after());
            }
        }
        reached
    }
}

impl Step {
    /// The moves of which it waits for one.
    pub(crate) fn edges(&self) -> &[Edge] {
        match self {
            Self::Wait(edges) => edges,
            _ => &[],
        }
    }

    /// The places that may come after it.
    pub(crate) fn after(&self) -> Vec<usize> {
        match self {
            Self::End => Vec::new(),
            Self::Goto(next)
            | Self::Assign(_, _, next)
            | Self::Assert(_, next)
            | Self::Fork(_, next)
            | Self::Join(_, next) => vec![*next],
            Self::Branch(_, then, otherwise) => vec![*then, *otherwise],
            Self::Wait(edges) => edges.iter().map(|edge| edge.next).collect(),
        }
    }
}

#[derive(Debug)]
pub(crate) struct Edge {
    pub(crate) condition: Option<Expr<usize>>,
    pub(crate) label: Label,
    pub(crate) next: usize,
    pub(crate) line: usize,
}

/// What a process does on an edge.
#[derive(Debug)]
pub(crate) enum Label {
    Send(usize, Option<Expr<usize>>),
    Receive(usize, Option<usize>),
    /// A branch of `choose`.
    Choice,
    Skip,
    After,
    /// By its name.
    Own(String),
}

impl Label {
    /// Neither a communication, nor an action, nor time that passes.
    pub(crate) const fn is_silent(&self) -> bool {
        match self {
            Self::Choice | Self::Skip => true,
            Self::Send(..) | Self::Receive(..) | Self::After | Self::Own(_) => false,
        }
    }

    pub(crate) const fn end(&self) -> Option<(usize, Side)> {
        match self {
            Self::Send(channel, _) => Some((*channel, Side::Send)),
            Self::Receive(channel, _) => Some((*channel, Side::Receive)),
            Self::Choice | Self::Skip | Self::After | Self::Own(_) => None,
        }
    }
}

#[derive(Debug)]
pub(crate) struct Variable {
    pub(crate) process: usize,
    pub(crate) name: String,
    pub(crate) low: i32,
    pub(crate) high: i32,
    pub(crate) first: i32,
}

/// What a property speaks of.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) enum Atom {
    Variable(usize),
    /// Whether one of these agents is at this place of its code.
    At(Vec<(usize, usize)>),
}
