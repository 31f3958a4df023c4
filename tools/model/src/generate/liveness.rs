//! Whether `rustc` would warn that a value is set and never read: models set such values, for
//! their properties or for the next turn of a loop that does not come.

use crate::language::body::{Block, Offer, Statement, StatementKind};
use crate::language::expr::Expr;
use crate::language::parser::Path;
use std::collections::BTreeSet;

/// The names of values that may still be read.
type Live = BTreeSet<String>;

/// Those that are read before they are set, and those that are set to what nothing reads.
pub(super) fn live_at_start(block: &Block) -> (Live, Live) {
    let mut dead = Live::new();
    let live = of_block(block, Live::new(), &mut dead);
    (live, dead)
}

fn read(live: &mut Live, expr: &Expr<Path>) {
    expr.each(&mut |path| live.extend(path.word().map(str::to_owned)));
}

fn set(live: &mut Live, name: &str, dead: &mut Live) {
    if !live.remove(name) {
        dead.insert(name.to_owned());
    }
}

fn of_block(block: &Block, after: Live, dead: &mut Live) -> Live {
    let mut live = after;
    for statement in block.iter().rev() {
        live = of_statement(statement, live, dead);
    }
    live
}

fn of_offer(offer: &Offer, live: &mut Live, dead: &mut Live) {
    match offer {
        Offer::Send(_, Some(value)) => read(live, value),
        Offer::Receive(_, Some((name, _))) => set(live, name, dead),
        Offer::Send(_, None) | Offer::Receive(_, None) | Offer::Skip | Offer::After => {}
    }
}

fn of_statement(statement: &Statement, after: Live, dead: &mut Live) -> Live {
    let mut live = after.clone();
    match &statement.kind {
        StatementKind::Action(_) | StatementKind::Skip | StatementKind::Stop => {}
        StatementKind::Offer(offer) => of_offer(offer, &mut live, dead),
        StatementKind::Assign((name, _), value) => {
            set(&mut live, name, dead);
            // What `x += 1` reads is no use of `x` to `rustc`.
            read(&mut live, value);
            if !after.contains(name) {
                live.remove(name);
            }
        }
        StatementKind::Assert(condition) => read(&mut live, condition),
        StatementKind::If(condition, then, otherwise) => {
            live = of_block(then, after.clone(), dead);
            live.extend(of_block(otherwise, after, dead));
            read(&mut live, condition);
        }
        StatementKind::While(condition, inner) => {
            read(&mut live, condition);
            live = repeated(inner, live, dead);
        }
        StatementKind::Loop(inner) => live = repeated(inner, Live::new(), dead),
        StatementKind::For(_, from, to, inner) => {
            live = repeated(inner, live, dead);
            read(&mut live, from);
            read(&mut live, to);
        }
        StatementKind::Par(blocks) => {
            // A branch borrows what it sets: that counts as read.
            let mut ignored = Live::new();
            let mut all = after.clone();
            for block in blocks {
                all.extend(of_block(block, after.clone(), &mut ignored));
            }
            live = all;
        }
        StatementKind::Choose(blocks) => {
            live = Live::new();
            for block in blocks {
                live.extend(of_block(block, after.clone(), dead));
            }
        }
        StatementKind::Alternative { guards, .. } => {
            live = Live::new();
            for guard in guards {
                let mut one = of_block(&guard.body, after.clone(), dead);
                of_offer(&guard.offer, &mut one, dead);
                live.extend(one);
            }
            for condition in guards.iter().filter_map(|guard| guard.condition.as_ref()) {
                read(&mut live, condition);
            }
        }
    }
    live
}

/// At the head of a loop, which goes on with `after` or once more.
fn repeated(inner: &Block, after: Live, dead: &mut Live) -> Live {
    let mut head = after;
    loop {
        let mut ignored = Live::new();
        let once_more = of_block(inner, head.clone(), &mut ignored);
        if once_more.is_subset(&head) {
            of_block(inner, head.clone(), dead);
            return head;
        }
        head.extend(once_more);
    }
}
