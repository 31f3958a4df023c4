//! Plots as SVG: dots on a logarithmic scale, and lines of cost over size. They follow the reader's
//! choice of light or dark.
//!
//! Dots instead of bars: a logarithmic scale has no zero, so the length of a bar would depend on
//! where the scale begins.

use std::fmt::Write as _;

/// A dot: what it stands for, its figure, and whether it is one of ours.
#[derive(Debug)]
pub(super) struct Dot {
    pub(super) label: String,
    pub(super) figure: f64,
    pub(super) ours: bool,
}

/// A line: its label, its points, and whether it is one of ours.
#[derive(Debug)]
pub(super) struct Line {
    pub(super) label: String,
    pub(super) points: Vec<(f64, f64)>,
    pub(super) ours: bool,
}

const WIDTH: f64 = 760.0;
const FONT: f64 = 13.0;

/// Colours of the peers' lines and points, in light and in dark; ours have one of their own.
const COLOURS: [(&str, &str); 8] = [
    ("#0969da", "#58a6ff"),
    ("#8250df", "#bc8cff"),
    ("#1a7f37", "#3fb950"),
    ("#9a6700", "#d29922"),
    ("#0f766e", "#39c5cf"),
    ("#bf3989", "#f778ba"),
    ("#57606a", "#8b949e"),
    ("#6f4e37", "#c9a27e"),
];
const OURS: (&str, &str) = ("#cf222e", "#ff7b72");

/// A text of at most three digits and a prefix for the power.
pub(super) fn short(figure: f64) -> String {
    let (scaled, suffix) = match figure {
        figure if figure >= 1e9 => (figure / 1e9, " G"),
        figure if figure >= 1e6 => (figure / 1e6, " M"),
        figure if figure >= 1e4 => (figure / 1e3, " k"),
        figure => (figure, ""),
    };
    let digits = match scaled {
        scaled if scaled >= 100.0 || scaled == scaled.round() => 0,
        scaled if scaled >= 10.0 => 1,
        _ => 2,
    };
    format!("{scaled:.digits$}{suffix}")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

/// The powers of ten around some figures.
fn decades(figures: impl Iterator<Item = f64>) -> (i32, i32) {
    let (least, most) = figures.filter(|figure| *figure > 0.0).fold(
        (f64::INFINITY, f64::NEG_INFINITY),
        |(least, most), figure| (least.min(figure), most.max(figure)),
    );
    if least > most {
        return (0, 1);
    }
    let low = least.log10().floor() as i32;
    (low, (most.log10().ceil() as i32).max(low + 1))
}

fn begin(height: f64, title: &str) -> String {
    let mut style = format!(
        "text{{font:{FONT}px system-ui,sans-serif;fill:#1f2328}}\
         .back{{fill:#ffffff}}.grid{{stroke:#d0d7de}}.faint{{fill:#59636e}}\
         .ours{{fill:{0};stroke:{0}}}.title{{font-weight:600}}.over{{stroke:#ffffff;stroke-width:4;paint-order:stroke}}",
        OURS.0
    );
    let mut dark = format!(
        "text{{fill:#e6edf3}}.back{{fill:#0d1117}}.grid{{stroke:#30363d}}.faint{{fill:#9198a1}}\
         .ours{{fill:{0};stroke:{0}}}.over{{stroke:#0d1117}}",
        OURS.1
    );
    for (number, (on_light, on_dark)) in COLOURS.iter().enumerate() {
        let _ = write!(style, ".c{number}{{fill:{on_light};stroke:{on_light}}}");
        let _ = write!(dark, ".c{number}{{fill:{on_dark};stroke:{on_dark}}}");
    }
    // A line has no inside, and a text no outline.
    let last = "polyline{fill:none!important;stroke-width:1.6}.wide{stroke-width:3}text:not(.over){stroke:none!important}";
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" role=\"img\">\n\
         <title>{0}</title>\n\
         <style>{style}{last}@media(prefers-color-scheme:dark){{{dark}}}</style>\n\
         <rect class=\"back\" width=\"{WIDTH}\" height=\"{height}\" rx=\"6\"/>\n\
         <text class=\"title\" x=\"16\" y=\"24\">{0}</text>\n",
        escaped(title)
    )
}

