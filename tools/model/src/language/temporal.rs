//! Properties in linear temporal logic, for SPIN.

use super::Piece;
use super::expr::Expr;
use super::parser::{Parser, Path};
use crate::text::Problem;

/// A property of runs, over names of the kind `V`, with SPIN's signs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Formula<V> {
    /// In the state where it is looked at.
    Holds(Expr<V>),
    /// `!`, `[] ` (always) or `<> ` (at some time).
    Unary(&'static str, Box<Formula<V>>),
    /// `U` (until), `->`, `&&` or `||`.
    Binary(&'static str, Box<Formula<V>>, Box<Formula<V>>),
}

impl<V> Formula<V> {
    fn binary(left: Self, sign: &'static str, right: Self) -> Self {
        Self::Binary(sign, Box::new(left), Box::new(right))
    }

    /// The same formula over other names.
    pub(crate) fn map<W, E>(
        &self,
        name: &mut impl FnMut(&V) -> Result<Expr<W>, E>,
    ) -> Result<Formula<W>, E> {
        Ok(match self {
            Self::Holds(expr) => Formula::Holds(expr.map(name)?),
            Self::Unary(sign, of) => Formula::Unary(sign, Box::new(of.map(name)?)),
            Self::Binary(sign, a, b) => Formula::binary(a.map(name)?, sign, b.map(name)?),
        })
    }

    /// As SPIN writes it.
    pub(crate) fn text(&self, expr: &impl Fn(&Expr<V>) -> String) -> String {
        match self {
            Self::Holds(found) => expr(found),
            Self::Unary(sign, of) => format!("({sign}{})", of.text(expr)),
            Self::Binary(sign, a, b) => format!("({} {sign} {})", a.text(expr), b.text(expr)),
        }
    }
}

type Parsed = Result<Formula<Path>, Problem>;

/// A whole text that is a formula.
pub(crate) fn parse(piece: Piece<'_>) -> Parsed {
    Parser::whole(piece, implication)
}

/// The loosest binding first: `->`, `U`, `||`, `&&`, then `[]`, `<>` and `!`.
fn implication(parser: &mut Parser<'_>) -> Parsed {
    let left = until(parser)?;
    Ok(match parser.take("->") {
        true => Formula::binary(left, "->", parser.nested(implication)?),
        false => left,
    })
}

fn until(parser: &mut Parser<'_>) -> Parsed {
    let left = chain(parser, "||", both)?;
    Ok(match parser.take_word("U") {
        true => Formula::binary(left, "U", parser.nested(until)?),
        false => left,
    })
}

fn both(parser: &mut Parser<'_>) -> Parsed {
    chain(parser, "&&", unary)
}

/// Parts with this sign between them.
fn chain(
    parser: &mut Parser<'_>,
    sign: &'static str,
    part: fn(&mut Parser<'_>) -> Parsed,
) -> Parsed {
    let mut left = part(parser)?;
    let mut terms = 0;
    while parser.take(sign) {
        parser.count(&mut terms)?;
        left = Formula::binary(left, sign, part(parser)?);
    }
    Ok(left)
}

fn unary(parser: &mut Parser<'_>) -> Parsed {
    let sign = if parser.take("[") {
        parser.expect("]")?;
        "[] "
    } else if parser.take("<>") {
        "<> "
    } else if parser.take("!") {
        "!"
    } else if parser.take("(") {
        // `(a) < b` is an expression that is to be written without these parentheses.
        let inner = parser.nested(implication)?;
        parser.expect(")")?;
        return Ok(inner);
    } else {
        return parser.comparison().map(Formula::Holds);
    };
    Ok(Formula::Unary(sign, Box::new(parser.nested(unary)?)))
}
