//! Bodies of processes, as they are written.

use super::Piece;
use super::expr::Expr;
use super::lexer::Token;
use super::parser::{Parser, Path};
use crate::text::Problem;
use std::ops::Range;

pub(crate) type Span = Range<usize>;
pub(crate) type Named = (String, Span);
pub(crate) type Block = Vec<Statement>;

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Statement {
    pub(crate) kind: StatementKind,
    pub(crate) span: Span,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum StatementKind {
    Offer(Offer),
    Action(String),
    Skip,
    Stop,
    Assign(Named, Expr<Path>),
    Assert(Expr<Path>),
    If(Expr<Path>, Block, Block),
    While(Expr<Path>, Block),
    Loop(Block),
    For(Named, Expr<Path>, Expr<Path>, Block),
    Par(Vec<Block>),
    Choose(Vec<Block>),
    Alternative {
        prioritized: bool,
        guards: Vec<Guard>,
    },
}

impl StatementKind {
    /// The blocks that it has.
    pub(crate) fn blocks(&self) -> Vec<&Block> {
        match self {
            Self::If(_, then, otherwise) => vec![then, otherwise],
            Self::While(_, inner) | Self::Loop(inner) | Self::For(_, _, _, inner) => vec![inner],
            Self::Par(blocks) | Self::Choose(blocks) => blocks.iter().collect(),
            Self::Alternative { guards, .. } => guards.iter().map(|guard| &guard.body).collect(),
            Self::Offer(_) | Self::Action(_) | Self::Skip | Self::Stop => Vec::new(),
            Self::Assign(..) | Self::Assert(_) => Vec::new(),
        }
    }
}

/// What a process is ready to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Offer {
    Send(Named, Option<Expr<Path>>),
    Receive(Named, Option<Named>),
    Skip,
    After,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Guard {
    pub(crate) offer: Offer,
    pub(crate) condition: Option<Expr<Path>>,
    pub(crate) body: Block,
    pub(crate) span: Span,
}

/// Words that name no port, variable or action.
pub(crate) const RESERVED: [&str; 17] = [
    "loop", "while", "for", "in", "if", "else", "par", "alt", "pri_alt", "choose", "skip", "stop",
    "after", "assert", "true", "false", "system",
];

/// A whole text that is a body.
pub(crate) fn parse(piece: Piece<'_>) -> Result<Block, Problem> {
    Parser::whole(piece, sequence)
}

/// Statements up to what no statement begins with.
fn sequence(parser: &mut Parser<'_>) -> Result<Block, Problem> {
    let mut block = Vec::new();
    loop {
        while parser.take(";") {}
        if !matches!(parser.peek(), Token::Word(_)) {
            return Ok(block);
        }
        let start = parser.span();
        let kind = parser.nested(statement)?;
        let has_block = !kind.blocks().is_empty();
        let span = match has_block {
            true => start,
            false => parser.since(&start),
        };
        block.push(Statement { kind, span });
        if !has_block && !parser.is_sign(";") {
            return Ok(block);
        }
    }
}

fn block(parser: &mut Parser<'_>) -> Result<Block, Problem> {
    parser.expect("{")?;
    let inner = sequence(parser)?;
    parser.expect("}")?;
    Ok(inner)
}

/// `{ a | b }`
fn branches(parser: &mut Parser<'_>) -> Result<Vec<Block>, Problem> {
    parser.expect("{")?;
    let mut found = vec![sequence(parser)?];
    while parser.take("|") {
        found.push(sequence(parser)?);
    }
    parser.expect("}")?;
    Ok(found)
}

fn statement(parser: &mut Parser<'_>) -> Result<StatementKind, Problem> {
    let (word, span) = parser.word("write a statement here")?;
    Ok(match word.as_str() {
        "skip" => StatementKind::Skip,
        "stop" => StatementKind::Stop,
        "loop" => StatementKind::Loop(block(parser)?),
        "while" => StatementKind::While(parser.expr()?, block(parser)?),
        "if" => {
            let condition = parser.expr()?;
            let then = block(parser)?;
            let otherwise = if !parser.take_word("else") {
                Vec::new()
            } else if matches!(parser.peek(), Token::Word(word) if word == "if") {
                let span = parser.span();
                let kind = parser.nested(statement)?;
                vec![Statement { kind, span }]
            } else {
                block(parser)?
            };
            StatementKind::If(condition, then, otherwise)
        }
        "for" => {
            let variable = name(parser, "write the name of a variable here")?;
            if !parser.take_word("in") {
                return Err(parser.unexpected("write `in` here: `for k in 0..3 { … }`"));
            }
            let from = parser.expr()?;
            parser.expect("..")?;
            let to = parser.expr()?;
            StatementKind::For(variable, from, to, block(parser)?)
        }
        "par" => StatementKind::Par(branches(parser)?),
        "choose" => StatementKind::Choose(branches(parser)?),
        "assert" => StatementKind::Assert(parser.expr()?),
        "alt" | "pri_alt" => StatementKind::Alternative {
            prioritized: word == "pri_alt",
            guards: guards(parser)?,
        },
        _ if RESERVED.contains(&word.as_str()) => {
            let message = "no statement begins with this word";
            return Err(parser.problem(span, message, "remove it, or use another name"));
        }
        _ if parser.is_sign("!") || parser.is_sign("?") => {
            StatementKind::Offer(offer(parser, (word, span))?)
        }
        _ if parser.take("=") => StatementKind::Assign((word, span), parser.expr()?),
        _ => StatementKind::Action(word),
    })
}

fn name(parser: &mut Parser<'_>, advice: &str) -> Result<Named, Problem> {
    let (word, span) = parser.word(advice)?;
    if RESERVED.contains(&word.as_str()) {
        return Err(parser.problem(span, "this word has a meaning already", "use another name"));
    }
    Ok((word, span))
}

/// `port! expression` or `port? variable`, after the port.
fn offer(parser: &mut Parser<'_>, port: Named) -> Result<Offer, Problem> {
    if parser.take("!") {
        let value = parser.begins_expr().then(|| parser.expr()).transpose()?;
        return Ok(Offer::Send(port, value));
    }
    parser.expect("?")?;
    let is_variable = matches!(parser.peek(), Token::Word(word) if word != "if");
    let variable = is_variable
        .then(|| name(parser, "write the name of a variable here"))
        .transpose()?;
    Ok(Offer::Receive(port, variable))
}

fn guards(parser: &mut Parser<'_>) -> Result<Vec<Guard>, Problem> {
    parser.expect("{")?;
    let mut found = Vec::new();
    loop {
        let start = parser.span();
        let (word, span) =
            parser.word("write a guard here: `port?`, `port!`, `skip` or `after`")?;
        let offered = match word.as_str() {
            "skip" => Offer::Skip,
            "after" => Offer::After,
            _ if RESERVED.contains(&word.as_str()) => {
                let advice = "write a guard here: `port?`, `port!`, `skip` or `after`";
                return Err(parser.problem(span, "no guard begins with this word", advice));
            }
            _ => offer(parser, (word, span))?,
        };
        let condition = parser.take_word("if").then(|| parser.expr()).transpose()?;
        let span = parser.since(&start);
        let body = match parser.take("=>") {
            true => sequence(parser)?,
            false => Vec::new(),
        };
        found.push(Guard {
            offer: offered,
            condition,
            body,
            span,
        });
        if !parser.take("|") {
            break;
        }
    }
    parser.expect("}")?;
    Ok(found)
}
