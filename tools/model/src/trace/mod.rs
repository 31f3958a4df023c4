//! Whether communications that were recorded are a trace of a model.
//!
//! A model accepts them if one of its runs has them, and no others, in an order that the recording
//! leaves open (`order`). All else in the model is hidden, so after each communication it may be in
//! one of several states; `automaton` follows them all.

mod automaton;
mod ends;
mod order;
#[cfg(test)]
mod tests;

use crate::explore::words::communication;
use crate::network::Network;
use automaton::{Automaton, Symbol, TooMany};
use indexmap::IndexSet;
use order::{Cut, Order};
use rustc_hash::FxBuildHasher;

/// So many orders at once are followed at most.
const MAX_ORDERS: usize = 100_000;
/// So many communications before the one that is no part of a trace are reported.
const BEFORE: usize = 8;
/// After so many communications the progress is reported.
const REPORT_EVERY: usize = 64;

/// A communication that was recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Communication {
    /// The thread that recorded it.
    pub thread: u32,
    /// When, in nanoseconds.
    pub time: u64,
    /// Its place among [`Model::channel_names`](crate::Model::channel_names).
    pub channel: usize,
    /// What sent. None for what was received from a buffer.
    pub sender: Party,
    /// What received. None for what went into a buffer; both are known if the receiver was waiting
    /// there.
    pub receiver: Party,
}

impl Communication {
    fn symbol(&self) -> Symbol {
        Symbol {
            channel: self.channel,
            sender: self.sender,
            receiver: self.receiver,
        }
    }
}

/// What takes part in a communication.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Party {
    /// Its place among [`Model::process_names`](crate::Model::process_names).
    Process(usize),
    /// A process that the model does not have.
    Stranger,
    /// None that is recorded: a buffer, or what is outside of the recorded system.
    None,
}

/// How a recording is compared with a model.
#[derive(Debug, Clone, Default)]
pub struct TraceOptions {
    /// Communications that two threads have recorded at times that differ by at most so many
    /// nanoseconds may have happened in either order.
    pub skew: u64,
    /// Channels of the model, by their places, without recorded communications.
    pub hidden: Vec<usize>,
    /// Processes of the model, by their places, that are not in the recorded system. What they do
    /// is recorded by their partners, or not at all.
    pub unrecorded: Vec<usize>,
    /// Processes of the model, by their places, that ended by themselves: after the last
    /// communication they must be able to.
    pub ended: Vec<usize>,
    /// A limit on the states of the model that are followed. 0: 2 000 000.
    pub max_states: usize,
    /// A limit on the memory for these states (bytes). 0: [half of what is
    /// free](crate::default_memory()).
    pub max_bytes: u64,
}

/// What came of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Traced {
    /// How many communications are a trace, from the first on.
    pub accepted: usize,
    /// Whether these are all.
    pub verdict: TraceVerdict,
}

/// Whether communications are a trace.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TraceVerdict {
    /// All of them are.
    Accepted,
    /// No run of the model has this one after those before it.
    Rejected(Rejected),
    /// All of them are, but these processes cannot have ended after them.
    Unended(Vec<usize>),
    /// No run of the model has any communication: it breaks a rule before the first one.
    Broken,
    /// The limit on states, or on orders that the times leave open, was reached.
    TooLarge,
}

/// The first communication that is no part of a trace.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rejected {
    /// Its place in the recording.
    pub event: usize,
    /// The last place of those one of which had to come next, in any order that the times leave open.
    pub latest: usize,
    /// The places of the last ones before it, the earliest first.
    pub before: Vec<usize>,
    /// What could have happened instead; first what its processes and its channel take part in.
    pub allowed: Vec<String>,
    /// Where its processes may be in the model.
    pub there: Vec<String>,
}

