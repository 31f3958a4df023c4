//! What each edit does to the text.

use super::{Edit, EditError, Kind, Thing, Value, tree};
use toml_edit::{Array, DocumentMut, InlineTable, Item, Table};

/// The text after some edits. What it is read as was not looked at.
pub(super) fn apply(text: &str, edits: &[Edit]) -> Result<String, EditError> {
    // Ends of lines of another system come back at the end.
    let lines = text.replace("\r\n", "\n");
    // A text that could be read before is TOML.
    let Ok(mut document) = lines.parse::<DocumentMut>() else {
        return Err(EditError::NoPlace("the file".to_owned()));
    };
    for edit in edits {
        one(&mut document, edit)?;
    }
    let changed = document.to_string();
    Ok(match text.contains("\r\n") {
        true => changed.replace('\n', "\r\n"),
        false => changed,
    })
}

impl Thing {
    /// Where things of its kind stand.
    fn parent(&self) -> Vec<&str> {
        let kind = match self.kind {
            Kind::Process => return vec!["process"],
            Kind::Part => "part",
            Kind::Channel => "channel",
        };
        scope(self.within.as_deref(), kind)
    }
}

fn scope<'n>(within: Option<&'n str>, kind: &'n str) -> Vec<&'n str> {
    match within {
        None => vec!["system", kind],
        Some(process) => vec!["process", process, kind],
    }
}

fn one(document: &mut DocumentMut, edit: &Edit) -> Result<(), EditError> {
    match edit {
        Edit::Add { thing, keys } => add(document, thing, keys),
        Edit::Remove { thing } => remove(document, thing),
        Edit::Rename { thing, to } => rename(document, thing, to),
        Edit::Set { thing, key, value } => {
            let found = item(document, thing)?;
            match value {
                Some(value) => set(found, key, value),
                None => {
                    unset(found, key);
                    Ok(())
                }
            }
        }
    }
}

fn item<'d>(document: &'d mut DocumentMut, thing: &Thing) -> Result<&'d mut Item, EditError> {
    let mut path = thing.parent();
    path.push(&thing.name);
    let not_there = || EditError::NotThere(thing.clone());
    tree::at(document.as_item_mut(), &path).ok_or_else(not_there)
}

fn add(
    document: &mut DocumentMut,
    thing: &Thing,
    keys: &[(String, Value)],
) -> Result<(), EditError> {
    if let Some(process) = &thing.within {
        let outer = Thing {
            kind: Kind::Process,
            within: None,
            name: process.clone(),
        };
        item(document, &outer)?;
    }
    let no_place = || EditError::NoPlace(thing.name.clone());
    let parent = tree::made(document.as_item_mut(), &thing.parent()).ok_or_else(no_place)?;
    let others = parent.as_table_like().ok_or_else(no_place)?;
    if others.contains_key(&thing.name) {
        return Err(EditError::Taken(thing.name.clone()));
    }
    // Channels are a line each, unless those of the file are tables.
    let is_line = thing.kind == Kind::Channel && !others.iter().any(|(_, item)| item.is_table());
    let new = match is_line {
        true => Item::Value(InlineTable::new().into()),
        false => Item::Table(Table::new()),
    };
    tree::insert(parent, &thing.name, new);
    let new = tree::at(parent, &[&thing.name]).ok_or_else(no_place)?;
    keys.iter()
        .try_for_each(|(key, value)| set(new, key, value))
}

fn set(item: &mut Item, key: &str, value: &Value) -> Result<(), EditError> {
    let written: toml_edit::Value = match value {
        Value::Number(number) => (*number).into(),
        Value::Text(text) => text.as_str().into(),
        Value::Place(place) => Array::from_iter(*place).into(),
    };
    let is_set = match key.split_once('.') {
        None => tree::set(item, key, written),
        Some((table, key)) => tree::set_within(item, table, key, written),
    };
    match is_set {
        true => Ok(()),
        false => Err(EditError::NoPlace(key.to_owned())),
    }
}

fn unset(item: &mut Item, key: &str) {
    let Some((table, key)) = key.split_once('.') else {
        tree::remove(item, key);
        return;
    };
    let Some(inner) = tree::at(item, &[table]) else {
        return;
    };
    tree::remove(inner, key);
    if inner.as_table_like().is_some_and(|inner| inner.is_empty()) {
        tree::remove(item, table);
    }
}

