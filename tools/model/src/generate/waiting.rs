//! What a block surely does: wait, or never end.

use super::kind::ProcessKind;
use super::lets::{Site, of_block, site};
use crate::file::Side;
use crate::language::body::{Block, Offer, StatementKind};
use crate::language::expr::{Binary, Expr};

/// The block without statements that do nothing or are never reached.
pub(super) fn reachable(block: &Block) -> Block {
    let mut found = Block::new();
    for statement in block {
        let kind = match &statement.kind {
            StatementKind::Skip => continue,
            StatementKind::If(claim, then, otherwise) => {
                StatementKind::If(claim.clone(), reachable(then), reachable(otherwise))
            }
            StatementKind::While(claim, inner) => {
                let inner = reachable(inner);
                match diverges(&inner) {
                    // Its turn never ends.
                    true => StatementKind::If(claim.clone(), inner, Block::new()),
                    false => StatementKind::While(claim.clone(), inner),
                }
            }
            StatementKind::Loop(inner) => {
                let inner = reachable(inner);
                if diverges(&inner) {
                    found.extend(inner);
                    break;
                }
                StatementKind::Loop(inner)
            }
            StatementKind::For(variable, from, to, inner) => {
                let inner = reachable(inner);
                let is_read = of_block(&inner, &variable.0).reads > 0;
                if diverges(&inner) && !is_read {
                    let ends = (Box::new(from.clone()), Box::new(to.clone()));
                    let claim = Expr::Binary(Binary::Less, ends.0, ends.1);
                    StatementKind::If(claim, inner, Block::new())
                } else {
                    StatementKind::For(variable.clone(), from.clone(), to.clone(), inner)
                }
            }
            StatementKind::Par(blocks) => {
                StatementKind::Par(blocks.iter().map(reachable).collect())
            }
            StatementKind::Choose(blocks) => {
                StatementKind::Choose(blocks.iter().map(reachable).collect())
            }
            StatementKind::Alternative {
                prioritized,
                guards,
            } => {
                let mut guards = guards.clone();
                for guard in &mut guards {
                    guard.body = reachable(&guard.body);
                }
                StatementKind::Alternative {
                    prioritized: *prioritized,
                    guards,
                }
            }
            simple @ (StatementKind::Offer(_)
            | StatementKind::Action(_)
            | StatementKind::Stop
            | StatementKind::Assign(..)
            | StatementKind::Assert(_)) => simple.clone(),
        };
        let span = statement.span.clone();
        found.push(crate::language::body::Statement { kind, span });
        if diverges(&found) {
            break;
        }
    }
    found
}

/// Whether what comes behind is never reached, as `rustc` sees it.
pub(super) fn diverges(block: &[crate::language::body::Statement]) -> bool {
    block.iter().any(|statement| match &statement.kind {
        StatementKind::Loop(_) => true,
        StatementKind::While(claim, _) => {
            matches!(claim, Expr::Number(number) if *number != 0)
        }
        StatementKind::If(_, then, otherwise) => diverges(then) && diverges(otherwise),
        StatementKind::Choose(blocks) => blocks.iter().all(|block| diverges(block)),
        StatementKind::Alternative { guards, .. } => {
            guards.iter().all(|guard| diverges(&guard.body))
        }
        StatementKind::Offer(_)
        | StatementKind::Action(_)
        | StatementKind::Skip
        | StatementKind::Stop
        | StatementKind::Assign(..)
        | StatementKind::Assert(_)
        | StatementKind::For(..)
        | StatementKind::Par(_) => false,
    })
}

/// Whether each way through the block has an operation that may wait for others.
pub(super) fn surely_waits(block: &Block, kind: &ProcessKind<'_>) -> bool {
    let offer_waits = |offer: &Offer| match offer {
        Offer::Send(port, _) => {
            let mut ports = kind.ports.iter();
            ports.any(|one| one.name == port.0 && one.side == Side::Send && one.waits)
        }
        Offer::Receive(..) | Offer::After => true,
        Offer::Skip => false,
    };
    block.iter().any(|statement| match &statement.kind {
        StatementKind::Offer(offer) => offer_waits(offer),
        StatementKind::Stop => true,
        StatementKind::If(_, then, otherwise) => {
            surely_waits(then, kind) && surely_waits(otherwise, kind)
        }
        StatementKind::Loop(inner) => surely_waits(inner, kind),
        StatementKind::Par(blocks) => blocks.iter().any(|block| surely_waits(block, kind)),
        StatementKind::Choose(blocks) => blocks.iter().all(|block| surely_waits(block, kind)),
        StatementKind::Alternative { guards, .. } => {
            let mut guards = guards.iter();
            guards.all(|guard| offer_waits(&guard.offer) || surely_waits(&guard.body, kind))
        }
        // The body may be left out.
        StatementKind::While(..) | StatementKind::For(..) => false,
        StatementKind::Action(_)
        | StatementKind::Skip
        | StatementKind::Assign(..)
        | StatementKind::Assert(_) => false,
    })
}

/// The first loop that is in no other.
pub(super) fn first_loop(block: &Block) -> Option<Site> {
    block.iter().find_map(|statement| match &statement.kind {
        StatementKind::Loop(_) | StatementKind::While(..) | StatementKind::For(..) => {
            Some(site(statement))
        }
        other => other.blocks().into_iter().find_map(first_loop),
    })
}
