//! What a block surely does: wait, or never end.

use super::kind::Kind;
use super::lets::{Site, of_block, site};
use crate::file::Side;
use crate::language::body::{Block, Kind as Statement, Offer};
use crate::language::expr::{Binary, Expr};

/// The block without statements that do nothing or are never reached.
pub(super) fn reachable(block: &Block) -> Block {
    let mut found = Block::new();
    for statement in block {
        let kind = match &statement.kind {
            Statement::Skip => continue,
            Statement::If(claim, then, otherwise) => {
                Statement::If(claim.clone(), reachable(then), reachable(otherwise))
            }
            Statement::While(claim, inner) => {
                let inner = reachable(inner);
                match diverges(&inner) {
                    // Its turn never ends.
                    true => Statement::If(claim.clone(), inner, Block::new()),
                    false => Statement::While(claim.clone(), inner),
                }
            }
            Statement::Loop(inner) => {
                let inner = reachable(inner);
                if diverges(&inner) {
                    found.extend(inner);
                    break;
                }
                Statement::Loop(inner)
            }
            Statement::For(variable, from, to, inner) => {
                let inner = reachable(inner);
                let is_read = of_block(&inner, &variable.0).reads > 0;
                if diverges(&inner) && !is_read {
                    let ends = (Box::new(from.clone()), Box::new(to.clone()));
                    let claim = Expr::Binary(Binary::Less, ends.0, ends.1);
                    Statement::If(claim, inner, Block::new())
                } else {
                    Statement::For(variable.clone(), from.clone(), to.clone(), inner)
                }
            }
            Statement::Par(blocks) => Statement::Par(blocks.iter().map(reachable).collect()),
            Statement::Choose(blocks) => Statement::Choose(blocks.iter().map(reachable).collect()),
            Statement::Alternative {
                prioritized,
                guards,
            } => {
                let mut guards = guards.clone();
                for guard in &mut guards {
                    guard.body = reachable(&guard.body);
                }
                Statement::Alternative {
                    prioritized: *prioritized,
                    guards,
                }
            }
            other => other.clone(),
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
        Statement::Loop(_) => true,
        Statement::While(claim, _) => {
            matches!(claim, Expr::Number(number) if *number != 0)
        }
        Statement::If(_, then, otherwise) => diverges(then) && diverges(otherwise),
        Statement::Choose(blocks) => blocks.iter().all(|block| diverges(block)),
        Statement::Alternative { guards, .. } => guards.iter().all(|guard| diverges(&guard.body)),
        _ => false,
    })
}

/// Whether each way through the block has an operation that may wait for others.
pub(super) fn surely_waits(block: &Block, kind: &Kind<'_>) -> bool {
    let offer_waits = |offer: &Offer| match offer {
        Offer::Send(port, _) => {
            let mut ports = kind.ports.iter();
            ports.any(|one| one.name == port.0 && one.side == Side::Send && one.waits)
        }
        Offer::Receive(..) | Offer::After => true,
        Offer::Skip => false,
    };
    block.iter().any(|statement| match &statement.kind {
        Statement::Offer(offer) => offer_waits(offer),
        Statement::Stop => true,
        Statement::If(_, then, otherwise) => {
            surely_waits(then, kind) && surely_waits(otherwise, kind)
        }
        Statement::Loop(inner) => surely_waits(inner, kind),
        Statement::Par(blocks) => blocks.iter().any(|block| surely_waits(block, kind)),
        Statement::Choose(blocks) => blocks.iter().all(|block| surely_waits(block, kind)),
        Statement::Alternative { guards, .. } => {
            let mut guards = guards.iter();
            guards.all(|guard| offer_waits(&guard.offer) || surely_waits(&guard.body, kind))
        }
        _ => false,
    })
}

/// The first loop that is in no other.
pub(super) fn first_loop(block: &Block) -> Option<Site> {
    block.iter().find_map(|statement| match &statement.kind {
        Statement::Loop(_) | Statement::While(..) | Statement::For(..) => Some(site(statement)),
        Statement::If(_, then, otherwise) => first_loop(then).or_else(|| first_loop(otherwise)),
        Statement::Par(blocks) | Statement::Choose(blocks) => blocks.iter().find_map(first_loop),
        Statement::Alternative { guards, .. } => {
            guards.iter().find_map(|guard| first_loop(&guard.body))
        }
        _ => None,
    })
}
