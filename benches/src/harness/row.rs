//! The figures, and how they are printed.

use serde::{Deserialize, Serialize};

use super::{Case, LUNA, goal::Outcome, median};

/// A line of the table, as in the JSON file.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Row {
    /// The scenario.
    pub name: String,
    /// The measured peer and configuration.
    pub peer: String,
    /// Of the figures.
    pub unit: String,
    /// How large the scenario was, where it comes in sizes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<u64>,
    /// Of the rounds.
    pub median: f64,
    /// Of the rounds.
    pub min: f64,
    /// The number of measured blocks.
    pub samples: usize,
    /// What came of the goals, if there are any.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub goals: Vec<Outcome>,
    /// What each round gave.
    #[serde(skip)]
    pub(super) rounds: Vec<f64>,
}

impl Row {
    pub(super) fn new(case: &Case, rounds: Vec<f64>) -> Self {
        Row {
            name: case.name.to_owned(),
            peer: case.peer.to_owned(),
            unit: case.unit.to_owned(),
            size: case.size,
            median: median(&rounds),
            min: rounds.iter().copied().fold(f64::INFINITY, f64::min),
            samples: rounds.len(),
            goals: Vec::new(),
            rounds,
        }
    }

    /// The row that this one is compared with, in its scenario: LUNA's, or the best if LUNA does
    /// not take part.
    pub fn reference<'a>(&self, scenario: &'a [Row]) -> (&'static str, &'a Row) {
        let alike = || scenario.iter().filter(|row| row.size == self.size);
        if let Some(luna) = alike().find(|row| row.peer.starts_with(LUNA)) {
            return ("÷ LUNA", luna);
        }
        let best = alike().min_by(|one, other| one.median.total_cmp(&other.median));
        ("÷ best", best.expect("the row itself is one of them"))
    }
}

/// The figures of the same scenario, one after the other.
pub fn scenarios(rows: &[Row]) -> impl Iterator<Item = &[Row]> {
    rows.chunk_by(|one, next| one.name == next.name)
}

/// A table per scenario.
pub(super) fn table(rows: &[Row]) -> String {
    let mut text = String::new();
    for scenario in scenarios(rows) {
        let title = format!("{}, {}", scenario[0].name, scenario[0].unit);
        let (label, _) = scenario[0].reference(scenario);
        let peers = scenario.iter().map(|row| row.peer.chars().count());
        let size_width = if scenario[0].size.is_some() { 10 } else { 0 };
        let peer_width = peers.max().unwrap_or_default().max(50 - size_width);
        let title_width = (2 + peer_width + size_width).max(title.chars().count());
        text += &format!(
            "\n{title:<title_width$} {:>10} {:>10} {label:>8}\n",
            "median", "min"
        );
        for row in scenario {
            let ratio = row.median / row.reference(scenario).1.median;
            let size = row.size.map(|size| format!(" {size:>9}"));
            let label = format!("  {:<peer_width$}{}", row.peer, size.unwrap_or_default());
            text += &format!(
                "{label:<title_width$} {:>10.1} {:>10.1} {ratio:>8.2}\n",
                row.median, row.min
            );
        }
    }
    text
}

/// A line per goal; empty without goals.
pub(super) fn goals(rows: &[Row]) -> String {
    let mut text = String::new();
    for row in rows {
        let size = row.size.map(|size| format!(", {size}")).unwrap_or_default();
        for outcome in &row.goals {
            let verdict = if outcome.met { "met" } else { "missed" };
            text += &format!(
                "  {}, {}{size}: {:.1} {}; goal {}: {verdict}, {:.2}",
                row.name, row.peer, row.median, row.unit, outcome.goal, outcome.ratio
            );
            for (primitive, times) in &outcome.primitives {
                text += &format!("; {times:.1} × {primitive}");
            }
            text += "\n";
        }
    }
    if !text.is_empty() {
        text.insert_str(0, "\ngoals (of the reference machine; ratio to the goal)\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn row(name: &'static str, peer: &'static str, median: f64) -> Row {
        let case = Case::new(name, peer, "ns/cycle", |_| Duration::ZERO);
        Row::new(&case, vec![median])
    }

    #[test]
    fn ratio_is_to_luna_else_to_the_best() {
        let both = table(&[row("a", "LUNA", 50.0), row("a", "peer", 20.0)]);
        assert!(
            both.contains("÷ LUNA") && both.contains(" 0.40\n"),
            "{both}"
        );
        let peers = table(&[row("a", "slow", 50.0), row("a", "fast", 20.0)]);
        assert!(
            peers.contains("÷ best") && peers.contains(" 2.50\n"),
            "{peers}"
        );
    }

    #[test]
    fn ratio_is_to_luna_of_the_same_size() {
        let sized = |peer, size, median| Row {
            size: Some(size),
            ..row("a", peer, median)
        };
        let rows = [
            sized("LUNA", 1, 10.0),
            sized("LUNA", 2, 40.0),
            sized("peer", 2, 20.0),
        ];
        assert_eq!(rows[2].reference(&rows).1.median, 40.0);
        assert!(table(&rows).contains(" 0.50\n"));
    }
}
