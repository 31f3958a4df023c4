//! The states that a model may be in after the communications that were seen: as a deterministic
//! automaton, which is built where the recording leads.
//!
//! Between two communications a process may take hidden moves: actions, choices, `skip`, `after`,
//! and communications that are not recorded. Before a communication, only those of its two
//! processes are taken. Those of the others can as well be taken later, since moves of different
//! processes do not depend on each other. That a process ends, or finds a channel closed, lets no
//! communication happen that could not happen without, so these moves are left out.

use super::Party;
use crate::explore::state::{Move, Semantics, State};
use crate::explore::store::Store;
use crate::explore::words;
use crate::memory::Reserved;
use crate::network::{Buffering, Channel, Label, Network};
use indexmap::IndexSet;
use rustc_hash::{FxBuildHasher, FxHashMap};
use std::collections::BTreeSet;

/// A communication, as the automaton knows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Symbol {
    pub(super) channel: usize,
    pub(super) sender: Party,
    pub(super) receiver: Party,
}

/// There are more states than the limit allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TooMany;

/// States, by their numbers, in ascending order.
type Set = Box<[u32]>;

/// All sets together may hold so many times the limit on states.
const MAX_SHARE: usize = 16;

#[derive(Debug)]
pub(super) struct Automaton<'a> {
    pub(super) semantics: Semantics<'a>,
    /// Channels without recorded communications.
    hidden: Vec<bool>,
    /// Processes that the recording does not know: what they do may be recorded by their partners,
    /// or not at all.
    unrecorded: Vec<bool>,
    /// Processes that hidden communications connect have the same number.
    pub(super) groups: Vec<usize>,
    states: Store,
    sets: IndexSet<Set, FxBuildHasher>,
    /// How many numbers of states the sets hold.
    members: usize,
    known: FxHashMap<(u32, Symbol), Option<u32>>,
    pub(super) max_states: usize,
    max_bytes: u64,
    _reserved: Reserved,
}

impl<'a> Automaton<'a> {
    pub(super) fn new(
        network: &'a Network,
        hidden: Vec<bool>,
        unrecorded: Vec<bool>,
        max_states: usize,
        max_bytes: u64,
    ) -> Self {
        let groups = groups(network, &hidden, &unrecorded);
        let semantics = Semantics::new(network);
        Self {
            states: Store::new(semantics.values()),
            semantics,
            hidden,
            unrecorded,
            groups,
            sets: IndexSet::default(),
            members: 0,
            known: FxHashMap::default(),
            max_states: max_states.min(u32::MAX as usize),
            max_bytes,
            _reserved: Reserved::new(max_bytes),
        }
    }

    /// The set with the first state; none if the model breaks an assertion there.
    pub(super) fn first(&mut self) -> Result<Option<u32>, TooMany> {
        match self.semantics.first() {
            (state, None) => {
                let state = self.state(&state)?;
                self.set(vec![state]).map(Some)
            }
            (_, Some(_)) => Ok(None),
        }
    }

    /// The set after a communication; none if it cannot happen.
    pub(super) fn step(&mut self, set: u32, symbol: Symbol) -> Result<Option<u32>, TooMany> {
        if let Some(&known) = self.known.get(&(set, symbol)) {
            return Ok(known);
        }
        let from = self.sets[set as usize].to_vec();
        let next = self.happened(from, symbol, &mut |_| ())?;
        let next = match next.is_empty() {
            true => None,
            false => Some(self.set(next)?),
        };
        self.known.insert((set, symbol), next);
        Ok(next)
    }

    /// The processes between which a communication may be; it depends on what they do before.
    pub(super) fn touched(&self, symbol: Symbol) -> BTreeSet<usize> {
        let channel = &self.network().channels[symbol.channel];
        let mut groups = BTreeSet::new();
        for (party, processes) in [
            (symbol.sender, &channel.senders),
            (symbol.receiver, &channel.receivers),
        ] {
            let may = processes.iter().filter(|&&one| self.is(party, one));
            groups.extend(may.map(|&process| self.groups[process]));
        }
        groups
    }

    /// Where these processes are in the states of a set, and which rules the model breaks if the
    /// communication is tried.
    pub(super) fn places(&mut self, set: u32, symbol: Symbol) -> Vec<String> {
        let mut lines = BTreeSet::new();
        let network = self.network();
        for &state in &self.sets[set as usize] {
            let state = self.states.get(state);
            for (number, agent) in network.agents.iter().enumerate() {
                let process = agent.process;
                if self.is(symbol.sender, process) || self.is(symbol.receiver, process) {
                    lines.extend(words::place(&self.semantics, &state, number));
                }
            }
        }
        let from = self.sets[set as usize].to_vec();
        let mut breaks = |line| lines.extend([line]);
        // Only the broken rules are wanted: these are all known if the limit is reached.
        let _ = self.happened(from, symbol, &mut breaks);
        lines.into_iter().collect()
    }

