//! Every name that a script uses is defined once, and called with the right number of arguments.

use super::syntax::{Assertion, Expr, Field, Script};
use std::collections::{BTreeMap, BTreeSet};

/// What CSPm has: the name, and how many arguments.
const BUILT_IN: [(&str, usize); 8] = [
    ("STOP", 0),
    ("Events", 0),
    ("true", 0),
    ("false", 0),
    ("head", 1),
    ("tail", 1),
    ("empty", 1),
    ("diff", 2),
];

pub(super) fn check(script: &Script) {
    let mut names = Names {
        arity: BUILT_IN
            .map(|(name, arity)| (name.to_owned(), arity))
            .into(),
        channels: BTreeMap::new(),
        constructors: BTreeSet::new(),
    };
    for (name, constructors) in &script.datatypes {
        names.define(name, 0);
        for constructor in constructors {
            names.define(constructor, 0);
            names.constructors.insert(constructor.clone());
        }
    }
    for (name, fields) in &script.channels {
        names.define(name, 0);
        names.channels.insert(name.clone(), fields.len());
    }
    let mut before: Option<&str> = None;
    for definition in &script.definitions {
        let parameters = &definition.parameters;
        // Several clauses stand next to each other, and are told apart by constructors.
        let is_clause = parameters
            .iter()
            .any(|name| names.constructors.contains(name));
        if !(is_clause && before == Some(&definition.name)) {
            names.define(&definition.name, parameters.len());
        }
        before = Some(&definition.name);
        let distinct: BTreeSet<&String> = parameters.iter().collect();
        assert_eq!(distinct.len(), parameters.len(), "{}", definition.name);
    }
    for (name, fields) in &script.channels {
        fields.iter().for_each(|field| names.expr(field, &[], name));
    }
    for definition in &script.definitions {
        let bound: Vec<&str> = definition.parameters.iter().map(String::as_str).collect();
        for name in &bound {
            let is_free = !names.arity.contains_key(*name) || names.constructors.contains(*name);
            assert!(
                is_free,
                "{}: the parameter {name} means more",
                definition.name
            );
        }
        names.expr(&definition.body, &bound, &definition.name);
    }
    for assertion in &script.assertions {
        let both = match assertion {
            Assertion::DeadlockFree(one) | Assertion::DivergenceFree(one) => vec![one],
            Assertion::Traces(one, other) => vec![one, other],
        };
        both.into_iter()
            .for_each(|one| names.expr(one, &[], "assert"));
    }
}

struct Names {
    arity: BTreeMap<String, usize>,
    channels: BTreeMap<String, usize>,
    constructors: BTreeSet<String>,
}

impl Names {
    fn define(&mut self, name: &str, arity: usize) {
        let before = self.arity.insert(name.to_owned(), arity);
        assert_eq!(before, None, "{name} is defined twice");
    }

    fn used(&self, name: &str, arity: usize, bound: &[&str], at: &str) {
        if arity == 0 && bound.contains(&name) {
            return;
        }
        assert_eq!(self.arity.get(name), Some(&arity), "{at} uses {name}");
    }

    fn expr(&self, expr: &Expr, bound: &[&str], at: &str) {
        let all = |exprs: &[Expr]| exprs.iter().for_each(|one| self.expr(one, bound, at));
        match expr {
            Expr::Number(_) => {}
            Expr::Name(name) => self.used(name, 0, bound, at),
            Expr::Call(name, arguments) => {
                self.used(name, arguments.len(), bound, at);
                all(arguments);
            }
            Expr::Unary(_, of) => self.expr(of, bound, at),
            Expr::Binary(_, one, other) | Expr::Range(one, other) => {
                self.expr(one, bound, at);
                self.expr(other, bound, at);
            }
            Expr::If(condition, then, otherwise) => {
                for one in [condition, then, otherwise] {
                    self.expr(one, bound, at);
                }
            }
            Expr::Interface(left, events, right) => {
                for one in [left, events, right] {
                    self.expr(one, bound, at);
                }
            }
            Expr::Comprehension(event, generators, condition) => {
                let mut bound = bound.to_vec();
                for (name, set) in generators {
                    self.expr(set, &bound, at);
                    let is_free = !self.arity.contains_key(name) && !bound.contains(&&**name);
                    assert!(is_free, "{at}: {name} means more");
                    bound.push(name);
                }
                let (name, _) = head(event);
                let fields = self.event(event, at);
                assert_eq!(self.channels.get(name), Some(&fields), "{at}: {name}");
                self.expr(event, &bound, at);
                self.expr(condition, &bound, at);
            }
            Expr::Set(items) | Expr::Sequence(items) | Expr::Dot(items) => all(items),
            Expr::Productions(events) => {
                events.iter().for_each(|event| {
                    self.event(event, at);
                });
                all(events);
            }
            Expr::Prefix(event, fields, next) => {
                let count = self.event(event, at) + fields.len();
                let (name, _) = head(event);
                assert_eq!(self.channels.get(name), Some(&count), "{at}: {name}");
                self.expr(event, bound, at);
                let mut bound = bound.to_vec();
                for field in fields {
                    match field {
                        Field::Out(value) => self.expr(value, &bound, at),
                        Field::In(name, set) => {
                            set.iter().for_each(|set| self.expr(set, &bound, at));
                            if name == "_" {
                                continue;
                            }
                            let is_free = !self.arity.contains_key(name);
                            assert!(is_free, "{at}: ?{name} is a pattern of something else");
                            bound.push(name);
                        }
                    }
                }
                self.expr(next, &bound, at);
            }
            Expr::Parallel {
                name,
                set,
                alphabet,
                process,
            } => {
                self.expr(set, bound, at);
                let mut bound = bound.to_vec();
                bound.push(name);
                self.expr(alphabet, &bound, at);
                self.expr(process, &bound, at);
            }
        }
    }

    /// How many fields stand behind a channel.
    fn event(&self, event: &Expr, at: &str) -> usize {
        let (name, fields) = head(event);
        let declared = self.channels.get(name);
        assert!(declared.is_some_and(|most| fields <= *most), "{at}: {name}");
        fields
    }
}

fn head(event: &Expr) -> (&str, usize) {
    match event {
        Expr::Name(name) => (name, 0),
        Expr::Dot(parts) => match &parts[0] {
            Expr::Name(name) => (name, parts.len() - 1),
            other => panic!("{other:?} is no channel"),
        },
        other => panic!("{other:?} is no event"),
    }
}
