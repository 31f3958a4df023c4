//! What an editor shows of a text: its things as they are written.

use super::{Kind, Thing};
use crate::draw::layout;
use serde::Serialize;
use std::collections::BTreeMap;
use toml_edit::{Document, Item, Key, Table, TableLike};

/// The things of a file, in its order.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct View {
    /// The model's name.
    pub name: String,
    /// The processes.
    pub processes: Vec<Definition>,
    /// The system, and then the processes that are made of parts.
    pub scopes: Vec<Scope>,
    /// What parts may run on.
    pub executors: Vec<String>,
}

/// Keys and values.
type Pairs = Vec<(String, String)>;

/// A process.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Definition {
    /// Its name.
    pub name: String,
    /// In the file, from 1.
    pub line: usize,
    /// With `send` or `receive`.
    pub ports: Pairs,
    /// With the numbers that they are unless a part sets them.
    pub parameters: Pairs,
    /// With their values.
    pub variables: Pairs,
    /// None if it is made of parts.
    pub body: Option<String>,
}

/// What parts and channels are in.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scope {
    /// The process; none for the system.
    pub within: Option<String>,
    /// The process' ports.
    pub ports: Pairs,
    /// The parts.
    pub parts: Vec<Part>,
    /// The channels.
    pub channels: Vec<Channel>,
}

/// A part.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Part {
    /// Its name.
    pub name: String,
    /// In the file, from 1.
    pub line: usize,
    /// What it is.
    pub process: String,
    /// How many there are, if it is an array.
    pub array: Option<String>,
    /// Its ports with what they are bound to.
    pub bind: Pairs,
    /// Its parameters.
    pub set: Pairs,
    /// Priority, period and so on, by their keys.
    pub run: Pairs,
    /// Whether the file says where it is.
    pub is_placed: bool,
    /// Its upper left corner and its size, in pixels.
    pub area: [f64; 4],
}

/// A channel.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Channel {
    /// Its name.
    pub name: String,
    /// In the file, from 1.
    pub line: usize,
    /// `array`, `type` and `buffer`, as far as they are there.
    pub keys: Pairs,
}

/// The keys of [`Part::run`].
const RUN: [&str; 6] = [
    "priority",
    "period",
    "on",
    "cost",
    "longest_poll",
    "deadline",
];

impl View {
    pub(super) fn of(text: &str) -> Self {
        let empty = Table::new();
        let document = Document::parse(text).ok();
        let root = document.as_ref().map_or(&empty, |found| found.as_table());
        let text = Text(text);
        let processes: Vec<Definition> = text
            .entries(root.get("process"))
            .map(|(name, line, item)| Definition {
                name,
                line,
                ports: pairs(item.get("ports")),
                parameters: pairs(item.get("parameters")),
                variables: pairs(item.get("variables")),
                body: item.get("body").map(shown),
            })
            .collect();
        let mut scopes = vec![text.scope(None, root.get("system"), &processes)];
        for (name, _, item) in text.entries(root.get("process")) {
            if item.get("body").is_none() {
                let process = root.get("process").and_then(|found| found.get(&name));
                scopes.push(text.scope(Some(name), process, &processes));
            }
        }
        Self {
            name: root.get("name").map(shown).unwrap_or_default(),
            scopes,
            executors: text
                .entries(root.get("executor"))
                .map(|found| found.0)
                .collect(),
            processes,
        }
    }

    /// The thing that began last, up to this line.
    pub(super) fn thing_at(&self, line: usize) -> Option<Thing> {
        let thing = |kind, within: &Option<String>, name: &String, at: usize| {
            let (within, name) = (within.clone(), name.clone());
            (at, Thing { kind, within, name })
        };
        let processes = self.processes.iter();
        let processes = processes.map(|one| thing(Kind::Process, &None, &one.name, one.line));
        let inner = self.scopes.iter().flat_map(|scope| {
            let parts = scope.parts.iter();
            let parts = parts.map(|one| thing(Kind::Part, &scope.within, &one.name, one.line));
            let channels = scope.channels.iter();
            parts
                .chain(channels.map(|one| thing(Kind::Channel, &scope.within, &one.name, one.line)))
        });
        let before = processes.chain(inner).filter(|(at, _)| *at <= line);
        before.max_by_key(|(at, _)| *at).map(|(_, thing)| thing)
    }
}

#[derive(Clone, Copy)]
struct Text<'t>(&'t str);

