//! Expressions over 32-bit integers; a condition is true if it is not 0.

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Unary {
    Minus,
    Not,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Binary {
    Or,
    And,
    Equal,
    Unequal,
    Less,
    LessEqual,
    Greater,
    GreaterEqual,
    Plus,
    Minus,
    Times,
    Divide,
    Modulo,
}

impl Binary {
    pub(crate) const fn sign(self) -> &'static str {
        match self {
            Self::Or => "||",
            Self::And => "&&",
            Self::Equal => "==",
            Self::Unequal => "!=",
            Self::Less => "<",
            Self::LessEqual => "<=",
            Self::Greater => ">",
            Self::GreaterEqual => ">=",
            Self::Plus => "+",
            Self::Minus => "-",
            Self::Times => "*",
            Self::Divide => "/",
            Self::Modulo => "%",
        }
    }

    /// Higher binds closer.
    pub(crate) const fn binding(self) -> u8 {
        match self {
            Self::Or => 1,
            Self::And => 2,
            Self::Equal
            | Self::Unequal
            | Self::Less
            | Self::LessEqual
            | Self::Greater
            | Self::GreaterEqual => 3,
            Self::Plus | Self::Minus => 4,
            Self::Times | Self::Divide | Self::Modulo => 5,
        }
    }

    pub(crate) const ALL: [Self; 13] = [
        Self::Or,
        Self::And,
        Self::Equal,
        Self::Unequal,
        Self::Less,
        Self::LessEqual,
        Self::Greater,
        Self::GreaterEqual,
        Self::Plus,
        Self::Minus,
        Self::Times,
        Self::Divide,
        Self::Modulo,
    ];
}

/// An expression over names of the kind `V`.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) enum Expr<V> {
    Number(i32),
    Name(V),
    Unary(Unary, Box<Expr<V>>),
    Binary(Binary, Box<Expr<V>>, Box<Expr<V>>),
}

/// What has no value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, thiserror::Error)]
pub(crate) enum Fault {
    #[error("divides by zero")]
    DivisionByZero,
    #[error("computes a number beyond 32 bits")]
    Overflow,
}

impl<V> Expr<V> {
    /// Both sides of `&&` and `||` are evaluated.
    pub(crate) fn value(&self, name: &impl Fn(&V) -> i32) -> Result<i32, Fault> {
        Ok(match self {
            Self::Number(number) => *number,
            Self::Name(found) => name(found),
            Self::Unary(Unary::Minus, of) => {
                of.value(name)?.checked_neg().ok_or(Fault::Overflow)?
            }
            Self::Unary(Unary::Not, of) => i32::from(of.value(name)? == 0),
            Self::Binary(operator, left, right) => {
                let (a, b) = (left.value(name)?, right.value(name)?);
                let by_zero = matches!(operator, Binary::Divide | Binary::Modulo) && b == 0;
                if by_zero {
                    return Err(Fault::DivisionByZero);
                }
                match operator {
                    Binary::Or => Some(i32::from(a != 0 || b != 0)),
                    Binary::And => Some(i32::from(a != 0 && b != 0)),
                    Binary::Equal => Some(i32::from(a == b)),
                    Binary::Unequal => Some(i32::from(a != b)),
                    Binary::Less => Some(i32::from(a < b)),
                    Binary::LessEqual => Some(i32::from(a <= b)),
                    Binary::Greater => Some(i32::from(a > b)),
                    Binary::GreaterEqual => Some(i32::from(a >= b)),
                    Binary::Plus => a.checked_add(b),
                    Binary::Minus => a.checked_sub(b),
                    Binary::Times => a.checked_mul(b),
                    Binary::Divide => a.checked_div(b),
                    Binary::Modulo => a.checked_rem(b),
                }
                .ok_or(Fault::Overflow)?
            }
        })
    }

    /// The same expression over other names.
    pub(crate) fn map<W, E>(
        &self,
        name: &mut impl FnMut(&V) -> Result<Expr<W>, E>,
    ) -> Result<Expr<W>, E> {
        Ok(match self {
            Self::Number(number) => Expr::Number(*number),
            Self::Name(found) => name(found)?,
            Self::Unary(operator, of) => Expr::Unary(*operator, Box::new(of.map(name)?)),
            Self::Binary(operator, left, right) => {
                let left = Box::new(left.map(name)?);
                Expr::Binary(*operator, left, Box::new(right.map(name)?))
            }
        })
    }

    pub(crate) fn each(&self, see: &mut impl FnMut(&V)) {
        match self {
            Self::Number(_) => {}
            Self::Name(found) => see(found),
            Self::Unary(_, of) => of.each(see),
            Self::Binary(_, left, right) => {
                left.each(see);
                right.each(see);
            }
        }
    }

    /// What it divides by, other than constants that are not 0.
    pub(crate) fn divisors<'e>(&'e self, found: &mut Vec<&'e Expr<V>>) {
        match self {
            Self::Number(_) | Self::Name(_) => {}
            Self::Unary(_, of) => of.divisors(found),
            Self::Binary(operator, left, right) => {
                left.divisors(found);
                right.divisors(found);
                let divides = matches!(operator, Binary::Divide | Binary::Modulo);
                if divides && !matches!(**right, Self::Number(1..)) {
                    found.push(right);
                }
            }
        }
    }

    /// Whether its value may be missing because of a division by zero.
    pub(crate) fn divides(&self) -> bool {
        let mut found = Vec::new();
        self.divisors(&mut found);
        !found.is_empty()
    }

    /// As C, Promela and CSPm write it, but for the names and the signs that `sign` gives.
    pub(crate) fn text(
        &self,
        name: &impl Fn(&V) -> String,
        sign: &impl Fn(Binary) -> &'static str,
        not: &str,
    ) -> String {
        match self {
            Self::Number(number) if *number < 0 => format!("({number})"),
            Self::Number(number) => number.to_string(),
            Self::Name(found) => name(found),
            Self::Unary(Unary::Minus, of) => format!("(-{})", of.text(name, sign, not)),
            Self::Unary(Unary::Not, of) => format!("({not}{})", of.text(name, sign, not)),
            Self::Binary(operator, left, right) => format!(
                "({} {} {})",
                left.text(name, sign, not),
                sign(*operator),
                right.text(name, sign, not)
            ),
        }
    }
}
