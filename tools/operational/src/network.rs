//! Networks as data: what the model gives a meaning to and the runtime runs.

use std::fmt;

/// Each value is sent by one step alone, so that a trace says which communication it shows.
pub type Value = u32;

/// What a channel holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kind {
    Rendezvous,
    Fifo(usize),
    OverwriteOldest(usize),
    OverwriteNewest(usize),
}

impl Kind {
    pub fn capacity(self) -> usize {
        match self {
            Kind::Rendezvous => 0,
            Kind::Fifo(n) | Kind::OverwriteOldest(n) | Kind::OverwriteNewest(n) => n,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Side {
    Sender,
    Receiver,
}

/// An end of a channel that an agent holds: at most one of each side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct End {
    pub channel: usize,
    pub side: Side,
}

/// How a value is offered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    Given,
    /// Kept by the offerer if another guard is chosen.
    From,
    /// Made only when chosen.
    With,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Guard {
    Send {
        channel: usize,
        value: Value,
        form: Form,
    },
    Recv {
        channel: usize,
    },
    Sync {
        barrier: usize,
    },
    /// Microseconds, which mean nothing to the model: it may fire at any time.
    After(u32),
}

/// What a fair alternative remembers to have chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Chosen {
    End(End),
    Barrier(usize),
    /// By an `Alternative`, which has a memory of its own.
    Input(usize),
}

impl Guard {
    pub fn end(self) -> Option<End> {
        let (channel, side) = match self {
            Guard::Send { channel, .. } => (channel, Side::Sender),
            Guard::Recv { channel } => (channel, Side::Receiver),
            Guard::Sync { .. } | Guard::After(_) => return None,
        };
        Some(End { channel, side })
    }

    /// A delay is not remembered.
    pub fn memory(self) -> Option<Chosen> {
        match self {
            Guard::Sync { barrier } => Some(Chosen::Barrier(barrier)),
            _ => self.end().map(Chosen::End),
        }
    }
}

/// A guard and its precondition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Offer {
    pub guard: Guard,
    pub open: bool,
}

/// How long a plain operation waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Patience {
    Forever,
    /// `send_timeout`, `recv_timeout`: exact.
    Timeout(u32),
    /// The operation's future is dropped by a combinator outside of LUNA, which checks the time
    /// first.
    Dropped(u32),
    /// `try_send`, `try_recv`.
    Try,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Step {
    /// A send or a receive alone.
    Plain(Guard, Patience),
    Alternative {
        fair: bool,
        offers: Vec<Offer>,
        skip: bool,
        /// As [`Patience::Dropped`]. Not for a fair alternative: its memory would depend on how far
        /// it had come.
        dropped: Option<u32>,
    },
    /// A selection of an `Alternative` over these channels. Equal steps in a row are selections of
    /// the same `Alternative`.
    Registered {
        fair: bool,
        inputs: Vec<usize>,
    },
    Poison(End),
    Drop(End),
    Sync(usize),
    /// The agents that are its branches.
    Par(Vec<usize>),
    /// A branch's own failure, whatever it does with those of its operations.
    Fail,
    /// Lets others run: means nothing to the model.
    Yield,
}

/// A process, or a branch of a parallel construct in one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Agent {
    /// Of a branch, the agent that it is part of.
    pub parent: Option<usize>,
    /// Whether it ends at its first operation that fails, as with `?`.
    pub strict: bool,
    pub level: u8,
    /// Dropped in this order when it ends.
    pub ends: Vec<End>,
    pub steps: Vec<Step>,
}

#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Network {
    pub channels: Vec<Kind>,
    /// How many must come.
    pub barriers: Vec<usize>,
    pub agents: Vec<Agent>,
}

impl Network {
    /// The agents that are processes.
    pub fn processes(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.agents.len()).filter(|&agent| self.agents[agent].parent.is_none())
    }

    /// Gives every agent the ends that its steps use, beside those that it has.
    pub fn hand_out_ends(&mut self) {
        for agent in &mut self.agents {
            let used: Vec<End> = agent.steps.iter().flat_map(Step::ends).collect();
            agent.ends.extend(used);
            agent.ends.sort_unstable();
            agent.ends.dedup();
        }
    }

    /// For each channel the agents that use it, and in which step last.
    pub fn uses(&self) -> Vec<Vec<(usize, u8)>> {
        let mut uses = vec![Vec::new(); self.channels.len()];
        for (number, agent) in self.agents.iter().enumerate() {
            for (channel, users) in uses.iter_mut().enumerate() {
                let is_use = |step: &Step| step.ends().iter().any(|end| end.channel == channel);
                if let Some(last) = agent.steps.iter().rposition(is_use) {
                    users.push((number, last as u8));
                }
            }
        }
        uses
    }
}

impl Step {
    /// The place of the timeout at which its future is dropped.
    pub fn dropped_at(&self) -> Option<u8> {
        match self {
            Step::Plain(_, Patience::Dropped(_)) => Some(1),
            Step::Alternative {
                offers,
                dropped: Some(_),
                ..
            } => Some(offers.len() as u8),
            _ => None,
        }
    }

