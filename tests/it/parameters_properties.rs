//! Any sets of any values, checked against a map: a set is taken as a whole or not at all, and is
//! refused for each wrong value and for no other.

use crate::common;
use common::{SpawnOk, watchdog};
use luna::parameters::{SetError, Value};
use luna::prelude::*;
use luna::system::ProcessBuilder;
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};

const NAMES: [&str; 6] = ["f", "g", "i", "u", "b", "l"];

/// One parameter of a few types.
struct Few {
    f: Parameter<f64>,
    g: Parameter<f32>,
    i: Parameter<i16>,
    u: Parameter<u64>,
    b: Parameter<bool>,
    l: Parameter<[i8; 2]>,
}

impl Few {
    fn declare(process: &ProcessBuilder) -> luna::Result<Self> {
        Ok(Self {
            f: process.parameter("f", 0.0).range(-5.0..=5.0).register()?,
            g: process.parameter("g", 0.0).register()?,
            i: process.parameter("i", 0).range(-5..=5).register()?,
            u: process.parameter("u", 0).register()?,
            b: process.parameter("b", false).register()?,
            l: process.parameter("l", [0; 2]).range(-5..=5).register()?,
        })
    }

    fn get(&self) -> BTreeMap<&'static str, Value> {
        BTreeMap::from([
            ("f", self.f.get().into()),
            ("g", self.g.get().into()),
            ("i", self.i.get().into()),
            ("u", self.u.get().into()),
            ("b", self.b.get().into()),
            ("l", self.l.get().into()),
        ])
    }
}

/// What a parameter of this name makes of the value, if it can be its.
fn allowed(name: &str, value: &Value) -> Option<Value> {
    let within = |number: i128| (-5..=5).contains(&number);
    match (name, value) {
        ("f", Value::Float(number)) if number.abs() <= 5.0 => Some(value.clone()),
        ("f", Value::Integer(number)) if within(*number) => Some(Value::Float(*number as f64)),
        ("g", Value::Float(number))
            if number.is_finite() && number.abs() <= f64::from(f32::MAX) =>
        {
            Some((*number as f32).into())
        }
        // All whole numbers here are so small that a float has them.
        ("g", Value::Integer(number)) => Some((*number as f32).into()),
        ("i", Value::Integer(number)) if within(*number) => Some(value.clone()),
        ("u", Value::Integer(number)) if *number >= 0 => Some(value.clone()),
        ("b", Value::Bool(_)) => Some(value.clone()),
        ("l", Value::List(list)) if list.len() == 2 => {
            let is_one = |one: &Value| matches!(one, Value::Integer(number) if within(*number));
            list.iter().all(is_one).then(|| value.clone())
        }
        _ => None,
    }
}

fn values() -> impl Strategy<Value = Value> {
    let small = -7_i128..8;
    let number = prop_oneof![
        8 => (-6.0..6.0).prop_map(Value::Float),
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(1e300), Just(-1e39), Just(5.0), Just(-0.0)].prop_map(Value::Float),
        8 => small.prop_map(Value::Integer),
        2 => any::<bool>().prop_map(Value::Bool),
        1 => "[a-z]{0,3}".prop_map(Value::Text),
    ];
    let list = prop::collection::vec(number.clone(), 0..4).prop_map(Value::List);
    prop_oneof![4 => number, 1 => list]
}

/// Sets; in each a name at most once, so that a value is wrong by itself.
fn sets() -> impl Strategy<Value = Vec<BTreeMap<String, Value>>> {
    let names = prop_oneof![12 => prop::sample::select(&NAMES[..]).prop_map(str::to_owned), 1 => Just("x".to_owned())];
    prop::collection::vec(prop::collection::btree_map(names, values(), 1..4), 1..40)
}

struct Tries {
    few: Few,
    parameters: luna::parameters::Parameters,
    sets: Vec<BTreeMap<String, Value>>,
    /// How many were taken.
    taken: Arc<Mutex<u64>>,
}

impl Process for Tries {
    async fn run(&mut self) -> luna::Result<()> {
        let few = &self.few;
        let mut model = few.get();
        let mut taken = 0;
        for set in std::mem::take(&mut self.sets) {
            let wrong: BTreeSet<&String> = set
                .iter()
                .filter(|(name, value)| allowed(name, value).is_none())
                .map(|(name, _)| name)
                .collect();
            let before = model.clone();
            match self.parameters.set(set.clone()) {
                Ok(number) => {
                    assert!(wrong.is_empty(), "taken: {set:?}");
                    taken += 1;
                    assert_eq!(number, taken);
                    for (name, value) in &set {
                        let name = NAMES.iter().find(|one| *one == name).unwrap();
                        model.insert(name, allowed(name, value).unwrap());
                    }
                }
                Err(SetError::Refused(refused)) => {
                    let named: BTreeSet<&String> = refused.iter().map(|one| &one.name).collect();
                    assert_eq!(named, wrong, "{set:?}");
                }
                Err(error) => panic!("{error}"),
            }
            assert_eq!(few.get(), before);
            few.f.latch();
            assert_eq!(few.get(), model);
            let reported = self.parameters.list().into_iter();
            let reported: BTreeMap<String, Value> =
                reported.map(|one| (one.name, one.value)).collect();
            assert!(model.iter().all(|(name, value)| reported[*name] == *value));
        }
        *self.taken.lock().unwrap() = taken;
        Ok(())
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_set_is_taken_as_a_whole_or_not_at_all(sets in sets()) {
        let _watch = watchdog();
        let mut system = System::new("properties");
        system.virtual_clock();
        let main = system.executor("main").build().unwrap();
        let taken = Arc::new(Mutex::new(u64::MAX));
        let process = main.process("tries");
        let tries = Tries {
            few: Few::declare(&process).unwrap(),
            parameters: system.parameters(),
            sets,
            taken: taken.clone(),
        };
        process.spawn_ok(tries);
        system.run().unwrap();
        prop_assert!(*taken.lock().unwrap() < u64::MAX);
    }
}
