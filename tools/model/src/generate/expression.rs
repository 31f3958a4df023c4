//! Expressions in Rust: numbers and conditions are two types there, and need no more parentheses
//! than `rustc` and Clippy want.

use crate::language::expr::{Binary, Expr, Unary};
use crate::language::parser::Path;

const AND: u8 = 2;
const COMPARISON: u8 = 3;
const UNARY: u8 = 6;
const ATOM: u8 = 7;

/// A text, and how close its outermost operator binds.
type Text = (String, u8);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Natural {
    /// 0 or 1, `false` or `true`.
    Either,
    Int,
    Bool,
}

/// The names that an expression may use, in Rust, and whether they are `bool`.
pub(super) trait Lookup {
    fn rust(&self, name: &str) -> String;
    fn is_bool(&self, name: &str) -> bool;
}

pub(super) fn int(expr: &Expr<Path>, names: &impl Lookup) -> String {
    as_int(expr, names).0
}

pub(super) fn condition(expr: &Expr<Path>, names: &impl Lookup) -> String {
    as_bool(expr, names).0
}

/// Several conditions of which all must hold.
pub(super) fn all_of(conditions: &[&Expr<Path>], names: &impl Lookup) -> String {
    if let [only] = conditions {
        return condition(only, names);
    }
    let texts = conditions.iter();
    let texts: Vec<String> = texts.map(|one| within(as_bool(one, names), AND)).collect();
    texts.join(" && ")
}

/// The name of an expression that is one.
pub(super) fn word(expr: &Expr<Path>) -> Option<&str> {
    match expr {
        Expr::Name(path) => path.word(),
        _ => None,
    }
}

/// `+=` and the like, with what follows, if `name = expr` can be written so.
pub(super) fn compound(
    name: &str,
    expr: &Expr<Path>,
    names: &impl Lookup,
) -> Option<(&'static str, String)> {
    let Expr::Binary(operator, left, right) = expr else {
        return None;
    };
    let sign = match operator {
        Binary::Plus => "+=",
        Binary::Minus => "-=",
        Binary::Times => "*=",
        Binary::Divide => "/=",
        Binary::Modulo => "%=",
        _ => return None,
    };
    let commutes = matches!(operator, Binary::Plus | Binary::Times);
    if word(left) == Some(name) {
        return Some((sign, int(right, names)));
    }
    (commutes && word(right) == Some(name)).then(|| (sign, int(left, names)))
}

fn natural(expr: &Expr<Path>, names: &impl Lookup) -> Natural {
    match expr {
        Expr::Number(0 | 1) => Natural::Either,
        Expr::Number(_) | Expr::Unary(Unary::Minus, _) => Natural::Int,
        Expr::Name(path) if names.is_bool(path.word().unwrap_or("")) => Natural::Bool,
        Expr::Name(_) => Natural::Int,
        Expr::Unary(Unary::Not, _) => Natural::Bool,
        Expr::Binary(operator, ..) => match operator {
            Binary::Plus | Binary::Minus | Binary::Times | Binary::Divide | Binary::Modulo => {
                Natural::Int
            }
            _ => Natural::Bool,
        },
    }
}

fn name_of(path: &Path, names: &impl Lookup) -> String {
    names.rust(path.word().unwrap_or(""))
}

/// In parentheses if it binds less close.
fn within((text, binding): Text, least: u8) -> String {
    if binding < least {
        format!("({text})")
    } else {
        text
    }
}

fn as_int(expr: &Expr<Path>, names: &impl Lookup) -> Text {
    match expr {
        Expr::Number(number) if *number < 0 => (number.to_string(), UNARY),
        Expr::Number(number) => (number.to_string(), ATOM),
        Expr::Unary(Unary::Minus, of) => (format!("-{}", within(as_int(of, names), ATOM)), UNARY),
        Expr::Binary(operator, left, right) if natural(expr, names) == Natural::Int => {
            let binding = operator.binding();
            let left = within(as_int(left, names), binding);
            let right = within(as_int(right, names), binding + 1);
            (format!("{left} {} {right}", operator.sign()), binding)
        }
        Expr::Name(path) if natural(expr, names) == Natural::Int => (name_of(path, names), ATOM),
        _ => (format!("i32::from({})", as_bool(expr, names).0), ATOM),
    }
}

