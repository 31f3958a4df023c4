//! What is wrong with a model, for the page.

use crate::model::schedule;
use luna_model::{Limit, Model};
use serde_json::{Value, json};
use std::path::Path;

/// Longer traces are shown to here.
const LONGEST: usize = 1000;

/// The exploration's findings.
pub(super) fn check(model: &Model, max_states: usize) -> Value {
    let explored = model.explore(max_states);
    let findings = explored.findings.iter().map(|finding| {
        let steps = finding.trace.iter().take(LONGEST);
        json!({
            "kind": finding.kind.to_string(),
            "steps": finding.trace.len(),
            "trace": steps.map(ToString::to_string).collect::<Vec<_>>(),
            "there": finding.there,
            "circle": finding.circle,
        })
    });
    let unreached = explored
        .unreached
        .iter()
        .map(|branch| json!({"line": branch.line, "process": branch.process, "what": branch.what}));
    json!({
        "type": "checked",
        "states": explored.states,
        "is_complete": explored.is_complete,
        "is_out_of_memory": matches!(explored.limit, Some(Limit::Memory(_))),
        "findings": findings.collect::<Vec<_>>(),
        "unreached": unreached.collect::<Vec<_>>(),
    })
}

/// Bounds of responses, with what was measured.
pub(super) fn times(model: &Model, costs: Option<&Path>) -> Value {
    match schedule::table(model, costs) {
        Ok(table) => json!({"type": "times", "table": table}),
        Err(failure) => json!({"type": "failed", "error": failure.to_string()}),
    }
}
