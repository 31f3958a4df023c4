//! What the parsers of bodies, expressions and properties share.

use super::Piece;
use super::expr::{Binary, Expr, Unary};
use super::lexer::{Token, tokens};
use crate::text::Problem;
use std::ops::Range;

/// Deeper nesting is refused: the parser calls itself.
const MAX_DEPTH: usize = 64;
/// Longer chains of operators of one kind are refused.
const MAX_TERMS: usize = 200;

/// `name`, `name[2]`, `part.part[1].name`, `part@action`.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) struct Path {
    pub(crate) segments: Vec<Segment>,
    /// The action at which a process is.
    pub(crate) action: Option<String>,
    pub(crate) span: Range<usize>,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) struct Segment {
    pub(crate) name: String,
    pub(crate) index: Option<Expr<Path>>,
}

impl Path {
    /// The name, if it is nothing but a name.
    pub(crate) fn word(&self) -> Option<&str> {
        match &self.segments[..] {
            [only] if only.index.is_none() && self.action.is_none() => Some(&only.name),
            _ => None,
        }
    }
}

pub(crate) struct Parser<'a> {
    piece: Piece<'a>,
    tokens: Vec<(Token, Range<usize>)>,
    at: usize,
    depth: usize,
}

impl<'a> Parser<'a> {
    pub(crate) fn new(piece: Piece<'a>) -> Result<Self, Problem> {
        let tokens = tokens(&piece)?;
        Ok(Self {
            piece,
            tokens,
            at: 0,
            depth: 0,
        })
    }

    pub(crate) fn peek(&self) -> &Token {
        &self.tokens[self.at].0
    }

    pub(crate) fn span(&self) -> Range<usize> {
        self.tokens[self.at].1.clone()
    }

    /// From the start of an earlier span to the end of the token before.
    pub(crate) fn since(&self, start: &Range<usize>) -> Range<usize> {
        let end = self.tokens[self.at.saturating_sub(1)].1.end;
        start.start..end.max(start.end)
    }

    /// The last token, `End`, stays.
    pub(crate) fn next(&mut self) -> Token {
        let token = self.peek().clone();
        self.at = (self.at + 1).min(self.tokens.len() - 1);
        token
    }

    pub(crate) fn is_sign(&self, sign: &str) -> bool {
        matches!(self.peek(), Token::Sign(found) if *found == sign)
    }

    pub(crate) fn take(&mut self, sign: &str) -> bool {
        let is = self.is_sign(sign);
        if is {
            self.next();
        }
        is
    }

    pub(crate) fn take_word(&mut self, word: &str) -> bool {
        let is = matches!(self.peek(), Token::Word(found) if found == word);
        if is {
            self.next();
        }
        is
    }

    pub(crate) fn expect(&mut self, sign: &str) -> Result<(), Problem> {
        if self.take(sign) {
            Ok(())
        } else {
            Err(self.unexpected(&format!("write `{sign}` here")))
        }
    }

    pub(crate) fn word(&mut self, advice: &str) -> Result<(String, Range<usize>), Problem> {
        let span = self.span();
        match self.peek() {
            Token::Word(word) => {
                let word = word.clone();
                self.next();
                Ok((word, span))
            }
            _ => Err(self.unexpected(advice)),
        }
    }

    pub(crate) fn end(&self) -> Result<(), Problem> {
        match self.peek() {
            Token::End => Ok(()),
            _ => Err(self.unexpected("remove it, or write an operator before it")),
        }
    }

    pub(crate) fn unexpected(&self, advice: &str) -> Problem {
        let message = match self.peek() {
            Token::End => "the text ends too early",
            _ => "this does not fit here",
        };
        self.piece.source.problem(self.span(), message, advice)
    }

    pub(crate) fn problem(&self, span: Range<usize>, message: &str, advice: &str) -> Problem {
        self.piece.source.problem(span, message, advice)
    }

