//! Tables of a TOML file, read key by key.

use crate::language::Piece;
use crate::language::expr::Expr;
use crate::language::parser::{Parser, Path};
use crate::text::{Problem, Source, nearest};
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A key, its value, and where both stand.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Entry<'t> {
    pub(crate) source: Source<'t>,
    pub(crate) key: &'t str,
    key_at: (usize, usize),
    value: &'t Spanned<DeValue<'t>>,
}

/// The table that a text is.
pub(crate) fn parse(source: Source<'_>) -> Result<Spanned<DeTable<'_>>, Problem> {
    DeTable::parse(source.text).map_err(|error| {
        let span = error.span().unwrap_or(0..0);
        source.problem(span, error.message().trim(), "write it as TOML has it")
    })
}

/// The entries of a table in the order of the file.
pub(crate) fn entries<'t>(source: Source<'t>, table: &'t DeTable<'t>) -> Vec<Entry<'t>> {
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
    pub(crate) fn key_span(&self) -> Range<usize> {
        self.key_at.0..self.key_at.1
    }

    pub(crate) fn span(&self) -> Range<usize> {
        self.value.span()
    }

    pub(crate) fn named(&self) -> (String, Range<usize>) {
        (self.key.to_owned(), self.key_span())
    }

    pub(crate) fn problem(&self, message: &str, advice: impl Into<String>) -> Problem {
        self.source.problem(self.span(), message, advice)
    }

    /// No entry has this key.
    pub(crate) fn unknown(&self, known: &[&str]) -> Problem {
        let advice = nearest(self.key, known.iter().copied());
        let message = "this key has no meaning here";
        self.source.problem(self.key_span(), message, advice)
    }

    pub(crate) fn table(&self) -> Result<Vec<Entry<'t>>, Problem> {
        match self.value.get_ref().as_table() {
            Some(table) => Ok(entries(self.source, table)),
            None => Err(self.problem("a table is expected", format!("write `[{}]`", self.key))),
        }
    }

    pub(crate) fn text(&self) -> Result<&'t str, Problem> {
        let advice = "write it in quotes";
        let value = self.value.get_ref().as_str();
        value.ok_or_else(|| self.problem("a text is expected", advice))
    }

    /// A text with its place, for a parser.
    pub(crate) fn piece(&self) -> Result<Piece<'t>, Problem> {
        Ok(Piece::new(self.source, self.text()?, self.span()))
    }

    pub(crate) fn numbers(
        &self,
        range: std::ops::RangeInclusive<i64>,
    ) -> Result<Vec<i64>, Problem> {
        let Some(values) = self.value.get_ref().as_array() else {
            return Err(self.problem("a list of numbers is expected", "write `[120, 40]`"));
        };
        let entries = values.iter().map(|value| Entry { value, ..*self });
        entries.map(|entry| entry.number(range.clone())).collect()
    }

    pub(crate) fn number(&self, range: std::ops::RangeInclusive<i64>) -> Result<i64, Problem> {
        let integer = self.value.get_ref().as_integer();
        let number = integer
            .and_then(|found| i64::from_str_radix(found.as_str(), found.radix()).ok())
            .filter(|number| range.contains(number));
        number.ok_or_else(|| {
            let advice = format!("write one from {} to {}", range.start(), range.end());
            self.problem("a whole number is expected", advice)
        })
    }

    /// A number, or a text that is an expression.
    pub(crate) fn expr(&self) -> Result<Expr<Path>, Problem> {
        if self.value.get_ref().is_str() {
            return Parser::only_expr(self.piece()?);
        }
        let number = self.number(i32::MIN.into()..=i32::MAX.into())?;
        Ok(Expr::Number(number as i32))
    }

    /// One of several words.
    pub(crate) fn one_of<T: Copy>(&self, known: &[(&str, T)]) -> Result<T, Problem> {
        let text = self.text()?;
        let found = known.iter().find(|(word, _)| *word == text);
        found.map(|(_, meaning)| *meaning).ok_or_else(|| {
            let advice = nearest(text, known.iter().map(|(word, _)| *word));
            self.problem("this value has no meaning here", advice)
        })
    }

    /// A key that is the name of something.
    pub(crate) fn name(&self, reserved: &[&str]) -> Result<(String, Range<usize>), Problem> {
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
