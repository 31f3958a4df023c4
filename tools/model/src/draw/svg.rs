//! SVG: one file without scripts, links or fonts of its own.

use super::labels::Taken;
use super::layout::{Area, LETTER, MARGIN, layout};
use super::picture::{Arrow, Group, arrows, details, groups, short};
use super::route::{Point, ways};
use crate::network::{Buffering, Network};
use std::fmt::Write;

/// By attributes instead of a style sheet, which the scope's page does not take.
const TEXT: &str = "class=\"texts\" font-family=\"sans-serif\" font-size=\"12\" text-anchor=\"middle\" fill=\"#222\"";
const SMALL: &str = "class=\"small\" font-size=\"10\" fill=\"#555\"";
const LABEL: &str = "class=\"label\" font-size=\"10\" fill=\"#345\" paint-order=\"stroke\" stroke=\"#fff\" \
    stroke-width=\"3\"";

/// The dark theme, where it is asked for. The scope's page leaves it out, and has its own.
const DARK: &str = "<style id=\"dark\">@media (prefers-color-scheme: dark) { \
    .ground { fill: #151a21 } .g { stroke: #6d7888 } .p { fill: #1f2b48; stroke: #86a8ff } \
    .a { stroke: #9aa5b5 } .texts { fill: #e8ebf1 } .small { fill: #9aa5b5 } \
    .label { fill: #c3ccda; stroke: #151a21 } }</style>\n";

/// The drawing. Processes and channels have the attributes by which the scope's page animates them.
pub(crate) fn svg(network: &Network) -> String {
    let arrows = arrows(network);
    let groups = groups(network);
    let layout = layout(network, &groups, &arrows);
    let all = layout.groups.first().copied().unwrap_or_default();
    let (width, height) = (all.width.ceil(), all.height.ceil());
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\">\n<title>{}</title>\n\
         {DARK}<rect class=\"ground\" width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n\
         <g {TEXT}>\n",
        escaped(&network.name)
    );
    // Writing to a string cannot fail.
    for (group, area) in groups.all.iter().zip(&layout.groups) {
        let (x, y) = (area.x + MARGIN / 2.0, area.y + MARGIN);
        let _ = writeln!(
            text,
            "<rect class=\"g\" {} rx=\"6\" fill=\"none\" stroke=\"#99a\" \
             stroke-dasharray=\"4 3\"/><text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"start\" \
             font-weight=\"bold\">{}</text>",
            rectangle(area),
            escaped(group.name)
        );
    }
    for (number, (process, area)) in network.processes.iter().zip(&layout.processes).enumerate() {
        let (x, y) = area.center();
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
    let ways = ways(&layout.processes, &arrows);
    let mut taken = Taken::within(all);
    let titles = groups.all.iter().zip(&layout.groups);
    for area in layout.processes.iter().copied().chain(titles.map(title)) {
        taken.take(area);
    }
    for (arrow, way) in arrows.iter().zip(&ways) {
        let (path, (x, y)) = match way {
            Some(way) => {
                let (points, path) = (way.points(), way.path());
                let tip = points.last().copied().unwrap_or_default();
                let place = taken.place(&arrow.label, &points);
                (path + &head(way.before_end(), tip), place)
            }
            None => circle(&layout.processes[arrow.from]),
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

/// Where a group's name stands.
fn title((group, area): (&Group<'_>, &Area)) -> Area {
    let width = group.name.chars().count() as f64 * LETTER + MARGIN / 2.0;
    Area {
        width,
        height: MARGIN + 6.0,
        ..*area
    }
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

/// The head of an arrow that comes to a point from the direction of another: two strokes, so that
/// it is part of the line.
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
