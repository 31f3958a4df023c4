//! Words of bodies and expressions.

use super::Piece;
use crate::text::Problem;
use std::ops::Range;

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Token {
    Number(i32),
    Word(String),
    Sign(&'static str),
    End,
}

/// Longer signs first.
const SIGNS: [&str; 33] = [
    "==", "!=", "<=", ">=", "=>", "->", "&&", "||", "..", "<>", ";", "{", "}", "(", ")", "[", "]",
    "|", "!", "?", "=", "<", ">", "+", "-", "*", "/", "%", ".", "@", ",", ":", "&",
];

/// The tokens of a text with their spans in the file; the last is `End`.
pub(crate) fn tokens(piece: &Piece<'_>) -> Result<Vec<(Token, Range<usize>)>, Problem> {
    let text = piece.text;
    let mut found = Vec::new();
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        let rest = &text[at..];
        let length = if first.is_whitespace() {
            first.len_utf8()
        } else if first == '#' {
            rest.find('\n').unwrap_or(rest.len())
        } else if first.is_ascii_digit() {
            let other = |c: char| !(c.is_ascii_digit() || c == '_');
            let length = rest.find(other).unwrap_or(rest.len());
            let number = rest[..length].replace('_', "").parse().map_err(|_| {
                let advice = format!("use a number up to {}", i32::MAX);
                piece.problem(at..at + length, "the number is too large", advice)
            })?;
            found.push((Token::Number(number), piece.span(at..at + length)));
            length
        } else if first.is_alphabetic() || first == '_' {
            let other = |c: char| !(c.is_alphanumeric() || c == '_');
            let length = rest.find(other).unwrap_or(rest.len());
            let word = rest[..length].to_owned();
            found.push((Token::Word(word), piece.span(at..at + length)));
            length
        } else if let Some(sign) = SIGNS.into_iter().find(|sign| rest.starts_with(sign)) {
            found.push((Token::Sign(sign), piece.span(at..at + sign.len())));
            sign.len()
        } else {
            let span = at..at + first.len_utf8();
            return Err(piece.problem(span, "this character has no meaning", "remove it"));
        };
        at += length;
    }
    found.push((Token::End, piece.span(text.len()..text.len())));
    Ok(found)
}
