//! What an exploration has found, as JSON: of `luna model check --json` and of the editor's page.

use luna_model::{Exploration, Finding, Limit, Model, TraceStep};
use serde_json::{Value, json};

/// All of it, with at most so many steps of each way.
pub(super) fn found(model: &Model, explored: &Exploration, longest: usize) -> Value {
    let findings = explored.findings.iter().map(|one| finding(one, longest));
    let unreached = explored
        .unreached
        .iter()
        .map(|branch| json!({"line": branch.line, "process": branch.process, "what": branch.what}));
    let (limit, bytes) = match explored.limit {
        None => (None, None),
        Some(Limit::Memory(bytes)) => (Some("memory"), Some(bytes)),
        Some(_) => (Some("states"), None),
    };
    let stuck = explored.stuck.as_ref().map(|stuck| {
        json!({
            "processes": stuck.processes,
            "steps": stuck.trace.len(),
            "trace": steps(&stuck.trace, longest),
            "there": stuck.there,
        })
    });
    json!({
        "model": model.name(),
        "processes": model.processes(),
        "channels": model.channels(),
        "states": explored.states,
        "is_complete": explored.is_complete,
        // Which limit has cut it: `states`, or `memory` with the bytes.
        "limit": limit,
        "limit_bytes": bytes,
        "findings": findings.collect::<Vec<_>>(),
        "unreached": unreached.collect::<Vec<_>>(),
        "stuck": stuck,
    })
}

/// One thing that is wrong.
pub(super) fn finding(finding: &Finding, longest: usize) -> Value {
    json!({
        "kind": finding.kind.to_string(),
        "steps": finding.trace.len(),
        "trace": steps(&finding.trace, longest),
        "there": finding.there,
        "circle": finding.circle,
    })
}

fn steps(trace: &[TraceStep], longest: usize) -> Vec<String> {
    let steps = trace.iter().take(longest);
    steps.map(ToString::to_string).collect()
}
