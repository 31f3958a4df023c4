//! Values of CSPm, and expressions that have one.

use super::syntax::{Definition, Expr, Script};
use std::collections::{BTreeMap, BTreeSet};

#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Value {
    Number(i64),
    Bool(bool),
    /// Of a data type.
    Constructor(String),
    Sequence(Vec<Value>),
    Set(BTreeSet<Value>),
}

/// A channel and its fields.
pub(super) type Event = (String, Vec<Value>);

/// The values of names that are bound.
pub(super) type Bound<'a> = BTreeMap<&'a str, Value>;

/// Events: those that begin like one of these, or those that do not.
#[derive(Debug)]
pub(super) struct Events {
    pub(super) begins: Vec<Event>,
    pub(super) is_inverse: bool,
}

impl Events {
    pub(super) fn contains(&self, event: &Event) -> bool {
        let begins = |begin: &Event| event.0 == begin.0 && event.1.starts_with(&begin.1);
        self.begins.iter().any(begins) != self.is_inverse
    }
}

/// The definitions of a script.
#[derive(Debug)]
pub(super) struct World<'a> {
    pub(super) constructors: BTreeMap<&'a str, &'a [String]>,
    pub(super) definitions: BTreeMap<&'a str, Vec<&'a Definition>>,
    /// For each channel the values of its fields.
    pub(super) channels: BTreeMap<&'a str, Vec<BTreeSet<Value>>>,
}

impl<'a> World<'a> {
    pub(super) fn new(script: &'a Script) -> Self {
        let mut world = Self {
            constructors: BTreeMap::new(),
            definitions: BTreeMap::new(),
            channels: BTreeMap::new(),
        };
        for (name, constructors) in &script.datatypes {
            world.constructors.insert(name, constructors);
        }
        for definition in &script.definitions {
            world
                .definitions
                .entry(&definition.name)
                .or_default()
                .push(definition);
        }
        for (name, fields) in &script.channels {
            let fields = fields
                .iter()
                .map(|field| world.set(field, &Bound::new()))
                .collect();
            world.channels.insert(name, fields);
        }
        world
    }

    fn is_constructor(&self, name: &str) -> bool {
        self.constructors
            .values()
            .any(|of| of.iter().any(|one| one == name))
    }

    /// The clause that takes these arguments, and what it binds.
    pub(super) fn call(&self, name: &str, arguments: Vec<Value>) -> (&'a Expr, Bound<'a>) {
        let clauses = self
            .definitions
            .get(name)
            .unwrap_or_else(|| panic!("{name}"));
        for clause in clauses {
            let mut bound = Bound::new();
            let fits = clause
                .parameters
                .iter()
                .zip(&arguments)
                .all(|(parameter, value)| {
                    if self.is_constructor(parameter) {
                        return *value == Value::Constructor(parameter.clone());
                    }
                    bound.insert(parameter, value.clone());
                    true
                });
            if fits {
                return (&clause.body, bound);
            }
        }
        panic!("no clause of {name} takes {arguments:?}")
    }

    pub(super) fn number(&self, expr: &'a Expr, bound: &Bound<'a>) -> i64 {
        match self.value(expr, bound) {
            Value::Number(number) => number,
            other => panic!("{other:?} is no number"),
        }
    }

    pub(super) fn is_true(&self, expr: &'a Expr, bound: &Bound<'a>) -> bool {
        match self.value(expr, bound) {
            Value::Bool(is_true) => is_true,
            other => panic!("{other:?} is no condition"),
        }
    }

    pub(super) fn set(&self, expr: &'a Expr, bound: &Bound<'a>) -> BTreeSet<Value> {
        match self.value(expr, bound) {
            Value::Set(set) => set,
            other => panic!("{other:?} is no set"),
        }
    }

    fn sequence(&self, expr: &'a Expr, bound: &Bound<'a>) -> Vec<Value> {
        match self.value(expr, bound) {
            Value::Sequence(sequence) => sequence,
            other => panic!("{other:?} is no sequence"),
        }
    }

    pub(super) fn value(&self, expr: &'a Expr, bound: &Bound<'a>) -> Value {
        let all = |exprs: &'a [Expr]| exprs.iter().map(|one| self.value(one, bound));
        match expr {
            Expr::Number(number) => Value::Number(*number),
            Expr::Name(name) => self.name(name, bound),
            Expr::Call(name, arguments) => self.function(name, arguments, bound),
            Expr::Unary("not", of) => Value::Bool(!self.is_true(of, bound)),
            Expr::Unary("-", of) => Value::Number(-self.number(of, bound)),
            Expr::Unary(_, of) => Value::Number(self.sequence(of, bound).len() as i64),
            Expr::If(condition, then, otherwise) => match self.is_true(condition, bound) {
                true => self.value(then, bound),
                false => self.value(otherwise, bound),
            },
            Expr::Set(items) => Value::Set(all(items).collect()),
            Expr::Sequence(items) => Value::Sequence(all(items).collect()),
            Expr::Range(low, high) => {
                let numbers = self.number(low, bound)..=self.number(high, bound);
                Value::Set(numbers.map(Value::Number).collect())
            }
            Expr::Binary(sign, left, right) => self.binary(sign, left, right, bound),
            other => panic!("{other:?} has no value"),
        }
    }