    /// The ends that it uses.
    pub fn ends(&self) -> Vec<End> {
        match self {
            Step::Plain(guard, _) => guard.end().into_iter().collect(),
            Step::Alternative { offers, .. } => {
                let ends = offers.iter().filter_map(|offer| offer.guard.end());
                ends.collect()
            }
            Step::Registered { inputs, .. } => {
                let guards = inputs.iter().map(|&channel| Guard::Recv { channel });
                guards.filter_map(Guard::end).collect()
            }
            Step::Poison(end) | Step::Drop(end) => vec![*end],
            Step::Sync(_) | Step::Par(_) | Step::Fail | Step::Yield => Vec::new(),
        }
    }
}

/// What a step came to, as its agent sees it; with the guard's place in what was offered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Outcome {
    Sent(u8),
    Received(u8, Value),
    Failed(u8, Failure),
    /// All have come to the barrier.
    Synced(u8),
    /// The timeout at this place.
    Expired(u8),
    /// Nothing was ready: `skip`, or a `try_` operation that found no partner.
    Skipped,
    /// A step that has no other outcome.
    Done,
    /// A parallel construct: whether a branch failed.
    Joined {
        failed: bool,
    },
    /// The runtime did what no construct may do. No model allows it.
    Broken(&'static str),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Failure {
    Closed,
    Poisoned,
    /// The agent's own.
    Own,
}

impl Outcome {
    pub fn is_failure(self) -> bool {
        matches!(self, Outcome::Failed(..) | Outcome::Joined { failed: true })
    }
}

/// What an agent notes down, in the order of one clock for all agents.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// It begins the step at this place.
    Begins(u8),
    /// It has tried the operation and has to wait.
    Waits,
    /// That step has come to this.
    Ends(Outcome),
    /// It has dropped all its ends.
    Leaves,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    pub agent: usize,
    pub event: Event,
}

impl fmt::Display for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.side {
            Side::Sender => write!(f, "sender {}", self.channel),
            Side::Receiver => write!(f, "receiver {}", self.channel),
        }
    }
}

impl fmt::Display for Guard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Guard::Send {
                channel,
                value,
                form,
            } => match form {
                Form::Given => write!(f, "{channel}!{value}"),
                Form::From => write!(f, "{channel}!from({value})"),
                Form::With => write!(f, "{channel}!with({value})"),
            },
            Guard::Recv { channel } => write!(f, "{channel}?"),
            Guard::Sync { barrier } => write!(f, "sync {barrier}"),
            Guard::After(micros) => write!(f, "after {micros} us"),
        }
    }
}

impl fmt::Display for Step {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Step::Plain(guard, Patience::Forever) => write!(f, "{guard}"),
            Step::Plain(guard, Patience::Timeout(micros)) => {
                write!(f, "{guard} timeout {micros} us")
            }
            Step::Plain(guard, Patience::Dropped(micros)) => {
                write!(f, "{guard} dropped after {micros} us")
            }
            Step::Plain(guard, Patience::Try) => write!(f, "try {guard}"),
            Step::Alternative {
                fair,
                offers,
                skip,
                dropped,
            } => {
                f.write_str(if *fair { "alt {" } else { "pri_alt {" })?;
                for offer in offers {
                    let open = if offer.open { "" } else { ", if false" };
                    write!(f, " {}{open};", offer.guard)?;
                }
                f.write_str(if *skip { " skip }" } else { " }" })?;
                match dropped {
                    Some(micros) => write!(f, " dropped after {micros} us"),
                    None => Ok(()),
                }
            }
            Step::Registered { fair, inputs } => {
                let order = if *fair { "fair" } else { "prioritized" };
                write!(f, "{order} Alternative of {inputs:?}")
            }
            Step::Poison(end) => write!(f, "poison by {end}"),
            Step::Drop(end) => write!(f, "drop {end}"),
            Step::Sync(barrier) => write!(f, "sync {barrier}"),
            Step::Par(branches) => write!(f, "par {branches:?}"),
            Step::Fail => f.write_str("fail"),
            Step::Yield => f.write_str("yield"),
        }
    }
}

impl fmt::Display for Network {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (channel, kind) in self.channels.iter().enumerate() {
            writeln!(f, "channel {channel}: {kind:?}")?;
        }
        for (barrier, parties) in self.barriers.iter().enumerate() {
            writeln!(f, "barrier {barrier}: {parties} parties")?;
        }
        for (number, agent) in self.agents.iter().enumerate() {
            match agent.parent {
                None => write!(f, "process {number}, level {}", agent.level)?,
                Some(parent) => write!(f, "branch {number} of {parent}")?,
            }
            if agent.strict {
                f.write_str(", ends at its first failure")?;
            }
            let ends: Vec<_> = agent.ends.iter().map(End::to_string).collect();
            writeln!(f, ", holds {}", ends.join(", "))?;
            for (place, step) in agent.steps.iter().enumerate() {
                writeln!(f, "  {place}: {step}")?;
            }
        }
        Ok(())
    }
}

impl fmt::Display for Entry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let agent = self.agent;
        match self.event {
            Event::Begins(step) => write!(f, "{agent} begins step {step}"),
            Event::Waits => write!(f, "{agent} has to wait"),
            Event::Ends(outcome) => write!(f, "{agent} sees {outcome:?}"),
            Event::Leaves => write!(f, "{agent} has dropped its ends"),
        }
    }
}
