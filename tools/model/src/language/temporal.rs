//! Properties in linear temporal logic, for SPIN.

use super::Piece;
use super::expr::Expr;
use super::parser::{Parser, Path};
use crate::text::Problem;

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Formula<V> {
    Holds(Expr<V>),
    Not(Box<Formula<V>>),
    Always(Box<Formula<V>>),
    Eventually(Box<Formula<V>>),
    Until(Box<Formula<V>>, Box<Formula<V>>),
    Implies(Box<Formula<V>>, Box<Formula<V>>),
    And(Box<Formula<V>>, Box<Formula<V>>),
    Or(Box<Formula<V>>, Box<Formula<V>>),
}

impl<V> Formula<V> {
    pub(crate) fn map<W, E>(
        &self,
        name: &mut impl FnMut(&V) -> Result<Expr<W>, E>,
    ) -> Result<Formula<W>, E> {
        let mut pair = |a: &Self, b: &Self| -> Result<_, E> {
            Ok((Box::new(a.map(name)?), Box::new(b.map(name)?)))
        };
        Ok(match self {
            Self::Until(a, b) => pair(a, b).map(|(a, b)| Formula::Until(a, b))?,
            Self::Implies(a, b) => pair(a, b).map(|(a, b)| Formula::Implies(a, b))?,
            Self::And(a, b) => pair(a, b).map(|(a, b)| Formula::And(a, b))?,
            Self::Or(a, b) => pair(a, b).map(|(a, b)| Formula::Or(a, b))?,
            Self::Holds(expr) => Formula::Holds(expr.map(name)?),
            Self::Not(of) => Formula::Not(Box::new(of.map(name)?)),
            Self::Always(of) => Formula::Always(Box::new(of.map(name)?)),
            Self::Eventually(of) => Formula::Eventually(Box::new(of.map(name)?)),
        })
    }

    /// As SPIN writes it.
    pub(crate) fn text(&self, expr: &impl Fn(&Expr<V>) -> String) -> String {
        let pair = |a: &Self, sign, b: &Self| format!("({} {sign} {})", a.text(expr), b.text(expr));
        match self {
            Self::Holds(found) => expr(found),
            Self::Not(of) => format!("(!{})", of.text(expr)),
            Self::Always(of) => format!("([] {})", of.text(expr)),
            Self::Eventually(of) => format!("(<> {})", of.text(expr)),
            Self::Until(a, b) => pair(a, "U", b),
            Self::Implies(a, b) => pair(a, "->", b),
            Self::And(a, b) => pair(a, "&&", b),
            Self::Or(a, b) => pair(a, "||", b),
        }
    }
}

/// A whole text that is a formula.
pub(crate) fn parse(piece: Piece<'_>) -> Result<Formula<Path>, Problem> {
    let mut parser = Parser::new(piece)?;
    let formula = implication(&mut parser)?;
    parser.end()?;
    Ok(formula)
}

/// The loosest binding first: `->`, `U`, `||`, `&&`, then `[]`, `<>` and `!`.
fn implication(parser: &mut Parser<'_>) -> Result<Formula<Path>, Problem> {
    let left = until(parser)?;
    if parser.take("->") {
        let right = parser.nested(implication)?;
        return Ok(Formula::Implies(Box::new(left), Box::new(right)));
    }
    Ok(left)
}

fn until(parser: &mut Parser<'_>) -> Result<Formula<Path>, Problem> {
    let left = either(parser)?;
    if parser.take_word("U") {
        let right = parser.nested(until)?;
        return Ok(Formula::Until(Box::new(left), Box::new(right)));
    }
    Ok(left)
}

fn either(parser: &mut Parser<'_>) -> Result<Formula<Path>, Problem> {
    let mut left = both(parser)?;
    let mut terms = 0;
    while parser.take("||") {
        parser.count(&mut terms)?;
        left = Formula::Or(Box::new(left), Box::new(both(parser)?));
    }
    Ok(left)
}

fn both(parser: &mut Parser<'_>) -> Result<Formula<Path>, Problem> {
    let mut left = unary(parser)?;
    let mut terms = 0;
    while parser.take("&&") {
        parser.count(&mut terms)?;
        left = Formula::And(Box::new(left), Box::new(unary(parser)?));
    }
    Ok(left)
}

fn unary(parser: &mut Parser<'_>) -> Result<Formula<Path>, Problem> {
    if parser.take("[") {
        parser.expect("]")?;
        let of = parser.nested(unary)?;
        return Ok(Formula::Always(Box::new(of)));
    }
    if parser.take("<>") {
        let of = parser.nested(unary)?;
        return Ok(Formula::Eventually(Box::new(of)));
    }
    if parser.take("!") {
        let of = parser.nested(unary)?;
        return Ok(Formula::Not(Box::new(of)));
    }
    if parser.take("(") {
        let inner = parser.nested(implication)?;
        parser.expect(")")?;
        // `(a) < b` is an expression that is to be written without these parentheses.
        return Ok(inner);
    }
    parser.comparison().map(Formula::Holds)
}
