//! Expressions. CSPm has conditions and numbers apart; in a model a condition is a number.

use super::{CspmError, Writer};
use crate::language::expr::{Binary, Expr, Unary};

/// The lowest and the highest value.
pub(super) type Range = (i64, i64);

const NUMBERS: Range = (i32::MIN as i64, i32::MAX as i64);

/// A number as text; the lowest one has no literal.
pub(super) fn number(number: i32) -> String {
    match number {
        i32::MIN => "(-2147483647 - 1)".to_owned(),
        _ if number < 0 => format!("({number})"),
        _ => number.to_string(),
    }
}

/// What an expression may be; nothing if it may have more than 32 bits. `ranges` are those of its
/// names.
fn range(ranges: &[Range], expr: &Expr<usize>) -> Option<Range> {
    let of = |expr: &Expr<usize>| range(ranges, expr);
    let found = match expr {
        Expr::Number(number) => ((*number).into(), (*number).into()),
        Expr::Name(slot) => ranges[*slot],
        Expr::Unary(Unary::Minus, inner) => {
            let (low, high) = of(inner)?;
            (-high, -low)
        }
        Expr::Unary(Unary::Not, inner) => {
            of(inner)?;
            (0, 1)
        }
        Expr::Binary(operator, left, right) => {
            let (a, b) = (of(left)?, of(right)?);
            let ends = |with: fn(i64, i64) -> i64| {
                let all = [
                    with(a.0, b.0),
                    with(a.0, b.1),
                    with(a.1, b.0),
                    with(a.1, b.1),
                ];
                (
                    all.into_iter().min().unwrap_or(0),
                    all.into_iter().max().unwrap_or(0),
                )
            };
            match operator {
                Binary::Plus => (a.0 + b.0, a.1 + b.1),
                Binary::Minus => (a.0 - b.1, a.1 - b.0),
                Binary::Times => ends(|a, b| a * b),
                // The lowest number has no opposite.
                Binary::Divide | Binary::Modulo if a.0 == NUMBERS.0 || b.0 == NUMBERS.0 => {
                    return None;
                }
                Binary::Divide => match b.0 > 0 {
                    true => ends(|a, b| a / b),
                    false => {
                        let most = a.0.abs().max(a.1.abs());
                        (if a.0 >= 0 && b.0 >= 0 { 0 } else { -most }, most)
                    }
                },
                Binary::Modulo => {
                    let most = (b.0.abs().max(b.1.abs()) - 1).max(0);
                    (a.0.clamp(-most, 0), a.1.clamp(0, most))
                }
                _ => (0, 1),
            }
        }
    };
    (found.0 >= NUMBERS.0 && found.1 <= NUMBERS.1).then_some(found)
}

impl Writer<'_> {
    /// What an expression may be.
    pub(super) fn range(
        &self,
        agent: usize,
        line: usize,
        expr: &Expr<usize>,
    ) -> Result<Range, CspmError> {
        self.terms().range(expr).ok_or_else(|| CspmError {
            line,
            process: self.network.agents[agent].name.as_str().into(),
            reason: "may compute a number beyond 32 bits, which FDR does not see".into(),
            advice: "give its variables smaller ranges".into(),
        })
    }

    /// The variables of the network.
    pub(super) fn terms(&self) -> Terms<'_> {
        Terms {
            names: &self.names.variables,
            ranges: &self.ranges,
        }
    }
}

/// What the names in expressions are called in CSPm, and what values they may have.
#[derive(Debug, Clone, Copy)]
pub(super) struct Terms<'a> {
    pub(super) names: &'a [String],
    pub(super) ranges: &'a [Range],
}

impl Terms<'_> {
    /// What an expression may be; nothing if it may have more than 32 bits.
    pub(super) fn range(self, expr: &Expr<usize>) -> Option<Range> {
        range(self.ranges, expr)
    }

    /// The conditions under which an expression divides by zero. Each has a value if those
    /// before it do not hold.
    pub(super) fn faults(self, expr: &Expr<usize>) -> Vec<String> {
        let mut divisors = Vec::new();
        expr.divisors(&mut divisors);
        let may_be_zero = |divisor: &&&Expr<usize>| {
            range(self.ranges, divisor).is_none_or(|(low, high)| low <= 0 && high >= 0)
        };
        let divisors = divisors.iter().filter(may_be_zero);
        divisors
            .map(|divisor| format!("{} == 0", self.number(divisor)))
            .collect()
    }

    pub(super) fn number(self, expr: &Expr<usize>) -> String {
        match expr {
            Expr::Number(found) => number(*found),
            Expr::Name(slot) => self.names[*slot].clone(),
            Expr::Unary(Unary::Minus, inner) => format!("(-{})", self.number(inner)),
            Expr::Binary(operator, left, right) if is_arithmetic(*operator) => {
                let (a, b) = (self.number(left), self.number(right));
                let is_signed = |of| range(self.ranges, of).is_none_or(|(low, _)| low < 0);
                let function = match operator {
                    Binary::Divide => "quotient",
                    Binary::Modulo => "remainder",
                    _ => "",
                };
                if !function.is_empty() && (is_signed(left) || is_signed(right)) {
                    return format!("{function}({a}, {b})");
                }
                format!("({a} {} {b})", operator.sign())
            }
            Expr::Unary(Unary::Not, _) | Expr::Binary(..) => {
                format!("(if {} then 1 else 0)", self.condition(expr))
            }
        }
    }

    pub(super) fn condition(self, expr: &Expr<usize>) -> String {
        match expr {
            Expr::Number(number) => (*number != 0).to_string(),
            Expr::Unary(Unary::Not, inner) => format!("(not {})", self.condition(inner)),
            Expr::Binary(Binary::And, left, right) => {
                format!("({} and {})", self.condition(left), self.condition(right))
            }
            Expr::Binary(Binary::Or, left, right) => {
                format!("({} or {})", self.condition(left), self.condition(right))
            }
            Expr::Binary(operator, left, right) if !is_arithmetic(*operator) => {
                format!(
                    "({} {} {})",
                    self.number(left),
                    operator.sign(),
                    self.number(right)
                )
            }
            _ => format!("({} != 0)", self.number(expr)),
        }
    }

    /// That a value is not between two numbers; nothing if it always is.
    pub(super) fn outside(
        self,
        expr: &Expr<usize>,
        found: Range,
        (low, high): (i32, i32),
    ) -> Option<String> {
        let value = self.number(expr);
        let below = (found.0 < low.into()).then(|| format!("{value} < {}", number(low)));
        let above = (found.1 > high.into()).then(|| format!("{value} > {}", number(high)));
        match (below, above) {
            (Some(below), Some(above)) => Some(format!("({below} or {above})")),
            (below, above) => below.or(above),
        }
    }
}

const fn is_arithmetic(operator: Binary) -> bool {
    matches!(
        operator,
        Binary::Plus | Binary::Minus | Binary::Times | Binary::Divide | Binary::Modulo
    )
}