    /// Runs a part one level deeper.
    pub(crate) fn nested<T>(
        &mut self,
        part: impl FnOnce(&mut Self) -> Result<T, Problem>,
    ) -> Result<T, Problem> {
        if self.depth == MAX_DEPTH {
            let message = "this is nested too deeply";
            return Err(self.problem(self.span(), message, "name a part of it, and use the name"));
        }
        self.depth += 1;
        let outcome = part(self);
        self.depth -= 1;
        outcome
    }

    /// What `part` reads, if it is the whole text.
    pub(crate) fn whole<T>(
        piece: Piece<'a>,
        part: impl FnOnce(&mut Self) -> Result<T, Problem>,
    ) -> Result<T, Problem> {
        let mut parser = Self::new(piece)?;
        let found = part(&mut parser)?;
        parser.end()?;
        Ok(found)
    }

    pub(crate) fn expr(&mut self) -> Result<Expr<Path>, Problem> {
        self.binary(1)
    }

    /// An expression without `&&` and `||`, which a formula has of its own.
    pub(crate) fn comparison(&mut self) -> Result<Expr<Path>, Problem> {
        self.binary(Binary::Equal.binding())
    }

    fn binary(&mut self, least: u8) -> Result<Expr<Path>, Problem> {
        let mut left = self.unary()?;
        let mut terms = 0;
        while let Some(operator) = self.operator().filter(|found| found.binding() >= least) {
            self.count(&mut terms)?;
            self.next();
            let right = self.nested(|parser| parser.binary(operator.binding() + 1))?;
            left = Expr::Binary(operator, Box::new(left), Box::new(right));
        }
        Ok(left)
    }

    /// Refuses chains that are too long: what walks through them calls itself.
    pub(crate) fn count(&self, terms: &mut usize) -> Result<(), Problem> {
        *terms += 1;
        if *terms > MAX_TERMS {
            return Err(self.problem(self.span(), "the expression is too long", "shorten it"));
        }
        Ok(())
    }

    fn operator(&self) -> Option<Binary> {
        let Token::Sign(sign) = self.peek() else {
            return None;
        };
        Binary::ALL.into_iter().find(|found| found.sign() == *sign)
    }

    /// Whether an expression may begin here.
    pub(crate) fn begins_expr(&self) -> bool {
        match self.peek() {
            Token::Number(_) => true,
            Token::Word(word) => word != "if",
            Token::Sign(sign) => matches!(*sign, "(" | "-" | "!"),
            Token::End => false,
        }
    }

    pub(crate) fn unary(&mut self) -> Result<Expr<Path>, Problem> {
        if self.take("-") {
            let of = self.nested(Self::unary)?;
            return Ok(match of {
                Expr::Number(number) => Expr::Number(-number),
                of => Expr::Unary(Unary::Minus, Box::new(of)),
            });
        }
        if self.take("!") {
            let of = self.nested(Self::unary)?;
            return Ok(Expr::Unary(Unary::Not, Box::new(of)));
        }
        if self.take("(") {
            let inner = self.nested(Self::expr)?;
            self.expect(")")?;
            return Ok(inner);
        }
        match self.peek() {
            Token::Number(number) => {
                let number = *number;
                self.next();
                Ok(Expr::Number(number))
            }
            Token::Word(word) if word == "true" || word == "false" => {
                let is = word == "true";
                self.next();
                Ok(Expr::Number(is.into()))
            }
            _ => self.path().map(Expr::Name),
        }
    }

    pub(crate) fn path(&mut self) -> Result<Path, Problem> {
        let start = self.span();
        let mut segments = Vec::new();
        loop {
            let (name, _) = self.word("write a number or a name here")?;
            let mut index = None;
            if self.take("[") {
                index = Some(self.nested(Self::expr)?);
                self.expect("]")?;
            }
            segments.push(Segment { name, index });
            if !self.take(".") {
                break;
            }
        }
        let mut action = None;
        if self.take("@") {
            action = Some(self.word("write the name of an action here")?.0);
        }
        let span = self.since(&start);
        Ok(Path {
            segments,
            action,
            span,
        })
    }
}
