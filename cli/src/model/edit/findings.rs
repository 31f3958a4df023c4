//! What is wrong with a model, for the page.

use crate::model::found::found;
use crate::model::schedule;
use luna_model::{Limits, Model};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Longer traces are shown to here.
const LONGEST: usize = 1000;

/// How far a check has come.
#[derive(Debug, Default)]
pub(super) struct Progress {
    looked_at: AtomicUsize,
    known: AtomicUsize,
}

impl Progress {
    pub(super) fn shown(&self) -> Value {
        let read = |number: &AtomicUsize| number.load(Ordering::Relaxed);
        json!({"type": "progress", "looked_at": read(&self.looked_at), "known": read(&self.known)})
    }
}

/// What `luna model check` finds, by the model's limit if no other is stated.
pub(super) fn check(model: &Model, max_states: Option<usize>, progress: &Progress) -> Value {
    let limit = max_states.unwrap_or(model.max_states()).max(1);
    let explored = model.explore_within(Limits::of_states(limit), |looked_at, known| {
        progress.looked_at.store(looked_at, Ordering::Relaxed);
        progress.known.store(known, Ordering::Relaxed);
    });
    let mut all = found(model, &explored, LONGEST);
    all["type"] = "checked".into();
    all["ltl"] = model.ltl().collect();
    all
}

/// Bounds of responses, with what was measured.
pub(super) fn times(model: &Model, costs: Option<&Path>) -> Value {
    match schedule::table(model, costs) {
        Ok(table) => json!({"type": "times", "table": table}),
        Err(failure) => json!({"type": "failed", "error": failure.to_string()}),
    }
}