fn as_bool(expr: &Expr<Path>, names: &impl Lookup) -> Text {
    match expr {
        Expr::Number(number) => ((*number != 0).to_string(), ATOM),
        Expr::Name(path) if natural(expr, names) == Natural::Bool => (name_of(path, names), ATOM),
        Expr::Unary(Unary::Not, of) => negated(of, names),
        Expr::Binary(Binary::And, left, right) if let Some(found) = range(left, right, names) => {
            found
        }
        Expr::Binary(operator @ (Binary::And | Binary::Or), left, right) => {
            let binding = operator.binding();
            let left = within(as_bool(left, names), binding);
            let right = within(as_bool(right, names), binding + 1);
            (format!("{left} {} {right}", operator.sign()), binding)
        }
        Expr::Binary(operator, left, right) if natural(expr, names) == Natural::Bool => {
            comparison(*operator, left, right, names)
        }
        _ => {
            let number = within(as_int(expr, names), COMPARISON + 1);
            (format!("{number} != 0"), COMPARISON)
        }
    }
}

fn comparison(
    operator: Binary,
    left: &Expr<Path>,
    right: &Expr<Path>,
    names: &impl Lookup,
) -> Text {
    let is_equality = matches!(operator, Binary::Equal | Binary::Unequal);
    let of = |expr| (natural(expr, names), expr);
    match (of(left), of(right)) {
        // Compared with a literal, a condition is itself, or its opposite.
        ((Natural::Bool, one), (Natural::Either, Expr::Number(literal)))
        | ((Natural::Either, Expr::Number(literal)), (Natural::Bool, one))
            if is_equality =>
        {
            if (*literal == 1) == (operator == Binary::Equal) {
                as_bool(one, names)
            } else {
                negated(one, names)
            }
        }
        ((Natural::Bool, _), (Natural::Bool, _)) if is_equality => {
            let left = within(as_bool(left, names), COMPARISON + 1);
            let right = within(as_bool(right, names), COMPARISON + 1);
            (format!("{left} {} {right}", operator.sign()), COMPARISON)
        }
        _ => {
            let left = within(as_int(left, names), COMPARISON + 1);
            let right = within(as_int(right, names), COMPARISON + 1);
            (format!("{left} {} {right}", operator.sign()), COMPARISON)
        }
    }
}

/// `0 <= x && x < 9` as Clippy wants it; nothing if it is no range between two numbers.
fn range(left: &Expr<Path>, right: &Expr<Path>, names: &impl Lookup) -> Option<Text> {
    let (one, other) = (bound(left)?, bound(right)?);
    let (low, (high, is_included)) = match (one.bound, other.bound) {
        (Bound::Low(low), Bound::High(high, is_included))
        | (Bound::High(high, is_included), Bound::Low(low)) => (low, (high, is_included)),
        _ => return None,
    };
    if one.name.word() != other.name.word() || names.is_bool(one.name.word()?) || low > high {
        return None;
    }
    let sign = if is_included { "..=" } else { ".." };
    let name = name_of(one.name, names);
    Some((format!("({low}{sign}{high}).contains(&{name})"), ATOM))
}

struct Bounded<'e> {
    name: &'e Path,
    bound: Bound,
}

enum Bound {
    Low(i32),
    /// And whether it belongs to the range.
    High(i32, bool),
}

/// `x >= 0` or `0 <= x`, `x < 9` or `9 > x`.
fn bound(expr: &Expr<Path>) -> Option<Bounded<'_>> {
    let Expr::Binary(operator, left, right) = expr else {
        return None;
    };
    let (operator, name, number) = match (&**left, &**right) {
        (Expr::Name(name), Expr::Number(number)) => (*operator, name, *number),
        (Expr::Number(number), Expr::Name(name)) => {
            let turned = match operator {
                Binary::Less => Binary::Greater,
                Binary::LessEqual => Binary::GreaterEqual,
                Binary::Greater => Binary::Less,
                Binary::GreaterEqual => Binary::LessEqual,
                other => *other,
            };
            (turned, name, *number)
        }
        _ => return None,
    };
    let bound = match operator {
        Binary::GreaterEqual => Bound::Low(number),
        Binary::Less => Bound::High(number, false),
        Binary::LessEqual => Bound::High(number, true),
        _ => return None,
    };
    Some(Bounded { name, bound })
}

