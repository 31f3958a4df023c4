//! The operational semantics of sequential processes: prefix, external choice, guards.

use super::syntax::{Expr, Field};
use super::value::{Bound, Event, Events, Value, World};
use std::collections::HashMap;
use std::rc::Rc;

/// A process, and the values of the names in it.
#[derive(Debug, Clone)]
struct Process<'a> {
    expr: &'a Expr,
    bound: Bound<'a>,
}

/// Events and the states after them.
pub(super) type Steps = Rc<Vec<(usize, usize)>>;

/// Events have numbers.
#[derive(Debug, Default)]
pub(super) struct Numbers {
    numbers: HashMap<Event, usize>,
    pub(super) events: Vec<Event>,
}

impl Numbers {
    fn of(&mut self, event: Event) -> usize {
        let next = self.events.len();
        *self.numbers.entry(event).or_insert_with_key(|event| {
            self.events.push(event.clone());
            next
        })
    }
}

/// One of the processes of the parallel composition, with the states that were seen.
#[derive(Debug)]
pub(super) struct Component<'a> {
    pub(super) alphabet: Events,
    states: Vec<Process<'a>>,
    /// A state is known by where its expression lies, and by its values.
    known: HashMap<(*const Expr, Vec<Value>), usize>,
    steps: Vec<Option<Steps>>,
}

impl<'a> Component<'a> {
    pub(super) fn new(
        world: &World<'a>,
        alphabet: Events,
        expr: &'a Expr,
        bound: Bound<'a>,
    ) -> Self {
        let mut component = Self {
            alphabet,
            states: Vec::new(),
            known: HashMap::new(),
            steps: Vec::new(),
        };
        component.state(world, expr, bound);
        component
    }

    /// The number of a state: calls and conditions are taken away.
    fn state(&mut self, world: &World<'a>, expr: &'a Expr, bound: Bound<'a>) -> usize {
        let mut process = Process { expr, bound };
        for unfolded in 0.. {
            assert!(
                unfolded < 1000,
                "recursion without an event: {:?}",
                process.expr
            );
            match process.expr {
                Expr::If(condition, then, otherwise) => {
                    let is_true = world.is_true(condition, &process.bound);
                    process.expr = if is_true { then } else { otherwise };
                }
                Expr::Name(name) if name != "STOP" => {
                    let (expr, bound) = world.call(name, Vec::new());
                    process = Process { expr, bound };
                }
                Expr::Call(name, arguments) => {
                    let value = |one| world.value(one, &process.bound);
                    let (expr, bound) = world.call(name, arguments.iter().map(value).collect());
                    process = Process { expr, bound };
                }
                _ => break,
            }
        }
        let key = (
            &raw const *process.expr,
            process.bound.values().cloned().collect(),
        );
        let next = self.states.len();
        let number = *self.known.entry(key).or_insert(next);
        if number == next {
            self.states.push(process);
            self.steps.push(None);
        }
        number
    }

    pub(super) fn steps(
        &mut self,
        world: &World<'a>,
        numbers: &mut Numbers,
        state: usize,
    ) -> Steps {
        if let Some(steps) = &self.steps[state] {
            return Rc::clone(steps);
        }
        let mut found = Vec::new();
        let Process { expr, bound } = self.states[state].clone();
        offers(world, expr, &bound, &mut found);
        let mut steps = Vec::new();
        for (event, expr, bound) in found {
            assert!(
                self.alphabet.contains(&event),
                "{event:?} is not in the alphabet"
            );
            steps.push((numbers.of(event), self.state(world, expr, bound)));
        }
        steps.sort_unstable();
        steps.dedup();
        let steps = Rc::new(steps);
        self.steps[state] = Some(Rc::clone(&steps));
        steps
    }
}

type Offer<'a> = (Event, &'a Expr, Bound<'a>);

fn offers<'a>(world: &World<'a>, expr: &'a Expr, bound: &Bound<'a>, found: &mut Vec<Offer<'a>>) {
    match expr {
        Expr::Name(name) if name == "STOP" => {}
        Expr::Binary("[]", left, right) => {
            offers(world, left, bound, found);
            offers(world, right, bound, found);
        }
        Expr::Binary("&", condition, process) => {
            if world.is_true(condition, bound) {
                offers(world, process, bound, found);
            }
        }
        Expr::Prefix(event, fields, next) => {
            let (channel, begin) = world.event(event, bound);
            let types = &world.channels[channel.as_str()];
            let mut open = vec![(begin, bound.clone())];
            for field in fields {
                let mut longer = Vec::new();
                for (values, bound) in open {
                    match field {
                        Field::Out(value) => {
                            let mut values = values;
                            values.push(world.value(value, &bound));
                            longer.push((values, bound));
                        }
                        Field::In(name, set) => {
                            let set = match set {
                                Some(set) => world.set(set, &bound),
                                None => types[values.len()].clone(),
                            };
                            for value in set {
                                let (mut values, mut bound) = (values.clone(), bound.clone());
                                values.push(value.clone());
                                if name != "_" {
                                    bound.insert(name, value);
                                }
                                longer.push((values, bound));
                            }
                        }
                    }
                }
                open = longer;
            }
            for (values, bound) in open {
                assert_eq!(values.len(), types.len(), "{channel}");
                let are_in = values
                    .iter()
                    .zip(types)
                    .all(|(value, of)| of.contains(value));
                assert!(are_in, "{channel} has no event {values:?}");
                found.push(((channel.clone(), values), next, bound));
            }
        }
        other => panic!("{other:?} is no process of this subset"),
    }
}
