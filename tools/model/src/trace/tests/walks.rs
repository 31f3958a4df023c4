//! Random walks through random networks are traces, whatever their threads and times leave open.
//! What is no trace by a plain search through all states is none here.

#[path = "../../../tests/it/random.rs"]
mod random;

use super::{SKEW, options};
use crate::Model;
use crate::explore::state::{Move, Semantics, State};
use crate::network::{Buffering, Label, Network};
use crate::trace::{Communication, Party, TraceOptions, TraceVerdict};
use random::{Random, model};
use std::collections::BTreeSet;

fn seed() -> u64 {
    let chosen = std::env::var("LUNA_SEED").ok();
    let seed = chosen.and_then(|seed| seed.parse().ok()).unwrap_or(1);
    println!("LUNA_SEED={seed}");
    seed
}

/// Small random models, each with the generator that made it.
fn models(count: u64) -> impl Iterator<Item = (u64, Model, Random)> {
    let first = seed();
    (first..first + count).filter_map(|seed| {
        let mut random = Random(seed);
        let read = Model::parse("random.toml", &model(&mut random));
        let read = read.unwrap_or_else(|problem| panic!("{problem}, LUNA_SEED={seed}"));
        read.explore(5000)
            .is_complete
            .then_some((seed, read, random))
    })
}

/// What of a move is recorded.
fn recorded(semantics: &Semantics<'_>, state: &State, step: Move) -> Option<Communication> {
    let process = |agent: usize| Party::Process(semantics.network.agents[agent].process);
    let edge = semantics.edge(state, step).filter(|_| !step.is_closed)?;
    let own = process(step.agent);
    let partner = step
        .partner
        .map_or(Party::None, |(agent, _)| process(agent));
    let (channel, sender, receiver) = match edge.label {
        Label::Send(channel, _) => (channel, own, partner),
        Label::Receive(channel, _) => (channel, Party::None, own),
        _ => return None,
    };
    Some(Communication {
        thread: 0,
        time: 0,
        channel,
        sender,
        receiver,
    })
}

/// The communications of a random run, at times in their order, on one thread.
fn walk(network: &Network, random: &mut Random, most: usize) -> Vec<Communication> {
    walk_with_ends(network, random, most).0
}

/// With the processes that have ended.
fn walk_with_ends(
    network: &Network,
    random: &mut Random,
    most: usize,
) -> (Vec<Communication>, Vec<usize>) {
    let mut semantics = Semantics::new(network);
    let (mut state, broken) = semantics.first();
    let (mut found, mut moves) = (Vec::new(), Vec::new());
    for _ in 0..if broken.is_some() { 0 } else { 4 * most } {
        semantics.moves(&state, &mut moves);
        if moves.is_empty() || found.len() == most {
            break;
        }
        let step = moves[random.below(moves.len())];
        let (next, broken) = semantics.after(&state, step);
        if broken.is_some() {
            break;
        }
        found.extend(recorded(&semantics, &state, step));
        state = next;
    }
    stamp(&mut found);
    let processes = 0..network.processes.len();
    let ended = processes.filter(|&process| semantics.has_ended(&state, process));
    (found, ended.collect())
}

fn stamp(events: &mut [Communication]) {
    for (time, event) in events.iter_mut().enumerate() {
        event.time = 1000 * time as u64;
    }
}

/// The states in which the run may be after one more communication, by a search that leaves nothing
/// out.
fn step(
    semantics: &mut Semantics<'_>,
    from: &BTreeSet<State>,
    event: &Communication,
) -> BTreeSet<State> {
    let mut open: Vec<State> = from.iter().cloned().collect();
    let (mut seen, mut found, mut moves) = (from.clone(), BTreeSet::new(), Vec::new());
    while let Some(state) = open.pop() {
        semantics.moves(&state, &mut moves);
        for &step in &moves {
            let (next, broken) = semantics.after(&state, step);
            if broken.is_some() {
                continue;
            }
            match recorded(semantics, &state, step) {
                None if seen.insert(next.clone()) => open.push(next),
                Some(other) if other.symbol() == event.symbol() => drop(found.insert(next)),
                _ => {}
            }
        }
    }
    found
}

