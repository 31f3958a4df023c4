//! Where values come from: a file, the environment, the command line.

use super::error::{Reason, Refusal, SetError, Source};
use super::value::Value;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::Path;
#[cfg(feature = "toml")]
use std::sync::Arc;

/// The variable of the environment that names a file.
pub(super) const FILE: &str = "LUNA_PARAMETERS";
/// The variable that has values.
const VALUES: &str = "LUNA_SET";

/// A value that is to be a parameter's.
#[derive(Debug, Clone)]
pub(super) struct Given {
    pub(super) name: String,
    pub(super) value: Value,
    pub(super) source: Source,
}

impl Given {
    pub(super) fn refused(&self, unit: &str, reason: Reason) -> Refusal {
        Refusal {
            name: self.name.clone(),
            value: self.value.to_string(),
            unit: unit.to_owned(),
            source: self.source.clone(),
            reason,
        }
    }
}

/// Values by name, the later layers over the earlier ones; within a layer each name once.
pub(super) fn merge(
    layers: impl IntoIterator<Item = Vec<Given>>,
    refused: &mut Vec<Refusal>,
) -> BTreeMap<String, Given> {
    let mut all = BTreeMap::new();
    for layer in layers {
        let mut of_layer = BTreeMap::new();
        for given in layer {
            match of_layer.entry(given.name.clone()) {
                Entry::Occupied(_) => refused.push(given.refused("", Reason::Twice)),
                Entry::Vacant(entry) => drop(entry.insert(given)),
            }
        }
        all.extend(of_layer);
    }
    all
}

/// The values that the environment gives.
pub(super) fn values_of_environment() -> Result<Vec<Given>, SetError> {
    let Some(text) = std::env::var_os(VALUES) else {
        return Ok(Vec::new());
    };
    assignments(&text.to_string_lossy(), &Source::Environment(VALUES))
}

/// `NAME=VALUE,NAME=VALUE`, where commas within brackets belong to a value.
pub(super) fn assignments(text: &str, source: &Source) -> Result<Vec<Given>, SetError> {
    let mut depth = 0_usize;
    let parts = text.split(|letter| {
        match letter {
            '[' => depth += 1,
            ']' => depth = depth.saturating_sub(1),
            _ => {}
        }
        letter == ',' && depth == 0
    });
    parts
        .filter(|part| !part.trim().is_empty())
        .map(|part| assignment(part, source))
        .collect()
}

/// `NAME=VALUE`.
pub(super) fn assignment(text: &str, source: &Source) -> Result<Given, SetError> {
    let (name, value) = text.split_once('=').unwrap_or_default();
    let (name, value) = (name.trim(), value.trim());
    if name.is_empty() || value.is_empty() {
        return Err(SetError::Syntax {
            source: source.clone(),
            text: text.trim().to_owned(),
        });
    }
    Ok(Given {
        name: name.to_owned(),
        value: Value::Written(value.to_owned()),
        source: source.clone(),
    })
}

/// Reads a file's values. The names of tables come before those in them, with a slash between.
pub(super) fn read(path: &Path) -> Result<Vec<Given>, SetError> {
    let wrong = |line, message: String| SetError::File {
        path: path.display().to_string(),
        line,
        message,
    };
    let text = std::fs::read_to_string(path).map_err(|error| wrong(None, error.to_string()))?;
    parse(&path.display().to_string(), &text).map_err(|(line, message)| wrong(line, message))
}

/// On an error, its line and its text.
#[cfg(not(feature = "toml"))]
fn parse(_: &str, _: &str) -> Result<Vec<Given>, (Option<usize>, String)> {
    Err((None, crate::file::NO_TOML.to_owned()))
}

/// On an error, its line and its text.
#[cfg(feature = "toml")]
fn parse(path: &str, text: &str) -> Result<Vec<Given>, (Option<usize>, String)> {
    use crate::file::{Source as Text, entries, parse};
    let source = Text { name: path, text };
    let table = parse(source).map_err(|problem| (Some(problem.line), problem.message.into()))?;
    let mut found = Vec::new();
    // In the order of the file, but for tables that come in parts.
    collect(
        entries(source, table.get_ref()),
        "",
        &path.into(),
        &mut found,
    );
    found.sort_by_key(|given| match given.source {
        Source::File { line, .. } => line,
        _ => 0,
    });
    Ok(found)
}

