//! Changes of tables that keep what stands around them.

use toml_edit::{Decor, InlineTable, Item, Key, RawString, Table, TableLike, Value};

/// The table of a path.
pub(super) fn at<'d>(root: &'d mut Item, path: &[&str]) -> Option<&'d mut Item> {
    let mut item = root;
    for key in path {
        item = item.as_table_like_mut()?.get_mut(key)?;
    }
    item.is_table_like().then_some(item)
}

/// The table of a path, made if it is not there; nothing if something else stands in its way.
pub(super) fn made<'d>(root: &'d mut Item, path: &[&str]) -> Option<&'d mut Item> {
    let mut item = root;
    for key in path {
        if item.as_table_like()?.get(key).is_none() {
            let mut table = Table::new();
            table.set_implicit(true);
            insert(item, key, Item::Table(table));
        }
        item = item.as_table_like_mut()?.get_mut(key)?;
    }
    item.is_table_like().then_some(item)
}

/// Puts a new entry behind the others. Within an inline or a dotted table it is an inline one.
pub(super) fn insert(parent: &mut Item, key: &str, item: Item) {
    match parent {
        Item::Table(table) if table.is_dotted() => {
            table.insert(key, Item::Value(value_of(item)));
        }
        Item::Table(table) => {
            if item.is_value() {
                table.set_implicit(false);
            }
            table.insert(key, item);
        }
        Item::Value(Value::InlineTable(table)) => insert_inline(table, key, value_of(item)),
        _ => {}
    }
}

fn value_of(item: Item) -> Value {
    match item {
        Item::Value(value) => value,
        Item::Table(table) => Value::InlineTable(table.into_inline_table()),
        _ => Value::InlineTable(InlineTable::new()),
    }
}

/// What stands before the closing brace comes to stand behind the new value.
fn insert_inline(table: &mut InlineTable, key: &str, mut value: Value) {
    let last = table.iter().last().map(|(key, _)| key.to_owned());
    let last = last.and_then(|key| table.get_mut(&key));
    let end = match last {
        Some(last) => {
            let end = last.decor().suffix().cloned();
            last.decor_mut().set_suffix("");
            end
        }
        None => Some(RawString::from(" ")),
    };
    *value.decor_mut() = Decor::new(" ", end.unwrap_or_default());
    table.insert_formatted(&Key::new(key).with_leaf_decor(Decor::new(" ", " ")), value);
}

/// Sets a value; what stands around the former one stays. Returns whether it could.
pub(super) fn set(parent: &mut Item, key: &str, mut value: Value) -> bool {
    let Some(table) = parent.as_table_like_mut() else {
        return false;
    };
    match table.get_mut(key) {
        None => insert(parent, key, Item::Value(value)),
        Some(Item::Value(old)) if !old.is_inline_table() => {
            *value.decor_mut() = old.decor().clone();
            *old = value;
        }
        Some(_) => return false,
    }
    true
}

/// Sets a value in a table within `parent`, which is made in the form that is usual for it.
pub(super) fn set_within(parent: &mut Item, table: &str, key: &str, value: Value) -> bool {
    let is_there = parent
        .as_table_like()
        .is_some_and(|found| found.get(table).is_some());
    if !is_there {
        let is_line = matches!(table, "bind" | "set") && parent.is_table();
        let made = if is_line {
            let mut dotted = Table::new();
            dotted.set_dotted(true);
            Item::Table(dotted)
        } else {
            Item::Value(Value::InlineTable(InlineTable::new()))
        };
        insert(parent, table, made);
        if let (true, Item::Table(parent)) = (is_line, parent as &mut Item) {
            parent.set_implicit(false);
        }
    }
    at(parent, &[table]).is_some_and(|table| set(table, key, value))
}

/// Removes an entry. Returns what stood before it and is not about it: all up to the last empty
/// line.
pub(super) fn remove(parent: &mut Item, key: &str) -> Option<String> {
    let (before, position) = match parent {
        Item::Table(table) => {
            let (found, item) = table.remove_entry(key)?;
            match &item {
                Item::Table(table) => (prefix(table.decor()), table.position()),
                _ => (prefix(found.leaf_decor()), None),
            }
        }
        Item::Value(Value::InlineTable(table)) => {
            let is_last = table.iter().last().is_some_and(|(last, _)| last == key);
            let (_, removed) = table.remove_entry(key)?;
            let last = table.iter().last().map(|(key, _)| key.to_owned());
            if let Some(last) = last.and_then(|key| table.get_mut(&key)).filter(|_| is_last) {
                let end = removed.decor().suffix().cloned().unwrap_or_default();
                last.decor_mut().set_suffix(end);
            }
            return Some(String::new());
        }
        _ => return None,
    };
    // A comment behind which an empty line stands is about more than this entry.
    let kept = before.rfind("\n\n").map_or("", |end| &before[..=end]);
    let is_comment = position.is_some() && kept.contains('#');
    Some(if is_comment {
        kept.to_owned()
    } else {
        String::new()
    })
}

fn prefix(decor: &Decor) -> String {
    let text = decor.prefix().and_then(RawString::as_str);
    text.unwrap_or_default().to_owned()
}

/// The position of the table with this name, among all of the file.
pub(super) fn position(parent: &Item, key: &str) -> Option<isize> {
    parent.as_table()?.get(key)?.as_table()?.position()
}

/// Puts a text before the first table behind a position; returns it if there is none.
pub(super) fn put_before_next(table: &mut Table, after: isize, text: String) -> Option<String> {
    fn next(table: &Table, after: isize) -> Option<isize> {
        let own = table
            .position()
            .filter(|at| *at > after && !table.is_implicit());
        let tables = table.iter().filter_map(|(_, item)| item.as_table());
        tables
            .filter_map(|inner| next(inner, after))
            .chain(own)
            .min()
    }
    fn find(table: &mut Table, position: isize) -> Option<&mut Table> {
        if table.position() == Some(position) {
            return Some(table);
        }
        let tables = table.iter_mut().filter_map(|(_, item)| item.as_table_mut());
        tables.filter_map(|inner| find(inner, position)).next()
    }
    let found = next(table, after).and_then(|position| find(table, position));
    let Some(found) = found else {
        return Some(text);
    };
    let before = prefix(found.decor());
    found.decor_mut().set_prefix(text + &before);
    None
}

/// Gives an entry another key, at the same place.
pub(super) fn rename(parent: &mut Item, from: &str, to: &str) {
    let renamed = |key: Key| match key.get() == from {
        true => Key::new(to)
            .with_leaf_decor(key.leaf_decor().clone())
            .with_dotted_decor(key.dotted_decor().clone()),
        false => key,
    };
    match parent {
        Item::Table(table) => {
            let keys: Vec<String> = table.iter().map(|(key, _)| key.to_owned()).collect();
            let entries = keys.iter().filter_map(|key| table.remove_entry(key));
            for (key, item) in entries.collect::<Vec<_>>() {
                table.insert_formatted(&renamed(key), item);
            }
        }
        Item::Value(Value::InlineTable(table)) => {
            let keys: Vec<String> = table.iter().map(|(key, _)| key.to_owned()).collect();
            let entries = keys.iter().filter_map(|key| table.remove_entry(key));
            for (key, value) in entries.collect::<Vec<_>>() {
                table.insert_formatted(&renamed(key), value);
            }
        }
        _ => {}
    }
}

/// The keys of a table.
pub(super) fn keys(table: &dyn TableLike) -> Vec<String> {
    table.iter().map(|(key, _)| key.to_owned()).collect()
}