    fn name(&self, name: &str, bound: &Bound<'a>) -> Value {
        if let Some(value) = bound.get(name) {
            return value.clone();
        }
        let constructor = |name: &String| Value::Constructor(name.clone());
        match (name, self.constructors.get(name)) {
            ("true" | "false", _) => Value::Bool(name == "true"),
            (_, Some(of)) => Value::Set(of.iter().map(constructor).collect()),
            _ => {
                assert!(self.is_constructor(name), "{name} has no value");
                Value::Constructor(name.to_owned())
            }
        }
    }

    fn function(&self, name: &str, arguments: &'a [Expr], bound: &Bound<'a>) -> Value {
        let sequence = |at: usize| self.sequence(&arguments[at], bound);
        let set = |at: usize| self.set(&arguments[at], bound);
        match name {
            "head" => sequence(0).first().expect("the head of something").clone(),
            "tail" => {
                let mut rest = sequence(0);
                rest.remove(0);
                Value::Sequence(rest)
            }
            "empty" => Value::Bool(set(0).is_empty()),
            "diff" => Value::Set(&set(0) - &set(1)),
            _ => {
                let arguments = arguments.iter().map(|one| self.value(one, bound));
                let (body, bound) = self.call(name, arguments.collect());
                self.value(body, &bound)
            }
        }
    }

    /// Both sides of `and` and `or` are evaluated, so that nothing rests on the right one being
    /// left out. Division is refused where CSPm's tools might round in different ways.
    fn binary(&self, sign: &str, left: &'a Expr, right: &'a Expr, bound: &Bound<'a>) -> Value {
        let (a, b) = (self.value(left, bound), self.value(right, bound));
        match (sign, a, b) {
            ("==", a, b) => Value::Bool(a == b),
            ("!=", a, b) => Value::Bool(a != b),
            ("and", Value::Bool(a), Value::Bool(b)) => Value::Bool(a && b),
            ("or", Value::Bool(a), Value::Bool(b)) => Value::Bool(a || b),
            ("^", Value::Sequence(a), Value::Sequence(b)) => Value::Sequence([a, b].concat()),
            (_, Value::Number(a), Value::Number(b)) => {
                let number = match sign {
                    "<" => return Value::Bool(a < b),
                    "<=" => return Value::Bool(a <= b),
                    ">" => return Value::Bool(a > b),
                    ">=" => return Value::Bool(a >= b),
                    "+" => a + b,
                    "-" => a - b,
                    "*" => a * b,
                    "/" | "%" => {
                        assert!(a >= 0 && b > 0, "{a} {sign} {b}");
                        if sign == "/" { a / b } else { a % b }
                    }
                    _ => panic!("{sign}"),
                };
                let is_small = i32::try_from(number).is_ok();
                assert!(is_small, "{a} {sign} {b} has more than 32 bits");
                Value::Number(number)
            }
            (sign, a, b) => panic!("{a:?} {sign} {b:?}"),
        }
    }

    /// The channel of an event, and the fields that stand there.
    pub(super) fn event(&self, expr: &'a Expr, bound: &Bound<'a>) -> Event {
        match expr {
            Expr::Name(name) => (name.clone(), Vec::new()),
            Expr::Dot(parts) => {
                let (name, _) = self.event(&parts[0], bound);
                (
                    name,
                    parts[1..]
                        .iter()
                        .map(|one| self.value(one, bound))
                        .collect(),
                )
            }
            other => panic!("{other:?} is no event"),
        }
    }

    /// A set of events.
    pub(super) fn events(&self, expr: &'a Expr, bound: &Bound<'a>) -> Events {
        match expr {
            Expr::Productions(events) => Events {
                begins: events
                    .iter()
                    .map(|event| self.event(event, bound))
                    .collect(),
                is_inverse: false,
            },
            Expr::Call(name, arguments) if name == "diff" => {
                assert!(matches!(&arguments[0], Expr::Name(name) if name == "Events"));
                let without = self.events(&arguments[1], bound);
                Events {
                    is_inverse: !without.is_inverse,
                    ..without
                }
            }
            Expr::Comprehension(event, generators, condition) => {
                let mut all = vec![bound.clone()];
                for (name, set) in generators {
                    let with = |bound: &Bound<'a>| {
                        let values = self.set(set, bound).into_iter();
                        let one = |value| {
                            let mut bound = bound.clone();
                            bound.insert(name, value);
                            bound
                        };
                        values.map(one).collect::<Vec<_>>()
                    };
                    all = all.iter().flat_map(with).collect();
                }
                let chosen = all.iter().filter(|bound| self.is_true(condition, bound));
                Events {
                    begins: chosen.map(|bound| self.event(event, bound)).collect(),
                    is_inverse: false,
                }
            }
            Expr::Name(name) => self.events(self.call(name, Vec::new()).0, &Bound::new()),
            Expr::Call(name, arguments) => {
                let arguments = arguments.iter().map(|one| self.value(one, bound));
                let (body, bound) = self.call(name, arguments.collect());
                self.events(body, &bound)
            }
            other => panic!("{other:?} is no set of events"),
        }
    }
}
