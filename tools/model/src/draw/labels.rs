//! Where the texts of lines stand: on their lines, apart from boxes and from each other.

use super::layout::Area;
use super::route::Point;
use std::collections::HashMap;

/// Of a letter of a label.
const LETTER: f64 = 5.9;
/// From a label's base line to its top, and to the end of the line of figures below it.
const ABOVE: f64 = 9.0;
const BELOW: f64 = 15.0;
/// The side of a cell in which what may be in the way is looked up.
const CELL: f64 = 160.0;
/// How far from its middle a way is tried, and in how many steps to each side.
const FURTHEST: f64 = 0.42;
const STEPS: u32 = 10;

/// What is in the way of labels.
#[derive(Debug)]
pub(super) struct Taken {
    /// All that is drawn lies in it.
    frame: Area,
    areas: Vec<Area>,
    cells: HashMap<(i64, i64), Vec<usize>>,
}

impl Taken {
    pub(super) fn within(frame: Area) -> Self {
        Self {
            frame,
            areas: Vec::new(),
            cells: HashMap::new(),
        }
    }

    /// Nothing may stand there from now on.
    pub(super) fn take(&mut self, area: Area) {
        for cell in cells(&area) {
            self.cells.entry(cell).or_default().push(self.areas.len());
        }
        self.areas.push(area);
    }

    /// How much of an area is taken, or outside.
    fn covered(&self, area: &Area) -> f64 {
        let near = cells(area).filter_map(|cell| self.cells.get(&cell));
        let parts = near.flatten().map(|&one| common(&self.areas[one], area));
        let outside = area.width * area.height - common(&self.frame, area);
        parts.sum::<f64>() + outside.max(0.0)
    }

    /// The middle of the base line of a text on a way. It is taken then.
    pub(super) fn place(&mut self, text: &str, way: &[Point]) -> Point {
        let width = text.chars().count() as f64 * LETTER + 6.0;
        let area = |(x, y): Point| Area {
            x: x - width / 2.0,
            y: y - ABOVE,
            width,
            height: ABOVE + BELOW,
        };
        let beside = [0.0, width / 2.0 + 5.0, -width / 2.0 - 5.0];
        let places = beside.iter().flat_map(|by| {
            (0..=2 * STEPS).map(move |step| {
                // The middle, and then to both sides by turns.
                let away = FURTHEST * f64::from(step.div_ceil(2)) / f64::from(STEPS);
                let share = if step % 2 == 0 {
                    0.5 + away
                } else {
                    0.5 - away
                };
                let (x, y) = at(way, share);
                (x + by, y)
            })
        });
        let mut best = (f64::INFINITY, at(way, 0.5));
        for place in places {
            let covered = self.covered(&area(place));
            if covered < best.0 {
                best = (covered, place);
            }
            if covered < 0.01 {
                break;
            }
        }
        self.take(area(best.1));
        best.1
    }
}

fn cells(area: &Area) -> impl Iterator<Item = (i64, i64)> + use<> {
    let cell = |at: f64| (at / CELL).floor() as i64;
    let (from, to) = (cell(area.y), cell(area.y + area.height));
    let (left, right) = (cell(area.x), cell(area.x + area.width));
    (left..=right).flat_map(move |x| (from..=to).map(move |y| (x, y)))
}

fn common(a: &Area, b: &Area) -> f64 {
    let width = (a.x + a.width).min(b.x + b.width) - a.x.max(b.x);
    let height = (a.y + a.height).min(b.y + b.height) - a.y.max(b.y);
    width.max(0.0) * height.max(0.0)
}

/// The point at a share of a way.
fn at(way: &[Point], share: f64) -> Point {
    let lengths = way
        .windows(2)
        .map(|two| (two[1].0 - two[0].0).hypot(two[1].1 - two[0].1));
    let lengths: Vec<f64> = lengths.collect();
    let mut rest = lengths.iter().sum::<f64>() * share;
    for (two, length) in way.windows(2).zip(lengths) {
        if rest <= length {
            let part = rest / length.max(0.001);
            let ((x1, y1), (x2, y2)) = (two[0], two[1]);
            return (x1 + (x2 - x1) * part, y1 + (y2 - y1) * part);
        }
        rest -= length;
    }
    way.last().copied().unwrap_or_default()
}
