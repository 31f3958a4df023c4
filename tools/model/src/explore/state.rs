//! States of a network, and the moves from one to the next.

use crate::file::Side;
use crate::language::expr::{Expr, Fault};
use crate::network::{Atom, Buffering, Channel, END, Edge, Label, Network, Step};

/// Places of agents, values of variables, contents of channels.
pub(crate) type State = Box<[i32]>;

/// Of a branch that does not run.
const IDLE: i32 = -1;
/// Of a branch that has found a channel closed, and ended.
const FAILED: i32 = -2;
/// Of an agent that computes for ever.
const SPINS: i32 = -3;
/// Of a process that has dropped its ends. Between its last step and that, others may go on.
const ENDED: i32 = -4;

/// An agent that goes on for longer without waiting is taken to do so for ever.
pub(super) const MAX_LOCAL_STEPS: usize = 100_000;
/// So many branches that begin and end by themselves, one after the other, are taken to do so too.
pub(super) const MAX_DEPTH: usize = 500;

/// What an agent does, and its partners.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Move {
    pub(crate) agent: usize,
    pub(crate) edge: usize,
    /// The agent and the edge that receive what is sent.
    pub(crate) partner: Option<(usize, usize)>,
    /// It finds the channel closed, and ends.
    pub(crate) is_closed: bool,
    /// It has come to its end, and drops its ends of channels.
    pub(crate) is_end: bool,
}

/// Where an agent broke a rule.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Broken {
    pub(crate) agent: usize,
    pub(crate) line: usize,
    pub(crate) what: String,
}

/// Gives a network its meaning.
#[derive(Debug)]
pub(crate) struct Semantics<'a> {
    pub(crate) network: &'a Network,
    /// Where each channel's contents are: their number, then so many values.
    pub(super) contents: Vec<usize>,
    size: usize,
    /// How many agents go on because of each other.
    depth: usize,
    /// They were too many: the others of this move compute for ever, too.
    is_endless: bool,
    /// For each channel the agents that may receive from it.
    pub(super) receivers: Vec<Vec<usize>>,
    /// For each agent and place, whether it was reached.
    pub(crate) reached: Vec<Vec<bool>>,
}

impl<'a> Semantics<'a> {
    pub(crate) fn new(network: &'a Network) -> Self {
        let mut size = network.agents.len() + network.variables.len();
        let mut contents = Vec::new();
        for channel in &network.channels {
            contents.push(size);
            if channel.kind != Buffering::Rendezvous {
                size += 1 + channel.kind.capacity();
            }
        }
        let mut receivers = vec![Vec::new(); network.channels.len()];
        for (number, agent) in network.agents.iter().enumerate() {
            for place in &agent.code {
                for edge in place.step.edges() {
                    if let Label::Receive(channel, _) = edge.label
                        && receivers[channel].last() != Some(&number)
                    {
                        receivers[channel].push(number);
                    }
                }
            }
        }
        let reached = network
            .agents
            .iter()
            .map(|agent| vec![false; agent.code.len()]);
        Self {
            network,
            contents,
            size,
            depth: 0,
            is_endless: false,
            receivers,
            reached: reached.collect(),
        }
    }

    /// How many values a state has.
    pub(crate) fn values(&self) -> usize {
        self.size
    }

    /// Where all begin.
    pub(crate) fn first(&mut self) -> (State, Option<Broken>) {
        let mut state = vec![0; self.size].into_boxed_slice();
        let agents = self.network.agents.len();
        for (number, agent) in self.network.agents.iter().enumerate() {
            state[number] = match agent.parent {
                None => agent.start as i32,
                Some(_) => IDLE,
            };
        }
        for (number, variable) in self.network.variables.iter().enumerate() {
            state[agents + number] = variable.first;
        }
        let mut broken = None;
        for process in &self.network.processes {
            if let Err(found) = self.settle(&mut state, process.agent) {
                broken.get_or_insert(found);
            }
        }
        (state, broken)
    }

    fn value(&self, state: &State, expr: &Expr<usize>) -> Result<i32, Fault> {
        let first = self.network.agents.len();
        expr.value(&|slot| state[first + slot])
    }

    /// The value of a property; one that has no value is not true.
    pub(crate) fn holds(&self, state: &State, expr: &Expr<Atom>) -> bool {
        let first = self.network.agents.len();
        let value = expr.value(&|atom| match atom {
            Atom::Variable(slot) => state[first + slot],
            Atom::At(places) => places
                .iter()
                .any(|&(agent, place)| state[agent] == place as i32)
                .into(),
        });
        value.is_ok_and(|value| value != 0)
    }

    /// The variable's value.
    pub(crate) fn variable(&self, state: &State, slot: usize) -> i32 {
        state[self.network.agents.len() + slot]
    }

