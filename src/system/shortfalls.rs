//! What a system runs without, on standard error.

use super::plan::Plan;
use crate::notice::notice;
use luna_executors::Executor;
use luna_platform::shortfall::Shortfall;
use std::collections::VecDeque;

/// Reports once what the system runs without.
pub(super) fn announce_shortfalls(
    plan: &Plan,
    of_system: &[Shortfall],
    executors: &VecDeque<(String, Executor)>,
) {
    let members = plan.members();
    let of_executors = executors
        .iter()
        .map(|(name, executor)| (name.as_str(), executor.obtained()));
    let of_threads = members
        .threads
        .iter()
        .map(|(name, thread)| (name.as_str(), thread.obtained()));
    let of_all = of_executors.chain(of_threads).flat_map(|(name, obtained)| {
        obtained
            .into_iter()
            .flat_map(|got| &got.shortfalls)
            .map(move |one| (name, one))
    });
    let all: Vec<_> = of_system
        .iter()
        .map(|one| ("system", one))
        .chain(of_all)
        .collect();
    if all.is_empty() {
        return;
    }
    let what: Vec<String> = all
        .iter()
        .map(|(name, one)| format!("{name}: no {}", one.what()))
        .collect();
    // Several shortfalls often share one reason and remedy.
    let mut reasons: Vec<String> = Vec::new();
    for (_, one) in &all {
        let reason = format!("{}: {}", one.why(), one.remedy());
        if !reasons.contains(&reason) {
            reasons.push(reason);
        }
    }
    notice!(
        "luna: system `{}` runs with best effort, without {} of what it asked for ({}). {}",
        plan.name(),
        all.len(),
        what.join(", "),
        reasons.join(". ")
    );
}
