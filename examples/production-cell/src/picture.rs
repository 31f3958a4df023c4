//! The pictures of the cell, as SVG: a time line of a run, and what the scope moves.

use crate::messages::Condition;
use crate::operator::{Mark, Seen};
use crate::outcome::Outcome;
use crate::parameters::Unit;
use std::fmt::Write;

/// The six units in their circle, for `Settings::picture` of the scope, which moves what is bound to
/// signals in it.
pub const CELL: &str = include_str!("cell.svg");

const WIDTH: f64 = 960.0;
/// Where the rows begin.
const LEFT: f64 = 130.0;
const RIGHT: f64 = 20.0;
const TOP: f64 = 70.0;
const ROW: f64 = 34.0;

/// The kinds of intervals: colour and legend.
const KINDS: [(&str, &str); 7] = [
    ("#2f7d4f", "works"),
    ("#b9dcc6", "waits for a neighbour"),
    ("#e0a100", "halted: the unit ahead failed"),
    ("#2b6cb0", "safe position: the unit behind failed"),
    ("#c53030", "fault"),
    ("#1a202c", "lost"),
    ("#cbd5e0", "stopped"),
];

fn kind(seen: Seen) -> usize {
    match seen.condition {
        Condition::Running if seen.waits => 1,
        Condition::Running => 0,
        Condition::Halted => 2,
        Condition::Safe => 3,
        Condition::Faulty => 4,
        Condition::Lost => 5,
        Condition::Stopped => 6,
    }
}

/// The picture of a run, with this title.
pub fn svg(outcome: &Outcome, title: &str) -> String {
    let bottom = TOP + ROW * 6.0;
    let height = bottom + 110.0;
    let end = outcome.seconds.max(1e-3);
    let x = |at: f64| LEFT + (WIDTH - LEFT - RIGHT) * at.clamp(0.0, end) / end;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" \
         font-family=\"sans-serif\" font-size=\"13\" fill=\"#1a202c\" role=\"img\">\n\
         <title>{title}</title>\n<rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#ffffff\"/>\n\
         <text x=\"{LEFT}\" y=\"24\" font-size=\"16\">{title}</text>\n"
    );
    for (row, unit) in Unit::ALL.into_iter().enumerate() {
        let y = TOP + ROW * row as f64;
        let name = unit.name().replace('-', " ");
        let (at, base) = (LEFT - 10.0, y + 18.0);
        let _ = writeln!(
            svg,
            "<text x=\"{at}\" y=\"{base}\" text-anchor=\"end\">{name}</text>"
        );
        let of_unit = outcome.changes.iter().filter(|change| change.unit == unit);
        let ends = of_unit.clone().skip(1).map(|next| next.at).chain([end]);
        for (change, until) in of_unit.zip(ends) {
            let (from, colour) = (x(change.at), KINDS[kind(change.seen)].0);
            let width = x(until) - from;
            let tall = ROW - 8.0;
            let _ = writeln!(
                svg,
                "<rect x=\"{from:.2}\" y=\"{y}\" width=\"{width:.2}\" height=\"{tall}\" fill=\"{colour}\"/>"
            );
        }
    }
    for Mark { at, what, .. } in &outcome.marks {
        let (x, from, text) = (x(*at), TOP - 12.0, TOP - 18.0);
        let _ = writeln!(
            svg,
            "<path d=\"M{x:.2} {from}V{bottom}\" stroke=\"#1a202c\" stroke-dasharray=\"4 3\"/>\
             <text x=\"{x:.2}\" y=\"{text}\" text-anchor=\"middle\">{what}</text>"
        );
    }
    for second in 0..=end as u32 {
        let (x, y) = (x(second.into()), bottom + 16.0);
        let _ = writeln!(
            svg,
            "<text x=\"{x:.2}\" y=\"{y}\" text-anchor=\"middle\">{second}</text>"
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">s</text>",
        LEFT - 10.0,
        bottom + 16.0
    );
    for (n, (colour, text)) in KINDS.iter().enumerate() {
        let (column, row) = ((n % 3) as f64, (n / 3) as f64);
        let (x, y) = (LEFT + 270.0 * column, bottom + 36.0 + 22.0 * row);
        let (after, base) = (x + 20.0, y + 12.0);
        let _ = writeln!(
            svg,
            "<rect x=\"{x}\" y=\"{y}\" width=\"14\" height=\"14\" fill=\"{colour}\"/>\
             <text x=\"{after}\" y=\"{base}\">{text}</text>"
        );
    }
    svg.push_str("</svg>\n");
    svg
}
