//! Names of a model as Rust has them.

use crate::language::body::Named;
use crate::text::{Problem, Source};

/// All of edition 2024, also those that are reserved.
pub(super) const KEYWORDS: [&str; 53] = [
    "abstract", "as", "async", "await", "become", "box", "break", "const", "continue", "crate",
    "do", "dyn", "else", "enum", "extern", "false", "final", "fn", "for", "gen", "if", "impl",
    "in", "let", "loop", "macro", "match", "mod", "move", "mut", "override", "priv", "pub", "ref",
    "return", "self", "Self", "static", "struct", "super", "trait", "true", "try", "type",
    "typeof", "unsafe", "unsized", "use", "virtual", "where", "while", "yield", "_",
];

/// `PanTilt` and `pan tilt` become `pan_tilt`.
pub(super) fn snake(name: &str) -> String {
    let mut found = String::new();
    let mut before: Option<char> = None;
    for letter in name.chars() {
        if !letter.is_alphanumeric() {
            if !found.is_empty() && !found.ends_with('_') {
                found.push('_');
            }
        } else {
            let begins = before.is_some_and(|c| c.is_lowercase() || c.is_numeric());
            if letter.is_uppercase() && begins && !found.ends_with('_') {
                found.push('_');
            }
            found.extend(letter.to_lowercase());
        }
        before = Some(letter);
    }
    found.trim_end_matches('_').to_owned()
}

/// `pan_tilt` becomes `PanTilt`.
pub(super) fn camel(name: &str) -> String {
    let mut found = String::new();
    for word in name.split(|c: char| !c.is_alphanumeric()) {
        let mut letters = word.chars();
        if let Some(first) = letters.next() {
            found.extend(first.to_uppercase());
            found.extend(letters);
        }
    }
    found
}

/// Names of one scope: each once, and none a word of Rust.
#[derive(Debug)]
pub(super) struct Names<'a> {
    source: Source<'a>,
    /// In Rust, and what it stands for.
    taken: Vec<(String, String)>,
}

/// A meaning, and the names that have it.
pub(super) type Taken = (&'static str, &'static [&'static str]);

impl<'a> Names<'a> {
    /// A scope that has names already, with what they stand for.
    pub(super) fn new(source: Source<'a>, taken: &[Taken]) -> Self {
        let owned = |&(of, names): &Taken| {
            names
                .iter()
                .map(move |name| ((*name).to_owned(), of.to_owned()))
        };
        Self {
            source,
            taken: taken.iter().flat_map(owned).collect(),
        }
    }

    /// Takes `rust` for what the model calls `named`.
    pub(super) fn take(&mut self, rust: String, named: &Named, what: &str) -> Result<(), Problem> {
        let problem = |message: String| {
            let advice = "use another name in the model";
            Err(self.source.problem(named.1.clone(), message, advice))
        };
        let is_name = rust.starts_with(|c: char| c.is_ascii_alphabetic())
            && rust.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        if !is_name {
            let message = "generated names have letters from a to z, digits and `_`";
            return problem(message.to_owned());
        }
        if KEYWORDS.contains(&rust.as_str()) {
            return problem(format!("`{rust}` is a word of Rust"));
        }
        if let Some((_, other)) = self.taken.iter().find(|(known, _)| *known == rust) {
            return problem(format!("in Rust this is `{rust}`: {other} has that name"));
        }
        // Further ones of a body are numbered: see `branches::choice`.
        let number = rust.strip_prefix("choice_");
        if number.is_some_and(|number| number.parse::<usize>().is_ok()) {
            return problem(format!(
                "in Rust this is `{rust}`: the turn of a `choose` has that name"
            ));
        }
        self.taken.push((rust, format!("{what} `{}`", named.0)));
        Ok(())
    }
}

/// A name for a variable of generated code, made unlike those before.
pub(super) fn unlike(name: &str, taken: &mut Vec<String>) -> String {
    let mut base = snake(name);
    let is_name = base.starts_with(|c: char| c.is_ascii_alphabetic()) && base.is_ascii();
    if !is_name || KEYWORDS.contains(&base.as_str()) {
        base = format!("the_{}", base.replace(|c: char| !c.is_ascii(), "x"));
    }
    let mut found = base.clone();
    let mut number = 2;
    while taken.contains(&found) {
        found = format!("{base}_{number}");
        number += 1;
    }
    taken.push(found.clone());
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_change_their_case() {
        for (name, snaked, camelled) in [
            ("PanTilt", "pan_tilt", "PanTilt"),
            ("pan_tilt", "pan_tilt", "PanTilt"),
            ("pump.between[1]", "pump_between_1", "PumpBetween1"),
            ("isLast", "is_last", "IsLast"),
            ("PWM", "pwm", "PWM"),
            ("_x", "x", "X"),
        ] {
            assert_eq!((&*snake(name), &*camel(name)), (snaked, camelled), "{name}");
        }
    }

    #[test]
    fn a_variable_is_unlike_those_before() {
        let mut taken = vec!["network".to_owned()];
        let mut next = |name| unlike(name, &mut taken);
        assert_eq!(next("a.b[0]"), "a_b_0");
        assert_eq!(next("a_b[0]"), "a_b_0_2");
        assert_eq!(next("type"), "the_type");
        assert_eq!(next("network"), "network_2");
    }
}
