//! The states of an exported model: alphabetised parallel, hiding, and the assertions of the file.

use super::component::{Component, Numbers};
use super::syntax::{Assertion, Expr, Script};
use super::value::{Bound, Event, Events, World};
use std::collections::HashMap;

/// Whether the assertions of a file hold.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Verdict {
    pub(super) is_deadlock_free: bool,
    pub(super) is_divergence_free: bool,
    /// No trace but the empty one.
    pub(super) is_unbroken: bool,
    /// For each property that was exported, whether it holds always.
    pub(super) always: Vec<bool>,
}

/// All states, or nothing if there are more than so many.
pub(super) fn verdict(script: &Script, most: usize) -> Option<Verdict> {
    let world = World::new(script);
    let mut verdict = Verdict::default();
    let (components, blocked) = system(&world);
    let observed = Graph::explore(&world, components, most)?;
    let graph = observed.without(&blocked);
    for assertion in &script.assertions {
        match assertion {
            Assertion::DeadlockFree(of) => {
                assert!(matches!(of, Expr::Name(name) if name == "System"));
                verdict.is_deadlock_free = graph.moves.iter().all(|moves| !moves.is_empty());
            }
            Assertion::DivergenceFree(of) => {
                let is_hidden = hidden(&world, of);
                verdict.is_divergence_free = !graph.has_cycle(&is_hidden);
            }
            Assertion::Traces(stop, of) => {
                assert!(matches!(stop, Expr::Name(name) if name == "STOP"));
                let is_hidden = hidden(&world, of);
                let never = |graph: &Graph| {
                    let mut moves = graph.moves.iter().flatten();
                    moves.all(|&(event, _)| is_hidden(&graph.events[event]))
                };
                match is_of(of, "Observed") {
                    true => verdict.always.push(never(&observed)),
                    false => verdict.is_unbroken = never(&graph),
                }
            }
        }
    }
    assert_eq!(script.assertions.len(), 3 + verdict.always.len());
    Some(verdict)
}

/// Whether a trace of a small system has an event of the one channel, and later one of the other.
pub(super) fn comes_after(script: &Script, first: &str, then: &str) -> bool {
    let world = World::new(script);
    let (components, _) = system(&world);
    let graph = Graph::explore(&world, components, 10_000).expect("a small system");
    let is_on = |event: usize, channel: &str| graph.events[event].0 == channel;
    let moves = graph.moves.iter().flatten();
    let firsts = moves.filter(|(event, _)| is_on(*event, first));
    let mut open: Vec<usize> = firsts.map(|(_, to)| *to).collect();
    let mut seen = vec![false; graph.moves.len()];
    while let Some(state) = open.pop() {
        if std::mem::replace(&mut seen[state], true) {
            continue;
        }
        let moves = &graph.moves[state];
        if moves.iter().any(|(event, _)| is_on(*event, then)) {
            return true;
        }
        open.extend(moves.iter().map(|(_, to)| *to));
    }
    false
}

/// Whether it is `NAME \ events`.
fn is_of(of: &Expr, name: &str) -> bool {
    let Expr::Binary("\\", hides, _) = of else {
        return false;
    };
    matches!(&**hides, Expr::Name(found) if found == name)
}

/// Which events are hidden in `System \ events`, or in `Observed \ events`.
fn hidden<'a>(world: &World<'a>, of: &'a Expr) -> impl Fn(&Event) -> bool + use<'a> {
    let Expr::Binary("\\", _, events) = of else {
        panic!("{of:?} hides nothing");
    };
    assert!(is_of(of, "System") || is_of(of, "Observed"));
    let events = world.events(events, &Bound::new());
    move |event| events.contains(event)
}

/// The components of the definition `System`, and the events that it blocks.
fn system<'a>(world: &World<'a>) -> (Vec<Component<'a>>, Events) {
    let (mut body, _) = world.call("System", Vec::new());
    let mut blocked = Events {
        begins: Vec::new(),
        is_inverse: false,
    };
    if let Expr::Interface(observed, events, stop) = body {
        assert!(matches!(&**stop, Expr::Name(name) if name == "STOP"));
        let Expr::Name(observed) = &**observed else {
            panic!("{observed:?} is no name");
        };
        blocked = world.events(events, &Bound::new());
        (body, _) = world.call(observed, Vec::new());
    }
    let Expr::Parallel {
        name,
        set,
        alphabet,
        process,
    } = body
    else {
        panic!("{body:?} is no replicated parallel");
    };
    let set = world.set(set, &Bound::new());
    let one = |value| {
        let bound = Bound::from([(name.as_str(), value)]);
        let alphabet = world.events(alphabet, &bound);
        Component::new(world, alphabet, process, bound)
    };
    (set.into_iter().map(one).collect(), blocked)
}