/// Follows the communications.
/// Calls `progress` now and then with the number of those that are a trace so far.
pub(crate) fn trace(
    network: &Network,
    events: &[Communication],
    options: &TraceOptions,
    progress: &mut dyn FnMut(usize),
) -> Traced {
    let flags = |chosen: &[usize], count: usize| {
        (0..count)
            .map(|number| chosen.contains(&number))
            .collect::<Vec<bool>>()
    };
    let max_states = match options.max_states {
        0 => crate::DEFAULT_MAX_STATES,
        limit => limit,
    };
    let max_bytes = match options.max_bytes {
        0 => crate::default_memory(),
        limit => limit,
    };
    let mut automaton = Automaton::new(
        network,
        flags(&options.hidden, network.channels.len()),
        flags(&options.unrecorded, network.processes.len()),
        max_states,
        max_bytes,
    );
    let order = Order::new(events, options.skew, &automaton);
    let followed = follow(
        &mut automaton,
        &order,
        events.len(),
        &options.ended,
        progress,
    );
    let (accepted, verdict) = match followed {
        Ok(found) => found,
        Err(accepted) => (accepted, TraceVerdict::TooLarge),
    };
    Traced { accepted, verdict }
}

/// How many are a trace, and whether these are all; an error if a limit was reached after so many.
fn follow(
    automaton: &mut Automaton<'_>,
    order: &Order,
    count: usize,
    ended: &[usize],
    progress: &mut dyn FnMut(usize),
) -> Result<(usize, TraceVerdict), usize> {
    let Some(first) = automaton.first().map_err(|TooMany| 0_usize)? else {
        return Ok((0, TraceVerdict::Broken));
    };
    let mut now: IndexSet<(Cut, u32), FxBuildHasher> = IndexSet::default();
    now.insert((order.first(), first));
    let mut heads = Vec::new();
    for accepted in 0..count {
        if accepted % REPORT_EVERY == 0 {
            progress(accepted);
        }
        let mut next: IndexSet<(Cut, u32), FxBuildHasher> = IndexSet::default();
        for (cut, set) in &now {
            order.next(cut, &mut heads);
            for &(thread, event) in &heads {
                let step = automaton.step(*set, order.symbol(event));
                if let Some(set) = step.map_err(|TooMany| accepted)? {
                    let mut cut = cut.clone();
                    cut[thread] += 1;
                    next.insert((cut, set));
                }
            }
            if next.len() > MAX_ORDERS {
                return Err(accepted);
            }
        }
        if next.is_empty() {
            let mut rejected = now
                .first()
                .and_then(|(cut, set)| rejected(automaton, order, cut, *set));
            for (cut, _) in &now {
                order.next(cut, &mut heads);
                let latest = heads.iter().map(|&(_, event)| event).max();
                if let (Some(rejected), Some(latest)) = (&mut rejected, latest) {
                    rejected.latest = rejected.latest.max(latest);
                }
            }
            return Ok((
                accepted,
                rejected.map_or(TraceVerdict::Broken, TraceVerdict::Rejected),
            ));
        }
        now = next;
    }
    let alive = automaton.cannot_end(now.iter().map(|(_, set)| *set), ended);
    let alive = alive.map_err(|TooMany| count)?;
    Ok((
        count,
        match alive.is_empty() {
            true => TraceVerdict::Accepted,
            false => TraceVerdict::Unended(alive),
        },
    ))
}

fn rejected(automaton: &mut Automaton<'_>, order: &Order, cut: &Cut, set: u32) -> Option<Rejected> {
    let mut heads = Vec::new();
    order.next(cut, &mut heads);
    let &(_, event) = heads.first()?;
    let symbol = order.symbol(event);
    let mut possible = automaton.possible(set);
    let shares = |one: &Symbol| {
        let both = |one: Party, other: Party| one == other && matches!(one, Party::Process(_));
        one.channel == symbol.channel
            || both(one.sender, symbol.sender)
            || both(one.receiver, symbol.receiver)
            || both(one.sender, symbol.receiver)
            || both(one.receiver, symbol.sender)
    };
    possible.sort_by_key(|one| !shares(one));
    Some(Rejected {
        event,
        latest: event,
        before: order.before(cut, BEFORE),
        allowed: possible.iter().map(|one| automaton.words(one)).collect(),
        there: automaton.places(set, symbol),
    })
}

impl Automaton<'_> {
    fn words(&self, symbol: &Symbol) -> String {
        let network = self.network();
        let name = |party| match party {
            Party::Process(process) => Some(network.processes[process].name.as_str()),
            Party::Stranger | Party::None => None,
        };
        let channel = &network.channels[symbol.channel].name;
        communication(channel, name(symbol.sender), name(symbol.receiver))
    }
}