    /// All communications that can happen in a state of the set.
    pub(super) fn possible(&mut self, set: u32) -> Vec<Symbol> {
        let mut found = Vec::new();
        let network = self.network();
        for (number, channel) in network.channels.iter().enumerate() {
            for (sender, receiver) in ends(channel) {
                let symbol = Symbol {
                    channel: number,
                    sender,
                    receiver,
                };
                if !self.hidden[number] && matches!(self.step(set, symbol), Ok(Some(_))) {
                    found.push(symbol);
                }
            }
        }
        found
    }

    pub(super) fn network(&self) -> &'a Network {
        self.semantics.network
    }

    /// Whether a process may be what was recorded. What is not recorded is outside of the recorded
    /// system.
    fn is(&self, party: Party, process: usize) -> bool {
        match party {
            Party::Process(recorded) => recorded == process,
            Party::None => self.unrecorded[process],
            Party::Stranger => false,
        }
    }

    /// The states of a set.
    pub(super) fn members(&self, set: u32) -> Vec<State> {
        let members = self.sets[set as usize].iter();
        members.map(|&state| self.states.get(state)).collect()
    }

    pub(super) fn process(&self, agent: usize) -> usize {
        self.network().agents[agent].process
    }

    /// The states after a communication.
    fn happened(
        &mut self,
        from: Vec<u32>,
        symbol: Symbol,
        breaks: &mut dyn FnMut(String),
    ) -> Result<Vec<u32>, TooMany> {
        match self.network().channels[symbol.channel].kind {
            Buffering::Rendezvous => self.meet(&from, symbol, breaks),
            _ => self.buffered(from, symbol, breaks),
        }
    }

    /// The states after a rendezvous.
    fn meet(
        &mut self,
        from: &[u32],
        symbol: Symbol,
        breaks: &mut dyn FnMut(String),
    ) -> Result<Vec<u32>, TooMany> {
        let touched = self.touched(symbol);
        self.after(from, &touched, breaks, |this, state, step| {
            let edge = this.semantics.edge(state, step);
            let (Some(edge), Some((partner, _))) = (edge, step.partner) else {
                return false;
            };
            matches!(edge.label, Label::Send(channel, _) if channel == symbol.channel)
                && this.is(symbol.sender, this.process(step.agent))
                && this.is(symbol.receiver, this.process(partner))
        })
    }

    /// The states after what is known of a communication of a buffer.
    fn buffered(
        &mut self,
        from: Vec<u32>,
        symbol: Symbol,
        breaks: &mut dyn FnMut(String),
    ) -> Result<Vec<u32>, TooMany> {
        let mut at = from;
        for party in [(symbol.sender, true), (symbol.receiver, false)] {
            if party.0 != Party::None {
                at = self.use_buffer(&at, symbol.channel, party, breaks)?;
            }
        }
        Ok(at)
    }

    /// The states after a send into a buffer, or a receive from it.
    fn use_buffer(
        &mut self,
        from: &[u32],
        channel: usize,
        (party, is_send): (Party, bool),
        breaks: &mut dyn FnMut(String),
    ) -> Result<Vec<u32>, TooMany> {
        let (sender, receiver) = match is_send {
            true => (party, Party::Stranger),
            false => (Party::Stranger, party),
        };
        let touched = self.touched(Symbol {
            channel,
            sender,
            receiver,
        });
        self.after(from, &touched, breaks, |this, state, step| {
            let edge = this.semantics.edge(state, step);
            let does = edge.is_some_and(|edge| match edge.label {
                Label::Send(found, _) => is_send && found == channel,
                Label::Receive(found, _) => !is_send && found == channel,
                _ => false,
            });
            does && step.partner.is_none() && this.is(party, this.process(step.agent))
        })
    }

    /// The states after a move of this kind, with hidden moves of these groups before it.
    fn after(
        &mut self,
        from: &[u32],
        touched: &BTreeSet<usize>,
        breaks: &mut dyn FnMut(String),
        is_meant: impl Fn(&Self, &State, Move) -> bool,
    ) -> Result<Vec<u32>, TooMany> {
        let mut seen: IndexSet<u32, FxBuildHasher> = from.iter().copied().collect();
        let mut found = BTreeSet::new();
        let mut moves = Vec::new();
        let mut at = 0;
        while let Some(&number) = seen.get_index(at) {
            let state = self.states.unfold(number);
            self.semantics.moves(&state, &mut moves);
            for &step in &moves {
                if step.is_closed || step.is_end {
                    continue;
                }
                let is_meant = is_meant(self, &state, step);
                let is_hidden = touched.contains(&self.groups[self.process(step.agent)])
                    && self.is_hidden(&state, step);
                if !is_meant && !is_hidden {
                    continue;
                }
                let (next, broken) = self.semantics.after(&state, step);
                if let Some(broken) = broken {
                    breaks(words::broken(self.network(), &broken));
                    continue;
                }
                let next = self.state(&next)?;
                if is_meant {
                    found.insert(next);
                }
                if is_hidden {
                    seen.insert(next);
                }
            }
            at += 1;
        }
        Ok(found.into_iter().collect())
    }

    /// Whether a recording may be without it.
    pub(super) fn is_hidden(&self, state: &State, step: Move) -> bool {
        let Some(edge) = self.semantics.edge(state, step) else {
            return false;
        };
        let Some((channel, _)) = edge.label.end() else {
            return true;
        };
        if self.hidden[channel] {
            return true;
        }
        match step.partner {
            Some((partner, _)) => [step.agent, partner]
                .iter()
                .any(|&agent| self.unrecorded[self.process(agent)]),
            // What is outside may have received from a waiting sender, or sent to a waiting receiver.
            None => {
                let channel = &self.network().channels[channel];
                let mut ends = channel.senders.iter().chain(&channel.receivers);
                ends.any(|&process| self.unrecorded[process])
            }
        }
    }

    fn state(&mut self, state: &State) -> Result<u32, TooMany> {
        let has_room = self.states.len() < self.max_states
            && self.states.has_numbers()
            && self.bytes() <= self.max_bytes;
        let added = self.states.add(state, has_room);
        added.map(|(number, _)| number).ok_or(TooMany)
    }

    /// What is kept, also while it grows.
    fn bytes(&self) -> u64 {
        /// Of a set without its members, and of a known step, with the places of their tables.
        const EACH_SET: u64 = 100;
        const EACH_STEP: u64 = 120;
        let members = self.members as u64 * size_of::<u32>() as u64;
        let sets = self.sets.len() as u64 * EACH_SET + self.known.len() as u64 * EACH_STEP;
        self.states.bytes() + members + sets
    }

    /// The number of a set with these members, which are in ascending order.
    fn set(&mut self, members: Vec<u32>) -> Result<u32, TooMany> {
        let size = members.len();
        let (number, is_new) = self.sets.insert_full(members.into_boxed_slice());
        if is_new {
            self.members += size;
        }
        let is_full = self.members > self.max_states.saturating_mul(MAX_SHARE);
        match is_full || self.bytes() > self.max_bytes {
            true => Err(TooMany),
            false => u32::try_from(number).map_err(|_| TooMany),
        }
    }
}

