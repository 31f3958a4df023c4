//! Where a variable of a model is declared in Rust: where it is set first, if nothing before needs
//! it, else at the begin of the body.

use crate::language::body::{Block, Guard, Offer, Statement, StatementKind};
use crate::language::expr::Expr;
use crate::language::parser::Path;
use std::collections::HashMap;
use std::ptr;

/// How often a variable is read and set.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Mentions {
    pub(super) reads: usize,
    pub(super) sets: usize,
}

impl Mentions {
    pub(super) fn any(self) -> bool {
        self != Self::default()
    }
}

/// A statement or guard that declares what it sets, by its address.
pub(super) type Site = usize;

pub(super) fn site<T>(of: &T) -> Site {
    ptr::from_ref(of).addr()
}

/// Declarations that a statement or guard makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Declares {
    /// `let x`
    Once,
    /// `let mut x`
    Mutable,
    /// Nothing reads it: `let _x`
    Unread,
}

/// The sites that declare `name`, or nothing if it is to be declared at the begin.
pub(super) fn declarations(block: &Block, name: &str) -> Option<HashMap<Site, Declares>> {
    let mut found = HashMap::new();
    declare(block, name, &mut found).then_some(found)
}

/// Whether all mentions in the block come behind a declaration.
fn declare(block: &Block, name: &str, found: &mut HashMap<Site, Declares>) -> bool {
    let mut mentioning = block.iter().filter(|one| of_statement(one, name).any());
    let Some(first) = mentioning.next() else {
        return true;
    };
    if sets_at_once(first, name) {
        let rest = mentioning.map(|one| of_statement(one, name));
        return declares(rest, found, site(first));
    }
    if mentioning.next().is_some() {
        return false;
    }
    match &first.kind {
        StatementKind::Offer(_) | StatementKind::Assign(..) | StatementKind::Assert(_) => false,
        StatementKind::If(condition, ..) | StatementKind::While(condition, _)
            if reads(condition, name) =>
        {
            false
        }
        StatementKind::For(_, from, to, _) if reads(from, name) || reads(to, name) => false,
        StatementKind::Alternative { guards, .. } => guards
            .iter()
            .all(|guard| declare_in_guard(guard, name, found)),
        other => other
            .blocks()
            .into_iter()
            .all(|block| declare(block, name, found)),
    }
}

fn declare_in_guard(guard: &Guard, name: &str, found: &mut HashMap<Site, Declares>) -> bool {
    let condition = guard.condition.as_ref();
    if condition.is_some_and(|condition| reads(condition, name)) {
        return false;
    }
    match &guard.offer {
        Offer::Receive(_, Some((variable, _))) if variable == name => {
            let rest = guard.body.iter().map(|one| of_statement(one, name));
            declares(rest, found, site(guard))
        }
        Offer::Send(_, Some(value)) if reads(value, name) => false,
        Offer::Send(..) | Offer::Receive(..) | Offer::Skip | Offer::After => {
            declare(&guard.body, name, found)
        }
    }
}

/// Notes a site, behind which these mentions come.
fn declares(
    rest: impl Iterator<Item = Mentions>,
    found: &mut HashMap<Site, Declares>,
    site: Site,
) -> bool {
    let rest = rest.fold(Mentions::default(), sum);
    let how = match (rest.reads, rest.sets) {
        (0, 0) => Declares::Unread,
        // Nothing reads it, and it is set again.
        (0, _) => return false,
        (_, 0) => Declares::Once,
        _ => Declares::Mutable,
    };
    found.insert(site, how);
    true
}

fn sets_at_once(statement: &Statement, name: &str) -> bool {
    match &statement.kind {
        StatementKind::Assign((variable, _), value) => variable == name && !reads(value, name),
        StatementKind::Offer(offer) => of_offer(offer, name).sets > 0,
        StatementKind::Action(_)
        | StatementKind::Skip
        | StatementKind::Stop
        | StatementKind::Assert(_)
        | StatementKind::If(..)
        | StatementKind::While(..)
        | StatementKind::Loop(_)
        | StatementKind::For(..)
        | StatementKind::Par(_)
        | StatementKind::Choose(_)
        | StatementKind::Alternative { .. } => false,
    }
}

fn sum(one: Mentions, other: Mentions) -> Mentions {
    Mentions {
        reads: one.reads + other.reads,
        sets: one.sets + other.sets,
    }
}

pub(super) fn reads(expr: &Expr<Path>, name: &str) -> bool {
    let mut found = false;
    expr.each(&mut |path| found |= path.word() == Some(name));
    found
}

fn of_expr(expr: &Expr<Path>, name: &str) -> Mentions {
    Mentions {
        reads: usize::from(reads(expr, name)),
        sets: 0,
    }
}

fn of_offer(offer: &Offer, name: &str) -> Mentions {
    match offer {
        Offer::Send(_, Some(value)) => of_expr(value, name),
        Offer::Receive(_, Some((variable, _))) => Mentions {
            reads: 0,
            sets: usize::from(variable == name),
        },
        Offer::Send(_, None) | Offer::Receive(_, None) | Offer::Skip | Offer::After => {
            Mentions::default()
        }
    }
}

/// How often a block reads and sets a variable.
pub(super) fn of_block(block: &Block, name: &str) -> Mentions {
    let each = block.iter().map(|statement| of_statement(statement, name));
    each.fold(Mentions::default(), sum)
}

fn of_statement(statement: &Statement, name: &str) -> Mentions {
    let own = match &statement.kind {
        StatementKind::Offer(offer) => of_offer(offer, name),
        StatementKind::Assign((variable, _), value) => {
            let is_it = variable == name;
            Mentions {
                // `x = x + 1` alone is no use of it.
                reads: usize::from(!is_it && reads(value, name)),
                sets: usize::from(is_it),
            }
        }
        StatementKind::Assert(condition)
        | StatementKind::If(condition, ..)
        | StatementKind::While(condition, _) => of_expr(condition, name),
        StatementKind::For(_, from, to, _) => sum(of_expr(from, name), of_expr(to, name)),
        StatementKind::Alternative { guards, .. } => {
            let conditions = guards.iter().filter_map(|guard| guard.condition.as_ref());
            let conditions = conditions.map(|condition| of_expr(condition, name));
            let offers = guards.iter().map(|guard| of_offer(&guard.offer, name));
            conditions.chain(offers).fold(Mentions::default(), sum)
        }
        StatementKind::Action(_)
        | StatementKind::Skip
        | StatementKind::Stop
        | StatementKind::Loop(_)
        | StatementKind::Par(_)
        | StatementKind::Choose(_) => Mentions::default(),
    };
    let blocks = statement.kind.blocks().into_iter();
    blocks.map(|block| of_block(block, name)).fold(own, sum)
}
