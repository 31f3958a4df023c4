//! Values that are short texts: expressions, buffers, types, places.

use super::{At, Range};
use crate::language::Piece;
use crate::language::expr::Expr;
use crate::language::parser::{Parser, Path};
use crate::network::Buffering;
use crate::recorded::MAX_BUFFER;
use crate::text::Problem;
use luna::file::Entry;

/// A text with its place, for a parser.
pub(super) fn piece<'t>(entry: &Entry<'t>) -> Result<Piece<'t>, Problem> {
    Ok(Piece::new(entry.source, entry.text()?, entry.span()))
}

/// A number, or a text that is an expression.
pub(super) fn expr(entry: &Entry<'_>) -> Result<Expr<Path>, Problem> {
    if entry.is_text() {
        return Parser::whole(piece(entry)?, Parser::expr);
    }
    let number = entry.number(i32::MIN.into()..=i32::MAX.into())?;
    Ok(Expr::Number(number as i32))
}

/// `rendezvous`, `fifo 2`, `overwrite_oldest 1`, `overwrite_newest 1`.
pub(super) fn buffer(entry: &Entry<'_>) -> Result<Buffering, Problem> {
    let text = entry.text()?;
    let mut words = text.split_whitespace();
    let (word, size, more) = (words.next(), words.next(), words.next());
    let size = size.map(|size| size.parse().ok().filter(|n| (1..=MAX_BUFFER).contains(n)));
    let kind = match (word, size, more) {
        (Some("rendezvous"), None, None) => Some(Buffering::Rendezvous),
        (Some("fifo"), Some(Some(n)), None) => Some(Buffering::Fifo(n)),
        (Some("overwrite_oldest"), Some(Some(n)), None) => Some(Buffering::OverwriteOldest(n)),
        (Some("overwrite_newest"), Some(Some(n)), None) => Some(Buffering::OverwriteNewest(n)),
        _ => None,
    };
    kind.ok_or_else(|| {
        let advice = format!(
            "write `rendezvous`, `fifo N`, `overwrite_oldest N` or `overwrite_newest N`, N from 1 \
             to {MAX_BUFFER}"
        );
        entry.problem("this is no buffer", advice)
    })
}

/// A range that the check follows, or nothing for a type that it does not.
pub(super) fn channel_values(entry: &Entry<'_>) -> Result<Option<Range>, Problem> {
    match entry.text()? {
        "bool" => Ok(Some(boolean())),
        text if text.contains("..") => range(piece(entry)?).map(Some),
        _ => Ok(None),
    }
}

/// `0..9`, `0..9 = 3` or `bool`.
pub(super) fn variable(entry: &Entry<'_>) -> Result<Range, Problem> {
    match entry.text()? {
        "bool" => Ok(boolean()),
        _ => range(piece(entry)?),
    }
}

fn boolean() -> Range {
    Range {
        low: Expr::Number(0),
        high: Expr::Number(1),
        first: None,
        is_bool: true,
    }
}

fn range(piece: Piece<'_>) -> Result<Range, Problem> {
    Parser::whole(piece, |parser| {
        let low = parser.expr()?;
        parser.expect("..")?;
        Ok(Range {
            low,
            high: parser.expr()?,
            first: parser.take("=").then(|| parser.expr()).transpose()?,
            is_bool: false,
        })
    })
}

/// Further away than any screen reaches.
const FARTHEST: i64 = 100_000;

/// `[120, 40]`.
pub(super) fn at(entry: &Entry<'_>) -> Result<At, Problem> {
    match entry.numbers(-FARTHEST..=FARTHEST)?[..] {
        [x, y] => Ok((x as i32, y as i32)),
        _ => Err(entry.problem("a place has two numbers", "write `[120, 40]`")),
    }
}
