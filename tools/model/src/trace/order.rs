//! What a recording says of the order of its communications.
//!
//! Two communications of one thread have the order in which the thread recorded them. Two of
//! different threads have that of their times if these are further apart than the skew, else either
//! order. All orders that this leaves open are covered, but only those are looked at that may make
//! a difference: two communications without a common channel or process can be exchanged in any
//! run of a model.

use super::automaton::{Automaton, Symbol};
use super::{Communication, Party};
use rustc_hash::FxHashMap;
use std::collections::BTreeMap;

/// So many communications of other threads are compared with one; if there are more, it counts as
/// depending on them.
const MAX_COMPARED: usize = 256;

/// How many communications of each thread have been seen.
pub(super) type Cut = Box<[u32]>;

#[derive(Debug)]
pub(super) struct Order {
    /// For each thread its communications, by their places in the recording.
    threads: Vec<Vec<usize>>,
    /// By their places in the recording.
    seen: Vec<Seen>,
    /// What there is, each once.
    symbols: Vec<(Symbol, Touched)>,
    skew: u64,
}

#[derive(Debug)]
struct Seen {
    time: u64,
    symbol: u32,
}

/// The groups of processes that may take part.
#[derive(Debug)]
struct Touched(Vec<usize>);

impl Order {
    pub(super) fn new(events: &[Communication], skew: u64, automaton: &Automaton<'_>) -> Self {
        let mut threads: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        let mut last: BTreeMap<u32, u64> = BTreeMap::new();
        let mut numbers: FxHashMap<Symbol, u32> = FxHashMap::default();
        let mut symbols = Vec::new();
        let mut seen = Vec::with_capacity(events.len());
        for (place, event) in events.iter().enumerate() {
            threads.entry(event.thread).or_default().push(place);
            // The time of a thread does not go back.
            let last = last.entry(event.thread).or_default();
            *last = event.time.max(*last);
            let symbol = event.symbol();
            let number = *numbers.entry(symbol).or_insert_with(|| {
                let touched = automaton.touched(symbol).into_iter().collect();
                symbols.push((symbol, Touched(touched)));
                symbols.len() as u32 - 1
            });
            seen.push(Seen {
                time: *last,
                symbol: number,
            });
        }
        Self {
            threads: threads.into_values().collect(),
            seen,
            symbols,
            skew,
        }
    }

    pub(super) fn first(&self) -> Cut {
        vec![0; self.threads.len()].into_boxed_slice()
    }

    pub(super) fn symbol(&self, event: usize) -> Symbol {
        self.symbols[self.seen[event].symbol as usize].0
    }

    /// The communications that are to be tried next, the earliest first, each with its thread. If
    /// there is a run in which the rest of the recording happens, there is one that begins with one
    /// of these.
    pub(super) fn next(&self, cut: &Cut, into: &mut Vec<(usize, usize)>) {
        into.clear();
        let heads = self.threads.iter().zip(cut).enumerate();
        into.extend(heads.filter_map(|(thread, (list, &at))| {
            let event = *list.get(at as usize)?;
            Some((thread, event))
        }));
        into.sort_by_key(|&(_, event)| self.seen[event].time);
        let Some(&(_, earliest)) = into.first() else {
            return;
        };
        let limit = self.seen[earliest].time.saturating_add(self.skew);
        into.retain(|&(_, event)| self.seen[event].time <= limit);
        let alone = into
            .iter()
            .position(|&(thread, event)| self.is_independent(cut, thread, event));
        if let Some(alone) = alone {
            into.swap(0, alone);
            into.truncate(1);
        }
    }

    /// The last communications before a cut, in the order of their times.
    pub(super) fn before(&self, cut: &Cut, most: usize) -> Vec<usize> {
        let threads = self.threads.iter().zip(cut);
        let mut last: Vec<usize> = threads
            .flat_map(|(list, &at)| {
                let at = at as usize;
                list[at.saturating_sub(most)..at].iter().copied()
            })
            .collect();
        last.sort_by_key(|&event| (self.seen[event].time, event));
        last.split_off(last.len().saturating_sub(most))
    }

    /// Whether it can be exchanged with each one of other threads that may have come before.
    fn is_independent(&self, cut: &Cut, thread: usize, event: usize) -> bool {
        let limit = self.seen[event].time.saturating_add(self.skew);
        let mut compared = 0;
        for (other, (list, &at)) in self.threads.iter().zip(cut).enumerate() {
            if other == thread {
                continue;
            }
            for &rival in &list[at as usize..] {
                if self.seen[rival].time > limit {
                    break;
                }
                compared += 1;
                if compared > MAX_COMPARED || self.depend(event, rival) {
                    return false;
                }
            }
        }
        true
    }

    fn depend(&self, one: usize, other: usize) -> bool {
        let [one, other] = [one, other].map(|event| {
            let number = self.seen[event].symbol;
            &self.symbols[number as usize]
        });
        let is_stranger = |symbol: &Symbol| {
            symbol.sender == Party::Stranger || symbol.receiver == Party::Stranger
        };
        one.0.channel == other.0.channel
            || one.1.0.iter().any(|group| other.1.0.contains(group))
            || is_stranger(&one.0)
            || is_stranger(&other.0)
    }
}