fn remove(document: &mut DocumentMut, thing: &Thing) -> Result<(), EditError> {
    item(document, thing)?;
    let not_there = || EditError::NotThere(thing.clone());
    let parent = tree::at(document.as_item_mut(), &thing.parent()).ok_or_else(not_there)?;
    let position = tree::position(parent, &thing.name);
    let kept = tree::remove(parent, &thing.name).ok_or_else(not_there)?;
    if let Some(position) = position.filter(|_| !kept.is_empty())
        && let Some(kept) = tree::put_before_next(document.as_table_mut(), position, kept)
    {
        let rest = document.trailing().as_str().unwrap_or_default().to_owned();
        document.set_trailing(kept + &rest);
    }
    if thing.kind == Kind::Channel {
        each_part(document, thing.within.as_deref(), |part| {
            for port in bound_to(part, &thing.name) {
                unset(part, &format!("bind.{port}"));
            }
        });
    }
    Ok(())
}

fn rename(document: &mut DocumentMut, thing: &Thing, to: &str) -> Result<(), EditError> {
    item(document, thing)?;
    let not_there = || EditError::NotThere(thing.clone());
    let parent = tree::at(document.as_item_mut(), &thing.parent()).ok_or_else(not_there)?;
    if thing.name == to {
        return Ok(());
    }
    let others = parent.as_table_like().ok_or_else(not_there)?;
    if others.contains_key(to) {
        return Err(EditError::Taken(to.to_owned()));
    }
    tree::rename(parent, &thing.name, to);
    let from = thing.name.as_str();
    match (thing.kind, thing.within.as_deref()) {
        (Kind::Process, _) => rename_in_parts(document, from, to),
        (Kind::Channel, within) => each_part(document, within, |part| {
            for port in bound_to(part, from) {
                // The index has names of its own, such as `i`.
                change(part, &["bind"], &port, |text| {
                    let index = text.find('[').map_or("", |at| &text[at..]);
                    format!("{to}{index}")
                });
            }
        }),
        (Kind::Part, None) => {
            for table in ["always", "ltl"] {
                let path = ["check", table];
                let Some(found) = tree::at(document.as_item_mut(), &path) else {
                    continue;
                };
                for key in found.as_table_like().map(tree::keys).unwrap_or_default() {
                    change(found, &[], &key, |text| renamed(text, from, to));
                }
            }
        }
        (Kind::Part, Some(_)) => {}
    }
    Ok(())
}

fn rename_in_parts(document: &mut DocumentMut, from: &str, to: &str) {
    let processes = tree::at(document.as_item_mut(), &["process"]);
    let processes = processes.and_then(|found| found.as_table_like().map(tree::keys));
    let scopes = processes.into_iter().flatten().map(Some).chain([None]);
    for within in scopes.collect::<Vec<_>>() {
        each_part(document, within.as_deref(), |part| {
            change(part, &[], "process", |text| match text == from {
                true => to.to_owned(),
                false => text.to_owned(),
            });
        });
    }
}

fn each_part(document: &mut DocumentMut, within: Option<&str>, mut with: impl FnMut(&mut Item)) {
    let Some(parts) = tree::at(document.as_item_mut(), &scope(within, "part")) else {
        return;
    };
    for name in parts.as_table_like().map(tree::keys).unwrap_or_default() {
        if let Some(part) = tree::at(parts, &[&name]) {
            with(part);
        }
    }
}

/// The ports of a part that are bound to a channel.
fn bound_to(part: &mut Item, channel: &str) -> Vec<String> {
    let bind = tree::at(part, &["bind"]).and_then(|bind| bind.as_table_like());
    let ports = bind.into_iter().flat_map(|bind| bind.iter());
    let ports = ports.filter(|(_, item)| {
        let text = item.as_str().unwrap_or_default();
        text.split('[').next().unwrap_or_default().trim() == channel
    });
    ports.map(|(port, _)| port.to_owned()).collect()
}

/// Changes a text in a table of an item.
fn change(item: &mut Item, path: &[&str], key: &str, with: impl Fn(&str) -> String) {
    let Some(table) = tree::at(item, path) else {
        return;
    };
    let text = table
        .as_table_like()
        .and_then(|table| table.get(key)?.as_str());
    let Some(text) = text.map(str::to_owned) else {
        return;
    };
    let changed = with(&text);
    if changed != text {
        tree::set(table, key, changed.into());
    }
}

/// A text in which a word is another one, wherever it begins a path.
fn renamed(text: &str, from: &str, to: &str) -> String {
    let is_letter = |c: char| c.is_alphanumeric() || c == '_';
    let mut changed = String::new();
    let mut rest = text;
    while let Some(start) = rest.find(is_letter) {
        let (before, word) = rest.split_at(start);
        let end = word.find(|c| !is_letter(c)).unwrap_or(word.len());
        let (word, after) = word.split_at(end);
        changed.push_str(before);
        let is_first = !changed.trim_end().ends_with(['.', '@']);
        changed.push_str(if word == from && is_first { to } else { word });
        rest = after;
    }
    changed + rest
}
