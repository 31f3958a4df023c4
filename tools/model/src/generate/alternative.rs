//! `alt!` and `pri_alt!`.

use super::body::Body;
use super::lets::site;
use super::writer::Writer;
use crate::language::body::{Guard, Offer};
use crate::text::Problem;

/// What the library takes.
const GUARDS: usize = 32;

pub(super) fn write(
    body: &mut Body<'_>,
    prioritized: bool,
    guards: &[Guard],
    out: &mut Writer,
) -> Result<(), Problem> {
    if let Some(too_many) = guards.get(GUARDS) {
        let message = format!("an alternative of LUNA has {GUARDS} guards at most");
        let advice = "use several processes, or channels that are shared";
        let span = too_many.span.clone();
        return Err(body.model.source().problem(span, message, advice));
    }
    let (skips, others): (Vec<&Guard>, Vec<&Guard>) =
        guards.iter().partition(|guard| guard.offer == Offer::Skip);
    // The macro's `skip` has no precondition. What is due now, behind all others, is the same.
    let is_plain = matches!(
        &skips[..],
        [] | [Guard {
            condition: None,
            ..
        }]
    ) && !others.is_empty();
    let name = if prioritized || !is_plain {
        body.uses.pri_alt = true;
        "pri_alt"
    } else {
        body.uses.alt = true;
        "alt"
    };
    out.open(format!("{name}! {{"));
    for guard in others.iter().chain(&skips) {
        let is_skip = guard.offer == Offer::Skip;
        let waits_for = match &guard.offer {
            Offer::Skip if is_plain => "skip".to_owned(),
            Offer::Skip => "_ = luna::after(std::time::Duration::ZERO)".to_owned(),
            Offer::After => format!("_ = {}", body.operation(&guard.offer)?),
            offer => format!("outcome = {}", body.operation(offer)?),
        };
        let condition = guard.condition.as_ref();
        let condition = condition.map(|claim| format!(", if {}", body.condition(claim)));
        let head = format!("{waits_for}{}", condition.unwrap_or_default());
        let has_outcome = !is_skip && guard.offer != Offer::After;
        if !has_outcome && guard.body.is_empty() {
            out.line(format!("{head} => {{}}"));
            continue;
        }
        out.open(format!("{head} => {{"));
        if has_outcome {
            let taken = body.take(&guard.offer, site::<Guard>(guard), "outcome")?;
            out.line(taken);
        }
        body.block(&guard.body, out)?;
        out.close("}");
    }
    out.close("}");
    Ok(())
}