/// How many of the communications are a trace, in this order.
fn prefix<'e>(network: &Network, events: impl Iterator<Item = &'e Communication>) -> usize {
    let mut semantics = Semantics::new(network);
    let (first, _) = semantics.first();
    let mut states = BTreeSet::from([first]);
    for (accepted, event) in events.enumerate() {
        states = step(&mut semantics, &states, event);
        if states.is_empty() {
            return accepted;
        }
    }
    usize::MAX
}

/// Whether a run has them in some order that threads and times leave open.
fn is_trace_in_some_order(network: &Network, events: &[Communication]) -> bool {
    fn search(
        semantics: &mut Semantics<'_>,
        states: &BTreeSet<State>,
        rest: &[Communication],
    ) -> bool {
        let must_precede = |one: usize, other: usize| match rest[one].thread == rest[other].thread {
            true => one < other,
            false => rest[one].time + SKEW < rest[other].time,
        };
        rest.is_empty()
            || (0..rest.len()).any(|event| {
                let is_first = !(0..rest.len()).any(|other| must_precede(other, event));
                let next = match is_first {
                    true => step(semantics, states, &rest[event]),
                    false => BTreeSet::new(),
                };
                let mut rest = rest.to_vec();
                rest.remove(event);
                !next.is_empty() && search(semantics, &next, &rest)
            })
    }
    let mut semantics = Semantics::new(network);
    let (first, _) = semantics.first();
    search(&mut semantics, &BTreeSet::from([first]), events)
}

/// As if up to three threads had recorded them, each by a clock of its own. Comes in the order of
/// the times, as in a file.
fn on_threads(
    network: &Network,
    random: &mut Random,
    events: &[Communication],
) -> Vec<Communication> {
    let threads: Vec<u32> = (0..network.processes.len())
        .map(|_| random.below(3) as u32)
        .collect();
    let (mut time, mut last, mut found) = (0, [0; 3], Vec::new());
    for event in events {
        time += random.below(SKEW as usize) as u64;
        let parties = [event.sender, event.receiver];
        let ends: Vec<usize> = parties
            .into_iter()
            .filter_map(|party| match party {
                Party::Process(process) => Some(process),
                _ => None,
            })
            .collect();
        let thread = threads[ends[random.below(ends.len())]];
        let last = &mut last[thread as usize];
        *last = (time + random.below(SKEW as usize / 2) as u64).max(*last);
        found.push(Communication {
            thread,
            time: *last,
            ..*event
        });
    }
    found.sort_by_key(|event| event.time);
    found
}

/// A receiver that waits at a buffer is recorded together with the send.
fn join(network: &Network, random: &mut Random, events: &mut Vec<Communication>) {
    let mut at = 1;
    while at < events.len() {
        let (sent, received) = (events[at - 1], events[at]);
        let is_pair = sent.channel == received.channel
            && network.channels[sent.channel].kind != Buffering::Rendezvous
            && sent.receiver == Party::None
            && received.sender == Party::None;
        if is_pair && random.below(2) == 0 {
            events[at - 1].receiver = received.receiver;
            events.remove(at);
        }
        at += 1;
    }
    stamp(events);
}

