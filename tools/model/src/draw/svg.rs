//! SVG: one file without scripts, links or fonts of its own.

use super::layout::{Area, MARGIN, layout};
use super::picture::{Arrow, arrows, details, short};
use crate::network::{Buffering, Network};
use std::fmt::Write;

/// By attributes instead of a style sheet, which the scope's page does not take.
const TEXT: &str =
    "font-family=\"sans-serif\" font-size=\"12\" text-anchor=\"middle\" fill=\"#222\"";
const SMALL: &str = "font-size=\"10\" fill=\"#555\"";
const LABEL: &str = "font-size=\"10\" fill=\"#345\" paint-order=\"stroke\" stroke=\"#fff\" \
    stroke-width=\"3\"";

/// The drawing. Processes and channels have the attributes by which the scope's page animates them.
pub(crate) fn svg(network: &Network) -> String {
    let arrows = arrows(network);
    let layout = layout(network, &arrows);
    let all = layout.groups.first().copied().unwrap_or_default();
    let (width, height) = (all.width.ceil(), all.height.ceil());
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\">\n<title>{}</title>\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n<g {TEXT}>\n",
        escaped(&network.name)
    );
    // Writing to a string cannot fail.
    for (group, area) in network.groups.iter().zip(&layout.groups) {
        let (x, y) = (area.x + MARGIN / 2.0, area.y + MARGIN);
        let _ = writeln!(
            text,
            "<rect class=\"g\" {} rx=\"6\" fill=\"none\" stroke=\"#99a\" \
             stroke-dasharray=\"4 3\"/><text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"start\" \
             font-weight=\"bold\">{}</text>",
            rectangle(area),
            escaped(short(&group.name))
        );
    }
    for (number, (process, area)) in network.processes.iter().zip(&layout.processes).enumerate() {
        let (x, y) = center(area);
        let name = escaped(&process.name);
        let _ = writeln!(
            text,
            "<g><title>{name}</title><rect class=\"p\" {} rx=\"6\" fill=\"#eef3fa\" \
             stroke=\"#345\" data-process=\"{name}\"/>\
             <text x=\"{x:.1}\" y=\"{:.1}\">{}</text>\
             <text {SMALL} x=\"{x:.1}\" y=\"{:.1}\" data-process=\"{name}\">{}</text></g>",
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
        let channels = channels(network, arrow);
        let _ = writeln!(
            text,
            "<path class=\"a\" d=\"{path}\" fill=\"none\" stroke=\"#567\" {channels}/>\
             <g {LABEL}><text x=\"{x:.1}\" y=\"{y:.1}\">{}</text>\
             <text x=\"{x:.1}\" y=\"{:.1}\" {channels}/></g>",
            escaped(&arrow.label),
            y + 12.0
        );
    }
    text.push_str("</g>\n</svg>\n");
    text
}

/// The attributes of what follows the channels of an arrow: their names, and how much they hold.
fn channels(network: &Network, arrow: &Arrow) -> String {
    let channels = || {
        arrow
            .channels
            .iter()
            .map(|&number| &network.channels[number])
    };
    let names: Vec<&str> = channels().map(|channel| &*channel.name).collect();
    // Of an overwriting buffer it is not recorded whether a value took the place of another.
    let rooms = channels().map(|channel| match channel.kind {
        Buffering::Fifo(n) => n.to_string(),
        _ => "0".to_owned(),
    });
    let rooms: Vec<String> = rooms.collect();
    let names = escaped(&names.join("; "));
    match rooms.iter().all(|room| room == "0") {
        true => format!("data-channel=\"{names}\""),
        false => format!(
            "data-channel=\"{names}\" data-fifo=\"{}\"",
            rooms.join("; ")
        ),
    }
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
        "M{:.1} {:.1}Q{x:.1} {y:.1} {:.1} {:.1}{}",
        start.0,
        start.1,
        end.0,
        end.1,
        head((x, y), end)
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
    let path = format!(
        "M{x:.1} {above:.1}C{right:.1} {above:.1} {right:.1} {below:.1} {x:.1} {below:.1}{}",
        head((right, below), (x, below))
    );
    (path, (right, y))
}

/// The head of an arrow that comes to a point from the direction of another: two strokes, so that it
/// is part of the line.
fn head(from: Point, tip: Point) -> String {
    const LENGTH: f64 = 7.0;
    let (dx, dy) = (from.0 - tip.0, from.1 - tip.1);
    let length = dx.hypot(dy).max(0.001);
    let (dx, dy) = (dx / length * LENGTH, dy / length * LENGTH);
    let (left, right) = (
        (tip.0 + dx - dy / 2.0, tip.1 + dy + dx / 2.0),
        (tip.0 + dx + dy / 2.0, tip.1 + dy - dx / 2.0),
    );
    format!(
        "M{:.1} {:.1}L{:.1} {:.1}L{:.1} {:.1}",
        left.0, left.1, tip.0, tip.1, right.0, right.1
    )
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