#[cfg(feature = "toml")]
fn collect(
    entries: Vec<crate::file::Entry<'_>>,
    prefix: &str,
    path: &Arc<str>,
    found: &mut Vec<Given>,
) {
    for entry in entries {
        let name = format!("{prefix}{}", entry.key);
        if let Ok(inner) = entry.table() {
            collect(inner, &format!("{name}/"), path, found);
            continue;
        }
        let (line, _) = entry.source.position(entry.key_span().start);
        found.push(Given {
            name,
            value: value_of(entry.value()),
            source: Source::File {
                path: path.clone(),
                line,
            },
        });
    }
}

#[cfg(feature = "toml")]
fn value_of(value: &toml::de::DeValue<'_>) -> Value {
    use toml::de::DeValue;
    match value {
        DeValue::String(text) => Value::Text(text.to_string()),
        // No type has as many digits.
        DeValue::Integer(number) => Value::Integer(
            i128::from_str_radix(number.as_str(), number.radix()).unwrap_or(i128::MAX),
        ),
        DeValue::Float(number) => Value::Float(number.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Boolean(is) => Value::Bool(*is),
        DeValue::Datetime(time) => Value::Text(time.to_string()),
        DeValue::Array(values) => {
            Value::List(values.iter().map(|one| value_of(one.get_ref())).collect())
        }
        DeValue::Table(_) => Value::Text("a table".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(given: Vec<Given>) -> Vec<String> {
        let show = |given: &Given| format!("{}{} = {}", given.source, given.name, given.value);
        given.iter().map(show).collect()
    }

    #[test]
    fn commas_within_brackets_belong_to_the_value() {
        let given = assignments(" a/b = 1.5,gains=[1, 2,3] ,, mode=speed", &Source::Argument);
        assert_eq!(
            shown(given.unwrap()),
            [
                "--set: a/b = 1.5",
                "--set: gains = [1, 2,3]",
                "--set: mode = speed"
            ]
        );
        for wrong in ["a", "=1", "a=", "a=1,b"] {
            let error = assignments(wrong, &Source::Environment(VALUES)).unwrap_err();
            assert!(matches!(error, SetError::Syntax { .. }), "{wrong}");
        }
    }

    #[test]
    fn a_later_layer_wins_and_a_name_comes_once_in_each() {
        let layer = |text| assignments(text, &Source::Argument).unwrap();
        let mut refused = Vec::new();
        let all = merge([layer("a=1,b=2"), layer("b=3,c=4")], &mut refused);
        assert_eq!(
            shown(all.into_values().collect()).concat(),
            "--set: a = 1--set: b = 3--set: c = 4"
        );
        assert!(refused.is_empty());
        merge([layer("a=1,a=1")], &mut refused);
        assert_eq!(
            refused[0].to_string(),
            "--set: `a` = 1: it is set twice; leave one out"
        );
    }

    #[cfg(feature = "toml")]
    #[test]
    fn tables_are_the_first_part_of_names_and_lines_are_known() {
        let text = "whole = 3\n\n[pan]\nkp = 2.5 # 1/rad\n\"a b\" = [1, 2.0]\n[pan.limit]\nhigh = inf\n\"tilt/on\" = true\n";
        assert_eq!(
            shown(parse("m.toml", text).unwrap()),
            [
                "m.toml:1: whole = 3",
                "m.toml:4: pan/kp = 2.5",
                "m.toml:5: pan/a b = [1, 2.0]",
                "m.toml:7: pan/limit/high = inf",
                "m.toml:8: pan/limit/tilt/on = true"
            ]
        );
        let (line, message) = parse("m.toml", "a = 1\nb = \n").unwrap_err();
        assert_eq!(line, Some(2), "{message}");
        let (line, message) = parse("m.toml", "a = 1\n\na = 1\n").unwrap_err();
        assert_eq!(line, Some(3), "{message}");
    }
}
