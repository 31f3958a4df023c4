//! Texts of files, and what is wrong in them.

use std::ops::Range;
use std::path::PathBuf;

/// An error in a TOML file that a person writes: a system file, a
/// model.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{file}:{line}:{column}: {message}: `{value}`; {advice}")]
pub struct Problem {
    /// The file's name, as given.
    pub file: Box<str>,
    /// From 1.
    pub line: usize,
    /// In characters, from 1.
    pub column: usize,
    /// What stands there: at most its first line.
    pub value: Box<str>,
    /// What is wrong.
    pub message: Box<str>,
    /// What to do.
    pub advice: Box<str>,
}

/// A file's text and its name.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// As in errors.
    pub name: &'a str,
    /// All of it.
    pub text: &'a str,
}

/// Longer values are shortened.
const MAX_VALUE: usize = 60;

impl<'a> Source<'a> {
    /// The text of a span; empty if the span is none of this text.
    pub fn slice(&self, span: Range<usize>) -> &'a str {
        self.text.get(span).unwrap_or("")
    }

    /// Line and column of a byte, both from 1.
    pub fn position(&self, byte: usize) -> (usize, usize) {
        let before = &self.text[..self.text.floor_char_boundary(byte)];
        let line = before.matches('\n').count() + 1;
        let start = before.rfind('\n').map_or(0, |newline| newline + 1);
        (line, before[start..].chars().count() + 1)
    }

    /// What is wrong at a place of the text, and what to do.
    pub fn problem(
        &self,
        span: Range<usize>,
        message: impl Into<String>,
        advice: impl Into<String>,
    ) -> Problem {
        let (line, column) = self.position(span.start);
        let first = self.slice(span).lines().next().unwrap_or("").trim();
        let mut value: String = first.chars().take(MAX_VALUE).collect();
        if first.chars().nth(MAX_VALUE).is_some() {
            value.push('…');
        }
        Problem {
            file: self.name.into(),
            line,
            column,
            value: value.into(),
            message: message.into().into(),
            advice: advice.into().into(),
        }
    }
}

/// The file that an environment variable names, if it names one.
pub fn of_environment(variable: &str) -> Option<PathBuf> {
    let path = std::env::var_os(variable)?;
    (!path.is_empty()).then(|| path.into())
}

/// Advice that names the nearest of the names that are there.
pub fn nearest<'n>(name: &str, known: impl Iterator<Item = &'n str> + Clone) -> String {
    if let Some(other) = crate::nearest::nearest(name, known.clone()) {
        return format!("is `{other}` meant?");
    }
    let known: Vec<&str> = known.take(12).collect();
    if known.is_empty() {
        "there is none here".to_owned()
    } else {
        format!("there are: {}", known.join(", "))
    }
}
