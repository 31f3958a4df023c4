//! What happens up to a finding, as a chart of messages: a column for each process, and time goes
//! down.

use super::svg::escaped;
use crate::explore::{Finding, StepParts, TraceStep};
use indexmap::IndexMap;
use std::fmt::Write;

const STYLE: &str = "text{font:11px sans-serif;fill:#222}.n{font-weight:bold;text-anchor:middle}\
.m{text-anchor:middle;paint-order:stroke;stroke:#fff;stroke-width:3px}.s{fill:#777}\
.l{stroke:#99a;stroke-dasharray:3 3}.a{stroke:#345;marker-end:url(#head)}.d{fill:#345}";

/// Between two steps.
const ROW: usize = 24;
const TOP: usize = 40;
const MARGIN: usize = 12;
/// Wide enough for a letter of the style.
const LETTER: usize = 7;

pub(crate) fn sequence(finding: &Finding) -> String {
    let columns = columns(&finding.trace);
    let step = spacing(&finding.trace, &columns);
    // The first column has room for the numbers of the steps before it.
    let left = MARGIN + 3 * LETTER + step / 2;
    let at = |name: &str| left + columns.get(name).copied().unwrap_or_default() * step;
    let bottom = TOP + finding.trace.len() * ROW + ROW / 2;
    let longest = finding.there.iter().map(|line| line.chars().count()).max();
    let chart = left + columns.len() * step;
    let width = chart.max(longest.unwrap_or_default() * LETTER) + MARGIN;
    let height = bottom + (finding.there.len() + 1) * ROW * 3 / 4 + MARGIN;
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\">\n<title>{} after {} steps</title>\n\
         <style>{STYLE}</style>\n<defs><marker id=\"head\" viewBox=\"0 0 8 8\" refX=\"8\" \
         refY=\"4\" markerWidth=\"7\" markerHeight=\"7\" orient=\"auto\">\
         <path d=\"M0 0L8 4L0 8z\" fill=\"#345\"/></marker></defs>\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n",
        escaped(&finding.kind.to_string()),
        finding.trace.len(),
    );
    // Writing to a string cannot fail.
    for name in columns.keys() {
        let x = at(name);
        let _ = writeln!(
            text,
            "<line class=\"l\" x1=\"{x}\" y1=\"{}\" x2=\"{x}\" y2=\"{bottom}\"/>\
             <text class=\"n\" x=\"{x}\" y=\"{}\">{}</text>",
            TOP - ROW / 2,
            TOP - ROW,
            escaped(name)
        );
    }
    for (number, what) in finding.trace.iter().enumerate() {
        let y = TOP + number * ROW + ROW / 2;
        let _ = writeln!(
            text,
            "<text class=\"s\" x=\"{MARGIN}\" y=\"{}\">{}</text>{}",
            y + 4,
            number + 1,
            drawn(what, y, step, at)
        );
    }
    for (number, line) in finding.there.iter().enumerate() {
        let y = bottom + (number + 1) * ROW * 3 / 4 + ROW / 4;
        let line = escaped(line);
        let _ = writeln!(text, "<text x=\"{MARGIN}\" y=\"{y}\">{line}</text>");
    }
    text.push_str("</svg>\n");
    text
}

/// The processes in the order in which they first do something.
fn columns(trace: &[TraceStep]) -> IndexMap<&str, usize> {
    let mut columns = IndexMap::new();
    let names = trace.iter().flat_map(|step| match &step.parts {
        StepParts::Communication {
            sender, receiver, ..
        } => [sender.as_deref(), receiver.as_deref()],
        StepParts::Act { process, .. } => [Some(process.as_str()), None],
        StepParts::Note => [None, None],
    });
    for name in names.flatten() {
        let next = columns.len();
        columns.entry(name).or_insert(next);
    }
    columns
}

/// From column to column: so that each name, and what stands between two, has room.
fn spacing(trace: &[TraceStep], columns: &IndexMap<&str, usize>) -> usize {
    let names = columns.keys().map(|name| name.chars().count());
    let labels = trace.iter().map(|step| match &step.parts {
        StepParts::Communication { what, .. } | StepParts::Act { what, .. } => {
            what.chars().count() + 2
        }
        StepParts::Note => 0,
    });
    let longest = names.chain(labels).max().unwrap_or_default();
    longest * LETTER + 2 * MARGIN
}

/// One step at its height: a message, an arrow to or from a buffer, or a dot.
fn drawn(step: &TraceStep, y: usize, width: usize, at: impl Fn(&str) -> usize) -> String {
    let arrow = |from: usize, to: usize, what: &str| {
        let (label, above, what) = (from.midpoint(to), y - 4, escaped(what));
        format!(
            "<line class=\"a\" x1=\"{from}\" y1=\"{y}\" x2=\"{to}\" y2=\"{y}\"/>\
             <text class=\"m\" x=\"{label}\" y=\"{above}\">{what}</text>"
        )
    };
    let words = |x: usize, words: &str| {
        let (below, words) = (y + 4, escaped(words));
        format!("<text x=\"{x}\" y=\"{below}\">{words}</text>")
    };
    // Half of the way to the next column is free.
    let beside = width / 2 - MARGIN / 2;
    match &step.parts {
        StepParts::Communication {
            sender,
            receiver,
            what,
        } => match (sender.as_deref().map(&at), receiver.as_deref().map(&at)) {
            (Some(from), Some(to)) => arrow(from, to, what),
            (Some(from), None) => arrow(from, from + beside, what),
            (None, Some(to)) => arrow(to - beside, to, what),
            (None, None) => String::new(),
        },
        StepParts::Act { process, what } => {
            let x = at(process);
            let dot = format!("<circle class=\"d\" cx=\"{x}\" cy=\"{y}\" r=\"4\"/>");
            dot + &words(x + 8, what)
        }
        StepParts::Note => words(MARGIN + 4 * LETTER, &step.text),
    }
}