struct Graph {
    /// For each state the events and the states after them.
    moves: Vec<Vec<(usize, usize)>>,
    events: Vec<Event>,
}

impl Graph {
    fn explore<'a>(
        world: &World<'a>,
        mut components: Vec<Component<'a>>,
        most: usize,
    ) -> Option<Self> {
        let first = vec![0; components.len()].into_boxed_slice();
        let mut numbers = Numbers::default();
        // For each event, which components take part.
        let mut parties: Vec<Vec<usize>> = Vec::new();
        let mut known = HashMap::from([(first.clone(), 0)]);
        let mut states: Vec<Box<[usize]>> = vec![first];
        let mut moves = Vec::new();
        while moves.len() < states.len() {
            let state = states[moves.len()].clone();
            let steps: Vec<_> = components
                .iter_mut()
                .zip(&state)
                .map(|(component, &at)| component.steps(world, &mut numbers, at))
                .collect();
            for event in &numbers.events[parties.len()..] {
                let takes_part = |number: &usize| components[*number].alphabet.contains(event);
                parties.push((0..components.len()).filter(takes_part).collect());
            }
            let mut found = Vec::new();
            for (number, own) in steps.iter().enumerate() {
                // The first party begins; all others must offer the event too.
                for &(event, to) in own.iter().filter(|(event, _)| parties[*event][0] == number) {
                    let mut open = vec![state.clone()];
                    open[0][number] = to;
                    for &party in &parties[event][1..] {
                        let with = |before: &[usize]| {
                            let its = steps[party].iter().filter(|(offered, _)| *offered == event);
                            let after = |&(_, to): &(usize, usize)| {
                                let mut after: Box<[usize]> = before.into();
                                after[party] = to;
                                after
                            };
                            its.map(after).collect::<Vec<_>>()
                        };
                        open = open.iter().flat_map(|before| with(before)).collect();
                    }
                    found.extend(open.into_iter().map(|after| (event, after)));
                }
            }
            let mut here = Vec::new();
            for (event, after) in found {
                let next = states.len();
                let number = *known.entry(after).or_insert_with_key(|after| {
                    states.push(after.clone());
                    next
                });
                here.push((event, number));
            }
            if states.len() > most {
                return None;
            }
            moves.push(here);
        }
        Some(Self {
            moves,
            events: numbers.events,
        })
    }

    /// The same without some events, none of which leads to another state.
    fn without(&self, blocked: &Events) -> Self {
        let is_blocked: Vec<bool> = self
            .events
            .iter()
            .map(|one| blocked.contains(one))
            .collect();
        let of_one = |(state, moves): (usize, &Vec<(usize, usize)>)| {
            let is_kept = |&&(event, to): &&(usize, usize)| {
                assert!(
                    !is_blocked[event] || to == state,
                    "{:?}",
                    self.events[event]
                );
                !is_blocked[event]
            };
            moves.iter().filter(is_kept).copied().collect()
        };
        Self {
            moves: self.moves.iter().enumerate().map(of_one).collect(),
            events: self.events.clone(),
        }
    }

    /// Whether hidden events can go on for ever: what is left if states without a hidden event to a
    /// state that is left are taken away.
    fn has_cycle(&self, is_hidden: &impl Fn(&Event) -> bool) -> bool {
        let mut before = vec![Vec::new(); self.moves.len()];
        let mut open = vec![0_usize; self.moves.len()];
        for (from, moves) in self.moves.iter().enumerate() {
            for &(event, to) in moves
                .iter()
                .filter(|(event, _)| is_hidden(&self.events[*event]))
            {
                let _ = event;
                before[to].push(from);
                open[from] += 1;
            }
        }
        let mut ends: Vec<usize> = (0..open.len()).filter(|&state| open[state] == 0).collect();
        let mut left = open.len();
        while let Some(end) = ends.pop() {
            left -= 1;
            for &from in &before[end] {
                open[from] -= 1;
                if open[from] == 0 {
                    ends.push(from);
                }
            }
        }
        left > 0
    }
}