impl<'t> Text<'t> {
    fn line(self, key: Option<&Key>) -> usize {
        let start = key.and_then(Key::span).map_or(0, |span| span.start);
        self.0
            .get(..start)
            .unwrap_or_default()
            .matches('\n')
            .count()
            + 1
    }

    /// The tables of a table, with their names and lines, in the order of the file.
    fn entries<'d>(
        self,
        item: Option<&'d Item>,
    ) -> impl Iterator<Item = (String, usize, &'d dyn TableLike)> + use<'t, 'd> {
        let table = item.and_then(Item::as_table_like);
        let entries = table.into_iter().flat_map(move |table| {
            table.iter().filter_map(move |(name, item)| {
                let key = table.get_key_value(name).map(|(key, _)| key);
                Some((name.to_owned(), self.line(key), item.as_table_like()?))
            })
        });
        let mut found: Vec<_> = entries.collect();
        found.sort_by_key(|(_, line, _)| *line);
        found.into_iter()
    }

    fn scope(self, within: Option<String>, item: Option<&Item>, known: &[Definition]) -> Scope {
        let inner = |key: &str| item.and_then(|item| item.get(key));
        let parts = self.entries(inner("part")).map(|(name, line, item)| {
            let process = item.get("process").map(shown).unwrap_or_default();
            let array = item.get("array").map(shown);
            let run = RUN.iter().filter_map(|key| {
                let value = item.get(key).map(shown)?;
                Some(((*key).to_owned(), value))
            });
            let at = item.get("at").and_then(place);
            let title = match &array {
                Some(array) => format!("{name}[{array}]"),
                None => name.clone(),
            };
            let (width, height) = layout::size(&title, &process);
            let bind = pairs(item.get("bind"));
            let [x, y] = at.unwrap_or_default();
            Part {
                name,
                line,
                set: pairs(item.get("set")),
                run: run.collect(),
                is_placed: at.is_some(),
                area: [x, y, width, height + 12.0],
                process,
                array,
                bind,
            }
        });
        let mut parts: Vec<Part> = parts.collect();
        lay_out(&mut parts, known);
        let channels = self.entries(inner("channel")).map(|(name, line, item)| {
            let keys = ["array", "type", "buffer"].iter().filter_map(|key| {
                let value = item.get(key).map(shown)?;
                Some(((*key).to_owned(), value))
            });
            let keys = keys.collect();
            Channel { name, line, keys }
        });
        Scope {
            within,
            ports: pairs(inner("ports")),
            channels: channels.collect(),
            parts,
        }
    }
}

/// Places what the file does not place, as drawings do.
fn lay_out(parts: &mut [Part], known: &[Definition]) {
    let (mut senders, mut receivers) = (BTreeMap::new(), BTreeMap::new());
    for (number, part) in parts.iter().enumerate() {
        let definition = known.iter().find(|one| one.name == part.process);
        for (port, to) in &part.bind {
            let mut ports = definition.iter().flat_map(|one| &one.ports);
            let side = ports.find(|(name, _)| name == port);
            let ends = match side.map(|(_, side)| side.as_str()) {
                Some("send") => &mut senders,
                Some("receive") => &mut receivers,
                _ => continue,
            };
            let channel = to.split('[').next().unwrap_or_default().trim().to_owned();
            ends.entry(channel).or_insert_with(Vec::new).push(number);
        }
    }
    let mut arrows = Vec::new();
    for (channel, from) in &senders {
        for to in receivers.get(channel).into_iter().flatten() {
            arrows.extend(from.iter().map(|from| (*from, *to)));
        }
    }
    let sizes = parts.iter().map(|part| (part.area[2], part.area[3]));
    let sizes: Vec<(f64, f64)> = sizes.collect();
    for (part, (x, y)) in parts.iter_mut().zip(layout::corners(&sizes, &arrows)) {
        if !part.is_placed {
            (part.area[0], part.area[1]) = (x.round(), y.round());
        }
    }
}

fn place(item: &Item) -> Option<[f64; 2]> {
    let mut numbers = item.as_array()?.iter().filter_map(|one| one.as_integer());
    let mut next = || numbers.next().map(|number| number as f64);
    Some([next()?, next()?])
}

fn pairs(item: Option<&Item>) -> Pairs {
    let table = item.and_then(Item::as_table_like);
    let entries = table.into_iter().flat_map(|table| table.iter());
    entries
        .map(|(key, item)| (key.to_owned(), shown(item)))
        .collect()
}

/// A text without its quotes, and numbers as they are written.
fn shown(item: &Item) -> String {
    match item.as_str() {
        Some(text) => text.to_owned(),
        None => item.to_string().trim().to_owned(),
    }
}
