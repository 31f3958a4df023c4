//! Tables of a TOML file, read key by key.

use super::problem::{Problem, Source, nearest};
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A key, its value, and where both stand.
#[derive(Debug, Clone, Copy)]
pub struct Entry<'t> {
    /// The file.
    pub source: Source<'t>,
    /// The key.
    pub key: &'t str,
    key_at: (usize, usize),
    value: &'t Spanned<DeValue<'t>>,
}

/// The table that a text is.
pub fn parse(source: Source<'_>) -> Result<Spanned<DeTable<'_>>, Problem> {
    DeTable::parse(source.text).map_err(|error| {
        let span = error.span().unwrap_or(0..0);
        source.problem(span, error.message().trim(), "write it as TOML has it")
    })
}

/// The entries of a table in the order of the file.
pub fn entries<'t>(source: Source<'t>, table: &'t DeTable<'t>) -> Vec<Entry<'t>> {
    let mut found: Vec<Entry<'t>> = table
        .iter()
        .map(|(key, value)| Entry {
            source,
            key: key.get_ref(),
            key_at: (key.span().start, key.span().end),
            value,
        })
        .collect();
    found.sort_by_key(|entry| entry.key_at);
    found
}

impl<'t> Entry<'t> {
    /// Where the key stands.
    pub fn key_span(&self) -> Range<usize> {
        self.key_at.0..self.key_at.1
    }

    /// Where the value stands.
    pub fn span(&self) -> Range<usize> {
        self.value.span()
    }

    /// The value as TOML has it.
    pub(crate) fn value(&self) -> &'t DeValue<'t> {
        self.value.get_ref()
    }

    /// The key, and where it stands.
    pub fn named(&self) -> (String, Range<usize>) {
        (self.key.to_owned(), self.key_span())
    }

    /// What is wrong with the value, and what to do.
    pub fn problem(&self, message: &str, advice: impl Into<String>) -> Problem {
        self.source.problem(self.span(), message, advice)
    }

    /// No entry has this key.
    pub fn unknown(&self, known: &[&str]) -> Problem {
        let advice = nearest(self.key, known.iter().copied());
        let message = "this key has no meaning here";
        self.source.problem(self.key_span(), message, advice)
    }

    /// The entries of a table.
    pub fn table(&self) -> Result<Vec<Entry<'t>>, Problem> {
        match self.value.get_ref().as_table() {
            Some(table) => Ok(entries(self.source, table)),
            None => Err(self.problem("a table is expected", format!("write `[{}]`", self.key))),
        }
    }

    /// A text.
    pub fn text(&self) -> Result<&'t str, Problem> {
        let advice = "write it in quotes";
        let value = self.value.get_ref().as_str();
        value.ok_or_else(|| self.problem("a text is expected", advice))
    }

    /// A list of numbers, each in the range.
    pub fn numbers(&self, range: std::ops::RangeInclusive<i64>) -> Result<Vec<i64>, Problem> {
        let Some(values) = self.value.get_ref().as_array() else {
            return Err(self.problem("a list of numbers is expected", "write `[120, 40]`"));
        };
        let entries = values.iter().map(|value| Entry { value, ..*self });
        entries.map(|entry| entry.number(range.clone())).collect()
    }

    /// A whole number in the range.
    pub fn number(&self, range: std::ops::RangeInclusive<i64>) -> Result<i64, Problem> {
        let advice = || format!("write one from {} to {}", range.start(), range.end());
        let Some(found) = self.value.get_ref().as_integer() else {
            return Err(self.problem("a whole number is expected", advice()));
        };
        let number = i64::from_str_radix(found.as_str(), found.radix()).ok();
        let number = number.filter(|number| range.contains(number));
        number.ok_or_else(|| self.problem("this number is out of range", advice()))
    }

    /// `true` or `false`.
    pub fn bool(&self) -> Result<bool, Problem> {
        let value = self.value.get_ref().as_bool();
        value.ok_or_else(|| self.problem("yes or no is expected", "write `true` or `false`"))
    }

    /// Whether it is a text.
    pub fn is_text(&self) -> bool {
        self.value.get_ref().is_str()
    }

    /// One of several words.
    pub fn one_of<T: Copy>(&self, known: &[(&str, T)]) -> Result<T, Problem> {
        let text = self.text()?;
        let found = known.iter().find(|(word, _)| *word == text);
        found.map(|(_, meaning)| *meaning).ok_or_else(|| {
            let advice = nearest(text, known.iter().map(|(word, _)| *word));
            self.problem("this value has no meaning here", advice)
        })
    }

    /// A key that is the name of something.
    pub fn name(&self, reserved: &[&str]) -> Result<(String, Range<usize>), Problem> {
        let mut letters = self.key.chars();
        let is_name = letters
            .next()
            .is_some_and(|c| c.is_alphabetic() || c == '_')
            && letters.all(|c| c.is_alphanumeric() || c == '_');
        if !is_name {
            let advice = "use letters, digits and `_`, a letter first";
            let message = "this is no name";
            return Err(self.source.problem(self.key_span(), message, advice));
        }
        if reserved.contains(&self.key) {
            let message = "this word has a meaning already";
            let advice = "use another name";
            return Err(self.source.problem(self.key_span(), message, advice));
        }
        Ok(self.named())
    }
}