    /// Takes what an agent does by itself, up to where it waits.
    fn settle(&mut self, state: &mut State, agent: usize) -> Result<(), Broken> {
        self.is_endless |= self.depth > MAX_DEPTH;
        if self.is_endless {
            state[agent] = SPINS;
            return Ok(());
        }
        self.depth += 1;
        let settled = self.go_on(state, agent);
        self.depth -= 1;
        self.is_endless &= self.depth > 0;
        settled
    }

    fn go_on(&mut self, state: &mut State, agent: usize) -> Result<(), Broken> {
        let network = self.network;
        let first = network.agents.len();
        for _ in 0..MAX_LOCAL_STEPS {
            let Ok(at) = usize::try_from(state[agent]) else {
                return Ok(());
            };
            self.reached[agent][at] = true;
            let place = &network.agents[agent].code[at];
            let broken = |what: String| Broken {
                agent,
                line: place.line,
                what,
            };
            let fault = |fault: Fault| broken(fault.to_string());
            let next = match &place.step {
                Step::End => return self.ended(state, agent),
                Step::Goto(next) => *next,
                Step::Assign(slot, value, next) => {
                    let value = self.value(state, value).map_err(fault)?;
                    self.in_range(*slot, value).map_err(broken)?;
                    state[first + slot] = value;
                    *next
                }
                Step::Branch(condition, then, otherwise) => {
                    match self.value(state, condition).map_err(fault)? {
                        0 => *otherwise,
                        _ => *then,
                    }
                }
                Step::Assert(condition, next) => {
                    if self.value(state, condition).map_err(fault)? == 0 {
                        return Err(broken("breaks its `assert`".to_owned()));
                    }
                    *next
                }
                Step::Fork(branches, join) => {
                    state[agent] = *join as i32;
                    for &branch in branches {
                        state[branch] = network.agents[branch].start as i32;
                    }
                    for &branch in branches {
                        self.settle(state, branch)?;
                    }
                    return Ok(());
                }
                Step::Join(..) => return Ok(()),
                Step::Wait(edges) => {
                    return self.offers(state, edges).map_err(|(what, line)| Broken {
                        agent,
                        line,
                        what,
                    });
                }
            };
            state[agent] = next as i32;
        }
        state[agent] = SPINS;
        Ok(())
    }

    /// All that is offered must have values of the channels' types.
    fn offers(&self, state: &State, edges: &[Edge]) -> Result<(), (String, usize)> {
        for edge in edges {
            let fault = |fault: Fault| (fault.to_string(), edge.line);
            let is_open = match &edge.condition {
                None => 1,
                Some(condition) => self.value(state, condition).map_err(fault)?,
            };
            let Label::Send(channel, Some(value)) = &edge.label else {
                continue;
            };
            // A guard with a false precondition is not evaluated.
            if is_open == 0 {
                continue;
            }
            let value = self.value(state, value).map_err(fault)?;
            let channel = &self.network.channels[*channel];
            let (low, high) = channel.values.unwrap_or((i32::MIN, i32::MAX));
            if !(low..=high).contains(&value) {
                let name = &channel.name;
                let what = format!("sends {value} on {name}, whose values are {low}..{high}");
                return Err((what, edge.line));
            }
        }
        Ok(())
    }

    fn in_range(&self, slot: usize, value: i32) -> Result<(), String> {
        let variable = &self.network.variables[slot];
        if (variable.low..=variable.high).contains(&value) {
            return Ok(());
        }
        let (name, low, high) = (&variable.name, variable.low, variable.high);
        Err(format!(
            "sets {name} to {value}, whose values are {low}..{high}"
        ))
    }

    /// An agent has come to its end, or failed: if it is the last branch, the agent around goes on.
    fn ended(&mut self, state: &mut State, agent: usize) -> Result<(), Broken> {
        let network = self.network;
        let Some(parent) = network.agents[agent].parent else {
            return Ok(());
        };
        let siblings = &network.agents[agent].siblings;
        let is_over = |state: &State, branch: usize| matches!(state[branch], 0 | FAILED);
        if !siblings.iter().all(|&branch| is_over(state, branch)) {
            return Ok(());
        }
        let has_failed = siblings.iter().any(|&branch| state[branch] == FAILED);
        for &branch in siblings {
            state[branch] = IDLE;
        }
        if has_failed {
            return self.fail(state, parent);
        }
        let at = usize::try_from(state[parent]).ok();
        let place = at.map(|at| &network.agents[parent].code[at].step);
        if let (Some(at), Some(Step::Join(_, next))) = (at, place) {
            self.reached[parent][at] = true;
            state[parent] = *next as i32;
        }
        self.settle(state, parent)
    }

    fn fail(&mut self, state: &mut State, agent: usize) -> Result<(), Broken> {
        if self.network.agents[agent].parent.is_none() {
            state[agent] = END as i32;
            return Ok(());
        }
        state[agent] = FAILED;
        self.ended(state, agent)
    }

    pub(crate) fn has_ended(&self, state: &State, process: usize) -> bool {
        state[self.network.processes[process].agent] == ENDED
    }