fn text(svg: &mut String, class: &str, anchor: &str, x: f64, y: f64, text: &str) {
    let _ = writeln!(
        svg,
        "<text class=\"{class}\" text-anchor=\"{anchor}\" x=\"{x:.1}\" y=\"{y:.1}\">{}</text>",
        escaped(text)
    );
}

fn line(svg: &mut String, from: (f64, f64), to: (f64, f64)) {
    let _ = writeln!(
        svg,
        "<line class=\"grid\" x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\"/>",
        from.0, from.1, to.0, to.1
    );
}

/// A row with a dot each, in the order given; the scale is logarithmic, from one power of ten to
/// another.
pub(super) fn dots(title: &str, unit: &str, dots: &[Dot]) -> String {
    const LEFT: f64 = 330.0;
    const RIGHT: f64 = WIDTH - 90.0;
    const TOP: f64 = 42.0;
    const STEP: f64 = 24.0;
    const RADIUS: f64 = 5.0;
    let bottom = TOP + STEP * dots.len() as f64;
    let (low, high) = decades(dots.iter().map(|dot| dot.figure));
    let place = |figure: f64| {
        let share = (figure.log10() - f64::from(low)) / f64::from(high - low);
        LEFT + (RIGHT - LEFT) * share.max(0.0)
    };

    let mut svg = begin(bottom + 48.0, title);
    for power in low..=high {
        let x = place(10_f64.powi(power));
        line(&mut svg, (x, TOP), (x, bottom));
        let tick = short(10_f64.powi(power));
        text(&mut svg, "faint", "middle", x, bottom + 16.0, &tick);
    }
    let middle = (LEFT + RIGHT) / 2.0;
    let scale = format!("{unit}, logarithmic; less is better");
    text(&mut svg, "faint", "middle", middle, bottom + 36.0, &scale);
    for (index, dot) in dots.iter().enumerate() {
        let y = TOP + STEP * (index as f64 + 0.5);
        let x = place(dot.figure);
        let class = if dot.ours { "ours" } else { "c6" };
        // Across the whole scale, so that it is no bar either.
        line(&mut svg, (LEFT, y), (RIGHT, y));
        let _ = writeln!(
            svg,
            "<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{RADIUS}\"/>"
        );
        let baseline = y + FONT / 3.0;
        text(&mut svg, "", "end", LEFT - 8.0, baseline, &dot.label);
        let figure = short(dot.figure);
        let beside = x + RADIUS + 4.0;
        text(&mut svg, "over", "start", beside, baseline, &figure);
    }
    svg + "</svg>\n"
}