/// The opposite of a condition; of a comparison, the opposite comparison.
fn negated(expr: &Expr<Path>, names: &impl Lookup) -> Text {
    match expr {
        Expr::Number(number) => ((*number == 0).to_string(), ATOM),
        Expr::Unary(Unary::Not, of) => as_bool(of, names),
        Expr::Binary(operator, left, right) => {
            let opposite = match operator {
                Binary::Equal => Binary::Unequal,
                Binary::Unequal => Binary::Equal,
                Binary::Less => Binary::GreaterEqual,
                Binary::LessEqual => Binary::Greater,
                Binary::Greater => Binary::LessEqual,
                Binary::GreaterEqual => Binary::Less,
                Binary::And | Binary::Or => {
                    return (format!("!({})", as_bool(expr, names).0), UNARY);
                }
                _ => {
                    let number = within(as_int(expr, names), COMPARISON + 1);
                    return (format!("{number} == 0"), COMPARISON);
                }
            };
            comparison(opposite, left, right, names)
        }
        Expr::Name(_) if natural(expr, names) == Natural::Bool => {
            (format!("!{}", as_bool(expr, names).0), UNARY)
        }
        Expr::Name(_) | Expr::Unary(Unary::Minus, _) => {
            let number = within(as_int(expr, names), COMPARISON + 1);
            (format!("{number} == 0"), COMPARISON)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::language::Piece;
    use crate::language::parser::Parser;
    use crate::text::Source;

    /// `a` and `b` are `bool`.
    struct Two;

    impl Lookup for Two {
        fn rust(&self, name: &str) -> String {
            name.to_owned()
        }

        fn is_bool(&self, name: &str) -> bool {
            name == "a" || name == "b"
        }
    }

    fn parsed(text: &str) -> Expr<Path> {
        let source = Source { name: "", text };
        let piece = Piece::new(source, text, 0..text.len());
        Parser::whole(piece, Parser::expr).expect("it is an expression")
    }

    #[test]
    fn conditions() {
        for (model, rust) in [
            ("a", "a"),
            ("x", "x != 0"),
            ("!x", "x == 0"),
            ("!a", "!a"),
            ("a == true", "a"),
            ("a == false", "!a"),
            ("0 != a", "a"),
            ("a == b", "a == b"),
            ("a == x", "i32::from(a) == x"),
            ("(x == 1) == (y == 2)", "(x == 1) == (y == 2)"),
            ("!(x < 3)", "x >= 3"),
            ("!(a && x > 1)", "!(a && x > 1)"),
            ("a && b || x == 1 && y", "a && b || x == 1 && y != 0"),
            ("a && (b || x)", "a && (b || x != 0)"),
            ("x % 3", "x % 3 != 0"),
            ("true", "true"),
            ("0 <= x && x < 9", "(0..9).contains(&x)"),
            ("x <= 9 && x >= -1 && a", "(-1..=9).contains(&x) && a"),
            ("0 <= x && y < 9", "0 <= x && y < 9"),
            ("0 < x && x < y", "0 < x && x < y"),
        ] {
            assert_eq!(condition(&parsed(model), &Two), rust, "{model}");
        }
    }

    #[test]
    fn numbers() {
        for (model, rust) in [
            ("(x + 1) % 8", "(x + 1) % 8"),
            ("x + (1 % 8)", "x + 1 % 8"),
            ("x - (y - 1)", "x - (y - 1)"),
            ("x - y - 1", "x - y - 1"),
            ("x - -3", "x - -3"),
            ("-(-x)", "-(-x)"),
            ("a + 1", "i32::from(a) + 1"),
            ("x < y", "i32::from(x < y)"),
        ] {
            assert_eq!(int(&parsed(model), &Two), rust, "{model}");
        }
    }

    #[test]
    fn an_assignment_to_itself() {
        for (model, rust) in [
            ("x + y * 2", Some(("+=", "y * 2"))),
            ("2 * x", Some(("*=", "2"))),
            ("2 - x", None),
            ("(x + 1) % 8", None),
        ] {
            let found = compound("x", &parsed(model), &Two);
            let expected = rust.map(|(sign, rest)| (sign, rest.to_owned()));
            assert_eq!(found, expected, "{model}");
        }
    }
}