    /// Lets a process end, wherever it is.
    pub(crate) fn end(&self, state: &mut State, process: usize) {
        state[self.network.processes[process].agent] = ENDED;
    }

    /// Whether a process is at its end, and still has its ends.
    pub(super) fn is_ending(&self, state: &State, agent: usize) -> bool {
        state[agent] == END as i32 && self.network.agents[agent].parent.is_none()
    }

    /// Whether a branch beside it, or beside an agent around it, has failed.
    pub(super) fn is_called_off(&self, state: &State, agent: usize) -> bool {
        let found = &self.network.agents[agent];
        found.siblings.iter().any(|&branch| state[branch] == FAILED)
            || found
                .parent
                .is_some_and(|parent| self.is_called_off(state, parent))
    }

    pub(super) fn is_closed(
        &self,
        state: &State,
        channel: &Channel,
        side: Side,
        length: i32,
    ) -> bool {
        (side == Side::Send || length == 0)
            && channel
                .partners(side)
                .iter()
                .all(|&process| self.has_ended(state, process))
    }

    /// How many values a channel holds.
    pub(crate) fn length(&self, state: &State, channel: usize) -> i32 {
        match self.network.channels[channel].kind {
            Buffering::Rendezvous => 0,
            _ => state[self.contents[channel]],
        }
    }

    /// The edge that a move takes; that to an end is none.
    pub(crate) fn edge(&self, state: &State, step: Move) -> Option<&'a Edge> {
        let is_edge = !step.is_end;
        is_edge.then(|| &self.edges(state, step.agent)[step.edge])
    }

    pub(crate) fn edges(&self, state: &State, agent: usize) -> &'a [Edge] {
        let Ok(at) = usize::try_from(state[agent]) else {
            return &[];
        };
        self.network.agents[agent].code[at].step.edges()
    }

    pub(crate) fn is_open(&self, state: &State, edge: &Edge) -> bool {
        let condition = edge.condition.as_ref();
        condition.is_none_or(|found| self.value(state, found).is_ok_and(|value| value != 0))
    }

    /// The state after a move; with what broke, the state is where that was seen.
    pub(crate) fn after(&mut self, state: &State, step: Move) -> (State, Option<Broken>) {
        let mut next = state.clone();
        let broken = self.take(&mut next, step).err();
        (next, broken)
    }

    /// The value that a move carries.
    pub(crate) fn carried(&self, state: &State, step: Move) -> Option<i32> {
        if step.is_closed || step.is_end {
            return None;
        }
        let edge = &self.edges(state, step.agent)[step.edge];
        match &edge.label {
            Label::Send(_, Some(value)) => self.value(state, value).ok(),
            Label::Receive(channel, _) if self.network.channels[*channel].values.is_some() => {
                Some(state[self.contents[*channel] + 1])
            }
            Label::Send(_, None) | Label::Receive(..) => None,
            Label::Choice | Label::Skip | Label::After | Label::Own(_) => None,
        }
    }

    fn take(&mut self, state: &mut State, step: Move) -> Result<(), Broken> {
        if step.is_end {
            state[step.agent] = ENDED;
            return Ok(());
        }
        if step.is_closed {
            return self.fail(state, step.agent);
        }
        let network = self.network;
        let edge = &self.edges(state, step.agent)[step.edge];
        let value = self.carried(state, step);
        state[step.agent] = edge.next as i32;
        let mut variable = None;
        match &edge.label {
            Label::Send(channel, _) => match step.partner {
                None => self.put(state, *channel, value.unwrap_or(0)),
                Some((other, at)) => {
                    let edge = &self.edges(state, other)[at];
                    state[other] = edge.next as i32;
                    if let Label::Receive(_, Some(slot)) = edge.label {
                        variable = Some((slot, other, edge.line));
                    }
                }
            },
            Label::Receive(channel, slot) => {
                self.get(state, *channel);
                variable = slot.map(|slot| (slot, step.agent, edge.line));
            }
            Label::Choice | Label::Skip | Label::After | Label::Own(_) => {}
        }
        if let (Some((slot, agent, line)), Some(value)) = (variable, value) {
            let checked = self.in_range(slot, value);
            checked.map_err(|what| Broken { agent, line, what })?;
            state[network.agents.len() + slot] = value;
        }
        self.settle(state, step.agent)?;
        match step.partner {
            Some((other, _)) => self.settle(state, other),
            None => Ok(()),
        }
    }

    /// Whether all processes have come to their ends.
    pub(crate) fn is_over(&self, state: &State) -> bool {
        (0..self.network.processes.len()).all(|process| self.has_ended(state, process))
    }

    /// An agent that computes for ever.
    pub(crate) fn spinning(&self, state: &State) -> Option<usize> {
        (0..self.network.agents.len()).find(|&agent| state[agent] == SPINS)
    }
}