/// A line each, over the size; both scales are logarithmic.
pub(super) fn lines(title: &str, unit: &str, lines: &[Line]) -> String {
    const LEFT: f64 = 70.0;
    const RIGHT: f64 = WIDTH - 24.0;
    const TOP: f64 = 42.0;
    const BOTTOM: f64 = 330.0;
    const ROW: f64 = 20.0;
    let points = || lines.iter().flat_map(|line| line.points.iter().copied());
    let (low, high) = decades(points().map(|(_, figure)| figure));
    // A size of 0 has no logarithm: it is drawn at 1.
    let size = |size: f64| size.max(1.0);
    let (first, last) = decades(points().map(|(of, _)| size(of)));
    let x = |of: f64| {
        let share = (size(of).log10() - f64::from(first)) / f64::from(last - first);
        LEFT + (RIGHT - LEFT) * share
    };
    let y = |figure: f64| {
        let share = (figure.log10() - f64::from(low)) / f64::from(high - low);
        BOTTOM - (BOTTOM - TOP) * share.max(0.0)
    };

    let legend = BOTTOM + 64.0;
    // Two columns, if there is room for the longest name.
    let longest = lines.iter().map(|line| line.label.chars().count()).max();
    let columns = if longest.unwrap_or_default() > 44 {
        1
    } else {
        2
    };
    let rows = lines.len().div_ceil(columns) as f64;
    let mut svg = begin(legend + ROW * rows, title);
    for power in low..=high {
        let at = y(10_f64.powi(power));
        line(&mut svg, (LEFT, at), (RIGHT, at));
        let tick = short(10_f64.powi(power));
        text(&mut svg, "faint", "end", LEFT - 8.0, at + FONT / 3.0, &tick);
    }
    for power in first..=last {
        let at = x(10_f64.powi(power));
        line(&mut svg, (at, TOP), (at, BOTTOM));
        let tick = short(10_f64.powi(power));
        text(&mut svg, "faint", "middle", at, BOTTOM + 18.0, &tick);
    }
    let middle = (LEFT + RIGHT) / 2.0;
    let scale = format!("{unit} over the size, both logarithmic; less is better");
    text(&mut svg, "faint", "middle", middle, BOTTOM + 40.0, &scale);
    let mut others = 0;
    for (index, series) in lines.iter().enumerate() {
        let class = if series.ours && index == 0 {
            "ours".to_owned()
        } else {
            others += 1;
            format!("c{}", (others - 1) % COLOURS.len())
        };
        let wide = if series.ours { " wide" } else { "" };
        let mut path = String::new();
        for &(of, figure) in &series.points {
            let _ = write!(path, "{:.1},{:.1} ", x(of), y(figure));
            let _ = writeln!(
                svg,
                "<circle class=\"{class}\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\"/>",
                x(of),
                y(figure)
            );
        }
        let _ = writeln!(
            svg,
            "<polyline class=\"{class}{wide}\" points=\"{}\"/>",
            path.trim_end()
        );
        let column = 16.0 + (index % columns) as f64 * (WIDTH - 32.0) / 2.0;
        let row = legend + ROW * (index / columns) as f64;
        let _ = writeln!(
            svg,
            "<rect class=\"{class}\" x=\"{column:.1}\" y=\"{:.1}\" width=\"14\" height=\"4\"/>",
            row - 6.0
        );
        text(&mut svg, "", "start", column + 20.0, row, &series.label);
    }
    svg + "</svg>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_short() {
        let texts = [0.25, 7.0, 9.96, 47.25, 214.6, 12_345.0, 2e6, 3.2e9].map(short);
        let expected = [
            "0.25", "7", "9.96", "47.2", "215", "12.3 k", "2 M", "3.20 G",
        ];
        assert_eq!(texts, expected);
    }

    #[test]
    fn decades_surround() {
        assert_eq!(decades([3.0, 450.0].into_iter()), (0, 3));
        assert_eq!(decades([10.0].into_iter()), (1, 2));
        assert_eq!(decades([0.0].into_iter()), (0, 1));
    }

    #[test]
    fn a_dot_stands_where_its_figure_is_on_the_scale() {
        let dot = |label: &str, figure| Dot {
            label: label.to_owned(),
            figure,
            ours: false,
        };
        let all = [
            dot("one", 10.0),
            dot("middle", 100.0),
            dot("other", 1_000.0),
        ];
        let svg = dots("a <b>", "ns", &all);
        assert!(svg.contains("a &lt;b&gt;"), "{svg}");
        let places = |begin: &str| -> Vec<f64> {
            svg.lines()
                .filter_map(|line| {
                    let (place, _) = line.strip_prefix(begin)?.split_once('"')?;
                    place.parse().ok()
                })
                .collect()
        };
        // Two decades, which begin, meet and end at ticks.
        let ticks = places("<text class=\"faint\" text-anchor=\"middle\" x=\"");
        assert_eq!(places("<circle class=\"c6\" cx=\""), ticks[..3]);
        // The background is all that is filled beside them: nothing has a length.
        assert_eq!(svg.matches("<rect").count(), 1, "{svg}");
    }
}
