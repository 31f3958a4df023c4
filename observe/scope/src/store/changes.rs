//! The last changes of parameters, which are not part of a recording.

use serde_json::{Value, json};
use std::collections::VecDeque;

/// How many are kept: the last ones.
const MAX: usize = 128;

#[derive(Debug, Default)]
pub(super) struct Changes {
    last: VecDeque<Value>,
    /// How many there were in all.
    in_all: u64,
}

impl Changes {
    pub(super) fn put(&mut self, time: u64, name: &str, before: &Value, value: &Value) {
        if self.last.len() == MAX {
            self.last.pop_front();
        }
        self.in_all += 1;
        self.last.push_back(json!({
            "number": self.in_all,
            "time": time.to_string(),
            "name": name,
            "before": before,
            "value": value,
        }));
    }

    /// For the page, numbered from 1 on.
    pub(super) fn json(&self) -> &VecDeque<Value> {
        &self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_are_kept_with_their_numbers() {
        let mut changes = Changes::default();
        for n in 0..=MAX as u64 {
            changes.put(n, "gain", &json!(n), &json!(n + 1));
        }
        let kept = changes.json();
        assert_eq!(kept.len(), MAX);
        assert_eq!(
            (&kept[0]["number"], &kept[0]["time"]),
            (&json!(2), &json!("1"))
        );
        assert_eq!(kept[MAX - 1]["number"], MAX as u64 + 1);
    }
}