/// What can be recorded of a channel.
fn ends(channel: &Channel) -> Vec<(Party, Party)> {
    let all = |processes: &[usize]| {
        let processes = processes.iter().copied().map(Party::Process);
        processes.collect::<Vec<Party>>()
    };
    let (senders, receivers) = (all(&channel.senders), all(&channel.receivers));
    match channel.kind {
        Buffering::Rendezvous => senders
            .iter()
            .flat_map(|&sender| receivers.iter().map(move |&receiver| (sender, receiver)))
            .collect(),
        _ => {
            let sent = senders.into_iter().map(|sender| (sender, Party::None));
            let received = receivers.into_iter().map(|one| (Party::None, one));
            sent.chain(received).collect()
        }
    }
}

/// For each process the least process that hidden communications connect it with.
fn groups(network: &Network, hidden: &[bool], unrecorded: &[bool]) -> Vec<usize> {
    let mut groups: Vec<usize> = (0..network.processes.len()).collect();
    for (number, channel) in network.channels.iter().enumerate() {
        let ends = || channel.senders.iter().chain(&channel.receivers).copied();
        if !hidden[number] && !ends().any(|process| unrecorded[process]) {
            continue;
        }
        let joined: BTreeSet<usize> = ends().map(|process| groups[process]).collect();
        let Some(&least) = joined.first() else {
            continue;
        };
        for group in &mut groups {
            if joined.contains(group) {
                *group = least;
            }
        }
    }
    groups
}
