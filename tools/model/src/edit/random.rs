//! Random edits: the text is always that of the things that ought to be there.

use super::{Channel, Draft, Edit, Kind, Thing, Value, View};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::fmt::Write;

const START: &str = "\
# The head.
name = \"random\"

# The first process.
[process.P0]
ports = { a = \"send\", b = \"receive\" } # its ports
body = \"\"\"
loop { a!; b? } # for ever
\"\"\"

# All channels.
[system.channel]
c0 = { buffer = \"fifo 1\" } # the first

# All parts.
[system.part.p0]
process = \"P0\" # what it is
bind = { a = \"c0\", b = \"c0\" }

# The end.
[check]
max_states = 1000 # few
";

/// These belong to nothing that is removed.
const COMMENTS: [&str; 4] = ["# The head.", "# All channels.", "# The end.", "# few"];

/// What ought to be there.
#[derive(Debug, Clone, Default)]
struct Meant {
    /// Their bodies.
    processes: BTreeMap<String, String>,
    /// Their buffers.
    channels: BTreeMap<String, Option<String>>,
    parts: BTreeMap<String, Part>,
}

#[derive(Debug, Clone, Default, PartialEq)]
struct Part {
    process: String,
    bind: BTreeMap<String, String>,
    keys: BTreeMap<String, String>,
    at: Option<[i64; 2]>,
}

#[derive(Debug, Clone)]
enum Step {
    Process(u8),
    Channel(u8),
    Part(u8, u8),
    Remove(Kind, u8),
    Rename(Kind, u8, u8),
    Bind(u8, bool, Option<u8>),
    Key(u8, u8, Option<u8>),
    Buffer(u8, Option<u8>),
    Body(u8, u8),
    Move(u8, i16, i16),
    Undo,
    Redo,
}

fn kind() -> impl Strategy<Value = Kind> {
    prop_oneof![Just(Kind::Process), Just(Kind::Channel), Just(Kind::Part)]
}

fn step() -> impl Strategy<Value = Step> {
    let few = || 0..5_u8;
    prop_oneof![
        few().prop_map(Step::Process),
        few().prop_map(Step::Channel),
        (few(), few()).prop_map(|(a, b)| Step::Part(a, b)),
        (kind(), few()).prop_map(|(a, b)| Step::Remove(a, b)),
        (kind(), few(), few()).prop_map(|(a, b, c)| Step::Rename(a, b, c)),
        (few(), any::<bool>(), prop::option::weighted(0.8, few()))
            .prop_map(|(a, b, c)| Step::Bind(a, b, c)),
        (few(), 0..4_u8, prop::option::of(1..9_u8)).prop_map(|(a, b, c)| Step::Key(a, b, c)),
        (few(), prop::option::of(1..9_u8)).prop_map(|(a, b)| Step::Buffer(a, b)),
        (few(), 0..9_u8).prop_map(|(a, b)| Step::Body(a, b)),
        (few(), any::<i16>(), any::<i16>()).prop_map(|(a, b, c)| Step::Move(a, b, c)),
        Just(Step::Undo),
        Just(Step::Redo),
    ]
}

fn thing(kind: Kind, number: u8) -> Thing {
    let letter = match kind {
        Kind::Process => 'P',
        Kind::Channel => 'c',
        Kind::Part => 'p',
    };
    Thing {
        kind,
        within: None,
        name: format!("{letter}{number}"),
    }
}

fn text(text: impl Into<String>) -> Value {
    Value::Text(text.into())
}

fn body(number: u8) -> String {
    match number {
        0..5 => format!("loop {{ a!; b?; act{number} }}"),
        _ => format!("loop {{\n  a!;\n  b?;\n  act{number}\n}}\n"),
    }
}

/// The edit of a step, and what is meant afterwards; nothing if it ought to be refused.
fn edit(step: &Step, meant: &Meant) -> (Edit, Option<Meant>) {
    let mut next = meant.clone();
    let set = |kind, number, key: &str, value| Edit::Set {
        thing: thing(kind, number),
        key: key.to_owned(),
        value,
    };
    let add = |kind, number, keys: &[(&str, Value)]| {
        let keys = keys
            .iter()
            .map(|(key, value)| ((*key).to_owned(), value.clone()));
        Edit::Add {
            thing: thing(kind, number),
            keys: keys.collect(),
        }
    };
    let part = |number| thing(Kind::Part, number).name;
    let (edit, is_done) = match *step {
        Step::Process(n) => {
            let keys = [
                ("ports.a", text("send")),
                ("ports.b", text("receive")),
                ("body", text(body(n))),
            ];
            let new = next.processes.insert(thing(Kind::Process, n).name, body(n));
            (add(Kind::Process, n, &keys), new.is_none())
        }
        Step::Channel(n) => {
            let new = next.channels.insert(thing(Kind::Channel, n).name, None);
            (add(Kind::Channel, n, &[]), new.is_none())
        }
        Step::Part(n, process) => {
            let process = thing(Kind::Process, process).name;
            let new = Part {
                process: process.clone(),
                ..Part::default()
            };
            let new = next.parts.insert(part(n), new);
            (
                add(Kind::Part, n, &[("process", text(process))]),
                new.is_none(),
            )
        }
        Step::Remove(kind, n) => {
            let thing = thing(kind, n);
            let is_there = match kind {
                Kind::Process => next.processes.remove(&thing.name).is_some(),
                Kind::Part => next.parts.remove(&thing.name).is_some(),
                Kind::Channel => {
                    for part in next.parts.values_mut() {
                        part.bind.retain(|_, channel| *channel != thing.name);
                    }
                    next.channels.remove(&thing.name).is_some()
                }
            };
            (Edit::Remove { thing }, is_there)
        }
        Step::Rename(kind, from, to) => {
            let (thing, to) = (thing(kind, from), thing(kind, to).name);
            let is_done = next.rename(kind, &thing.name, &to);
            (Edit::Rename { thing, to }, is_done)
        }
        Step::Bind(n, is_a, channel) => {
            let port = if is_a { "a" } else { "b" };
            let channel = channel.map(|channel| thing(Kind::Channel, channel).name);
            let found = next.parts.get_mut(&part(n)).map(|part| {
                match channel.clone() {
                    Some(channel) => part.bind.insert(port.to_owned(), channel),
                    None => part.bind.remove(port),
                };
            });
            let value = channel.map(text);
            let key = format!("bind.{port}");
            (set(Kind::Part, n, &key, value), found.is_some())
        }
        Step::Key(n, key, number) => {
            let key = ["period", "cost", "deadline", "priority"][usize::from(key)];
            let value = number.map(|number| match key {
                "priority" => Value::Number(number.into()),
                _ => text(format!("{number} ms")),
            });
            let found = next.parts.get_mut(&part(n)).map(|part| {
                match number {
                    Some(number) if key == "priority" => {
                        part.keys.insert(key.to_owned(), number.to_string())
                    }
                    Some(number) => part.keys.insert(key.to_owned(), format!("{number} ms")),
                    None => part.keys.remove(key),
                };
            });
            (set(Kind::Part, n, key, value), found.is_some())
        }
        Step::Buffer(n, size) => {
            let buffer = size.map(|size| format!("fifo {size}"));
            let channel = next.channels.get_mut(&thing(Kind::Channel, n).name);
            let found = channel.map(|known| known.clone_from(&buffer));
            let value = buffer.map(text);
            (set(Kind::Channel, n, "buffer", value), found.is_some())
        }
        Step::Body(n, number) => {
            let known = next.processes.get_mut(&thing(Kind::Process, n).name);
            let found = known.map(|known| *known = body(number));
            let value = Some(text(body(number)));
            (set(Kind::Process, n, "body", value), found.is_some())
        }
        Step::Move(n, x, y) => {
            let at = [x.into(), y.into()];
            let found = next.parts.get_mut(&part(n)).map(|part| part.at = Some(at));
            let value = Some(Value::Place(at));
            (set(Kind::Part, n, "at", value), found.is_some())
        }
        Step::Undo | Step::Redo => unreachable!("these are no edits"),
    };
    (edit, is_done.then_some(next))
}

impl Meant {
    fn of(view: &View) -> Self {
        let key = |channel: &Channel, name: &str| {
            let found = channel.keys.iter().find(|(key, _)| key == name);
            found.map(|(_, value)| value.clone())
        };
        let system = &view.scopes[0];
        let parts = system.parts.iter().map(|part| {
            let [x, y, ..] = part.area;
            let meant = Part {
                process: part.process.clone(),
                bind: part.bind.iter().cloned().collect(),
                keys: part.run.iter().cloned().collect(),
                at: part.is_placed.then_some([x as i64, y as i64]),
            };
            (part.name.clone(), meant)
        });
        let processes = view.processes.iter();
        let bodies = processes.map(|one| (one.name.clone(), one.body.clone().unwrap_or_default()));
        let channels = system.channels.iter();
        Self {
            processes: bodies.collect(),
            channels: channels
                .map(|one| (one.name.clone(), key(one, "buffer")))
                .collect(),
            parts: parts.collect(),
        }
    }

    fn rename(&mut self, kind: Kind, from: &str, to: &str) -> bool {
        fn moved<T>(names: &mut BTreeMap<String, T>, from: &str, to: &str) -> bool {
            if from != to && names.contains_key(to) {
                return false;
            }
            let found = names.remove(from);
            found
                .map(|found| names.insert(to.to_owned(), found))
                .is_some()
        }
        let is_done = match kind {
            Kind::Process => moved(&mut self.processes, from, to),
            Kind::Channel => moved(&mut self.channels, from, to),
            Kind::Part => moved(&mut self.parts, from, to),
        };
        for part in self.parts.values_mut() {
            match kind {
                Kind::Process if part.process == from => part.process = to.to_owned(),
                Kind::Channel => {
                    let bound = part.bind.values_mut();
                    bound
                        .filter(|name| *name == from)
                        .for_each(|name| *name = to.to_owned());
                }
                _ => {}
            }
        }
        is_done
    }

    /// The file as a program would write it.
    fn text(&self) -> String {
        let mut text = String::from("name = \"random\"\ncheck.max_states = 1000\n");
        for (name, body) in &self.processes {
            let _ = write!(
                text,
                "[process.{name}]\nports = {{ a = \"send\", b = \"receive\" }}\nbody = {body:?}\n"
            );
        }
        text.push_str("[system.channel]\n");
        for (name, buffer) in &self.channels {
            let buffer = buffer.iter().map(|buffer| format!("buffer = {buffer:?}"));
            let _ = writeln!(text, "{name} = {{ {} }}", buffer.collect::<String>());
        }
        for (name, part) in &self.parts {
            let _ = writeln!(text, "[system.part.{name}]\nprocess = {:?}", part.process);
            for (key, value) in &part.keys {
                let _ = match key.as_str() {
                    "priority" => writeln!(text, "{key} = {value}"),
                    _ => writeln!(text, "{key} = {value:?}"),
                };
            }
            for (port, channel) in &part.bind {
                let _ = writeln!(text, "bind.{port} = {channel:?}");
            }
            if let Some(at) = part.at {
                let _ = writeln!(text, "at = {at:?}");
            }
        }
        text
    }
}

/// A model's processes and channels in the order of their names, with how they are run and drawn.
fn described(draft: &Draft) -> Option<Vec<String>> {
    let model = draft.model().ok()?;
    let network = &model.network;
    let name = |&process: &usize| network.processes[process].name.clone();
    let channels = network.channels.iter().map(|one| {
        let mut ends =
            [&one.senders, &one.receivers].map(|ends| ends.iter().map(name).collect::<Vec<_>>());
        ends.iter_mut().for_each(|ends| ends.sort());
        format!("{} {:?} {ends:?}", one.name, one.kind)
    });
    let processes = network.processes.iter().map(|one| {
        let run = (one.priority, one.period, one.cost, one.deadline);
        format!("{} {} {:?} {run:?}", one.name, one.definition, one.at)
    });
    let mut lines: Vec<String> = channels.chain(processes).collect();
    lines.sort();
    Some(lines)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(if std::env::var_os("LUNA_LONG").is_some() { 4000 } else { 60 }))]

    #[test]
    fn the_text_is_always_what_was_meant(steps in prop::collection::vec(step(), 1..40)) {
        let mut draft = Draft::new("random.toml", START).unwrap();
        let first = Meant::of(&draft.view());
        let (mut meant, mut undone) = (vec![first], Vec::new());
        for step in &steps {
            let now = meant.last().unwrap();
            match step {
                Step::Undo => {
                    prop_assert_eq!(draft.undo(), meant.len() > 1);
                    if meant.len() > 1 {
                        undone.extend(meant.pop());
                    }
                }
                Step::Redo => {
                    prop_assert_eq!(draft.redo(), !undone.is_empty());
                    meant.extend(undone.pop());
                }
                _ => {
                    let (edit, next) = edit(step, now);
                    let before = draft.text().to_owned();
                    let done = draft.apply(&[edit]);
                    prop_assert_eq!(done.is_ok(), next.is_some(), "{:?}: {:?}", step, done);
                    if let Some(next) = next.filter(|_| draft.text() != before) {
                        meant.push(next);
                        undone.clear();
                    }
                }
            }
            let now = meant.last().unwrap();
            let found = Meant::of(&draft.view());
            prop_assert_eq!(&found.processes, &now.processes, "{}", draft.text());
            prop_assert_eq!(&found.channels, &now.channels, "{}", draft.text());
            prop_assert_eq!(&found.parts, &now.parts, "{}", draft.text());
            for comment in COMMENTS {
                prop_assert!(draft.text().contains(comment), "{}: {}", comment, draft.text());
            }
            let direct = Draft::new("direct.toml", &now.text()).unwrap();
            prop_assert_eq!(described(&draft), described(&direct), "{}", draft.text());
        }
    }
}
