//! The language of bodies, expressions and properties: texts within strings of the file.

pub(crate) mod body;
pub(crate) mod expr;
pub(crate) mod lexer;
pub(crate) mod parser;
pub(crate) mod temporal;

use crate::text::{Problem, Source};
use std::ops::Range;

/// A string of a model file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Piece<'a> {
    pub(crate) source: Source<'a>,
    /// As TOML reads it.
    pub(crate) text: &'a str,
    /// Where it begins in the file; with an escape in it, where the whole string stands.
    place: Place,
}

#[derive(Debug, Clone, Copy)]
enum Place {
    Exact(usize),
    Whole(usize, usize),
}

impl<'a> Piece<'a> {
    /// `span` is that of the string with its quotes.
    pub(crate) fn new(source: Source<'a>, text: &'a str, span: Range<usize>) -> Self {
        let raw = source.slice(span.clone());
        let quotes = if raw.starts_with("\"\"\"") || raw.starts_with("'''") {
            3
        } else {
            1
        };
        let mut start = quotes;
        if quotes == 3 {
            let rest = raw.get(3..).unwrap_or("");
            start += rest
                .find(|c| c != '\r' && c != '\n')
                .map_or(0, |at| match at {
                    0 => 0,
                    _ if rest.starts_with("\r\n") => 2,
                    _ => 1,
                });
        }
        let exact = raw.get(start..start + text.len()) == Some(text);
        let place = if exact {
            Place::Exact(span.start + start)
        } else {
            Place::Whole(span.start, span.end)
        };
        Self {
            source,
            text,
            place,
        }
    }

    /// The span in the file of a span in this text.
    pub(crate) fn span(&self, span: Range<usize>) -> Range<usize> {
        match self.place {
            Place::Exact(start) => start + span.start..start + span.end,
            Place::Whole(start, end) => start..end,
        }
    }

    pub(crate) fn problem(
        &self,
        span: Range<usize>,
        message: &str,
        advice: impl Into<String>,
    ) -> Problem {
        self.source.problem(self.span(span), message, advice)
    }
}
