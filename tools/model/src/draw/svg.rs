//! SVG: one file without scripts, links or fonts of its own.

use super::layout::{Area, MARGIN, layout};
use super::picture::{arrows, details, short};
use crate::network::Network;
use std::fmt::Write;

const STYLE: &str = "text{font:12px sans-serif;text-anchor:middle;fill:#222}\
.d{font-size:10px;fill:#555}.t{text-anchor:start;font-weight:bold}\
.l{font-size:10px;fill:#345;paint-order:stroke;stroke:#fff;stroke-width:3px}\
.g{fill:none;stroke:#99a;stroke-dasharray:4 3}.p{fill:#eef3fa;stroke:#345}\
.a{fill:none;stroke:#567;marker-end:url(#head)}";

pub(crate) fn svg(network: &Network) -> String {
    let arrows = arrows(network);
    let layout = layout(network, &arrows);
    let all = layout.groups.first().copied().unwrap_or_default();
    let (width, height) = (all.width.ceil(), all.height.ceil());
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\">\n<title>{}</title>\n<style>{STYLE}</style>\n\
         <defs><marker id=\"head\" viewBox=\"0 0 8 8\" refX=\"8\" refY=\"4\" markerWidth=\"7\" \
         markerHeight=\"7\" orient=\"auto\"><path d=\"M0 0L8 4L0 8z\" fill=\"#567\"/></marker>\
         </defs>\n<rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n",
        escaped(&network.name)
    );
    // Writing to a string cannot fail.
    for (group, area) in network.groups.iter().zip(&layout.groups) {
        let (x, y) = (area.x + MARGIN / 2.0, area.y + MARGIN);
        let _ = writeln!(
            text,
            "<rect class=\"g\" {} rx=\"6\"/><text class=\"t\" x=\"{x:.1}\" y=\"{y:.1}\">{}</text>",
            rectangle(area),
            escaped(short(&group.name))
        );
    }
    for (number, (process, area)) in network.processes.iter().zip(&layout.processes).enumerate() {
        let (x, y) = center(area);
        let _ = writeln!(
            text,
            "<g><title>{}</title><rect class=\"p\" {} rx=\"6\"/>\
             <text x=\"{x:.1}\" y=\"{:.1}\">{}</text>\
             <text class=\"d\" x=\"{x:.1}\" y=\"{:.1}\">{}</text></g>",
            escaped(&process.name),
            rectangle(area),
            y - 3.0,
            escaped(short(&process.name)),
            y + 12.0,
            escaped(&details(network, number))
        );
    }
    for arrow in &arrows {
        let (from, to) = (&layout.processes[arrow.from], &layout.processes[arrow.to]);
        let (path, (x, y)) = match arrow.from == arrow.to {
            true => circle(from),
            false => curve(from, to),
        };
        let _ = writeln!(
            text,
            "<path class=\"a\" d=\"{path}\"/><text class=\"l\" x=\"{x:.1}\" y=\"{y:.1}\">{}</text>",
            escaped(&arrow.label)
        );
    }
    text.push_str("</svg>\n");
    text
}

type Point = (f64, f64);

fn center(area: &Area) -> Point {
    (area.x + area.width / 2.0, area.y + area.height / 2.0)
}

/// From edge to edge, bent to its left, so that the arrows of both directions are apart; with the
/// place of the label.
fn curve(from: &Area, to: &Area) -> (String, Point) {
    let (a, b) = (center(from), center(to));
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let length = dx.hypot(dy).max(1.0);
    let bend = (length / 8.0).min(40.0) + 8.0;
    let (x, y) = (
        (a.0 + b.0) / 2.0 + dy / length * bend,
        (a.1 + b.1) / 2.0 - dx / length * bend,
    );
    let (start, end) = (edge(from, (x, y)), edge(to, (x, y)));
    let path = format!(
        "M{:.1} {:.1}Q{x:.1} {y:.1} {:.1} {:.1}",
        start.0, start.1, end.0, end.1
    );
    let middle = |start: f64, control: f64, end: f64| (start + 2.0 * control + end) / 4.0;
    (path, (middle(start.0, x, end.0), middle(start.1, y, end.1)))
}

/// Where the line from the center to a point leaves the rectangle.
fn edge(area: &Area, to: Point) -> Point {
    let (x, y) = center(area);
    let (dx, dy) = (to.0 - x, to.1 - y);
    let by_width = area.width / 2.0 / dx.abs().max(0.001);
    let by_height = area.height / 2.0 / dy.abs().max(0.001);
    let part = by_width.min(by_height).min(1.0);
    (x + dx * part, y + dy * part)
}

/// A process that sends to itself.
fn circle(area: &Area) -> (String, Point) {
    let (x, y) = (area.x + area.width, area.y + area.height / 2.0);
    let (above, below, right) = (y - 8.0, y + 8.0, x + 26.0);
    let path =
        format!("M{x:.1} {above:.1}C{right:.1} {above:.1} {right:.1} {below:.1} {x:.1} {below:.1}");
    (path, (right, y))
}

fn rectangle(area: &Area) -> String {
    let Area {
        x,
        y,
        width,
        height,
    } = area;
    format!("x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\"")
}

/// Control characters may not stand in XML in any form.
pub(super) fn escaped(text: &str) -> String {
    let mut escaped = String::new();
    for letter in text.chars().filter(|letter| !letter.is_control()) {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            _ => escaped.push(letter),
        }
    }
    escaped
}