/// Now and then a channel is not recorded, or a process is outside of the system.
fn leave_out(
    network: &Network,
    random: &mut Random,
    events: &mut Vec<Communication>,
    options: &mut TraceOptions,
) {
    if random.below(3) == 0 {
        let hidden = random.below(network.channels.len());
        events.retain(|event| event.channel != hidden);
        options.hidden.push(hidden);
    }
    if random.below(3) == 0 {
        let outside = random.below(network.processes.len());
        let is_outside = |party: Party| party == Party::Process(outside);
        events.retain_mut(|event| {
            let channel = &network.channels[event.channel];
            let mut ends = channel.senders.iter().chain(&channel.receivers);
            let is_buffer = channel.kind != Buffering::Rendezvous;
            let takes_part = is_outside(event.sender) || is_outside(event.receiver);
            // Whether its partner recorded it.
            if (takes_part || is_buffer && ends.any(|&end| end == outside)) && random.below(2) == 0
            {
                return false;
            }
            for party in [&mut event.sender, &mut event.receiver] {
                if is_outside(*party) {
                    *party = Party::None;
                }
            }
            event.sender != Party::None || event.receiver != Party::None
        });
        options.unrecorded.push(outside);
        options.ended.retain(|&process| process != outside);
    }
}

#[test]
fn random_walks_are_traces_whatever_their_threads_leave_open() {
    let (mut longest, mut ends) = (0, 0);
    for (seed, model, mut random) in models(300) {
        let (mut events, ended) = walk_with_ends(&model.network, &mut random, 60);
        ends += ended.len();
        if events.is_empty() {
            continue;
        }
        longest = longest.max(events.len());
        join(&model.network, &mut random, &mut events);
        let mut events = on_threads(&model.network, &mut random, &events);
        let mut options = TraceOptions { ended, ..options() };
        leave_out(&model.network, &mut random, &mut events, &mut options);
        let traced = model.trace(&events, &options);
        assert_eq!(
            (traced.accepted, &traced.verdict),
            (events.len(), &TraceVerdict::Accepted),
            "LUNA_SEED={seed} {options:?} {events:#?}"
        );
    }
    assert!(longest == 60 && ends > 50, "{longest} {ends}");
}

/// One dropped, one twice, or two exchanged.
fn spoil(random: &mut Random, events: &mut Vec<Communication>) {
    let at = random.below(events.len() - 1);
    match random.below(3) {
        0 => drop(events.remove(at)),
        1 => events.insert(at, events[at]),
        _ => events.swap(at, at + 1),
    }
    stamp(events);
}

#[test]
fn what_is_rejected_is_what_a_plain_search_rejects() {
    let (mut accepted, mut rejected) = (0, 0);
    for (seed, model, mut random) in models(400) {
        let mut events = walk(&model.network, &mut random, 20);
        if events.len() < 2 {
            continue;
        }
        spoil(&mut random, &mut events);
        let traced = model.trace(&events, &options());
        let expected = prefix(&model.network, events.iter());
        match &traced.verdict {
            TraceVerdict::Accepted => {
                accepted += 1;
                assert_eq!(expected, usize::MAX, "LUNA_SEED={seed} {events:#?}");
            }
            TraceVerdict::Rejected(found) => {
                rejected += 1;
                let place = (traced.accepted, found.event);
                assert_eq!(place, (expected, expected), "LUNA_SEED={seed} {events:#?}");
            }
            other => panic!("{other:?}, LUNA_SEED={seed}"),
        }
    }
    assert!(accepted > 20 && rejected > 20, "{accepted} {rejected}");
}

#[test]
fn all_orders_that_are_open_are_covered_and_no_others() {
    let (mut accepted, mut rejected) = (0, 0);
    for (seed, model, mut random) in models(600) {
        let mut events = walk(&model.network, &mut random, 6);
        if events.len() < 2 {
            continue;
        }
        spoil(&mut random, &mut events);
        let events = on_threads(&model.network, &mut random, &events);
        let traced = model.trace(&events, &options());
        let is_trace = is_trace_in_some_order(&model.network, &events);
        *if is_trace {
            &mut accepted
        } else {
            &mut rejected
        } += 1;
        assert_eq!(
            traced.verdict == TraceVerdict::Accepted,
            is_trace,
            "LUNA_SEED={seed} {events:#?}"
        );
    }
    assert!(accepted > 20 && rejected > 20, "{accepted} {rejected}");
}
