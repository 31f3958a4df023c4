//! Where lines go: from side to side of the boxes, around those in between.
//!
//! The ends of the arrows at a side of a box are apart, in the order of their other ends. A line is
//! a curve if that meets no box. Otherwise it is the shortest way along corners of the boxes that
//! are in the way: those that a way meets are taken into account, until one meets none.

use super::layout::Area;
use super::picture::Arrow;
use std::collections::BTreeMap;

pub(super) type Point = (f64, f64);

/// A line comes no nearer to a box than this, where there is room.
const APART: f64 = 4.0;
/// The straight piece at both ends of a line.
const STUB: f64 = 10.0;
/// The distance of a corner of a line from that of the box, and how much more it is for others.
const CORNER: f64 = 8.0;
const MORE: f64 = 3.5;
const OTHERS: usize = 5;
/// A way around more boxes than this is not looked for.
const MOST: usize = 40;
/// The pieces of a curve that are looked at.
const PIECES: usize = 12;

/// A line's way.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Way {
    /// From the first point to the last, as the two others pull.
    Curve([Point; 4]),
    /// Along these, with round corners.
    Corners(Vec<Point>),
}

/// The ways of all arrows between different boxes, in their order.
pub(super) fn ways(boxes: &[Area], arrows: &[Arrow]) -> Vec<Option<Way>> {
    let ends = ends(boxes, arrows);
    let of_arrow = |(number, arrow): (usize, &Arrow)| {
        let (from, to) = ends.get(&(number, false)).zip(ends.get(&(number, true)))?;
        let own = [arrow.from, arrow.to];
        Some(way(boxes, own, *from, *to, number))
    };
    arrows.iter().enumerate().map(of_arrow).collect()
}

/// An end of a line, and the direction in which it leaves the box.
#[derive(Debug, Clone, Copy)]
struct End {
    at: Point,
    out: Point,
}

impl End {
    fn outside(self, by: f64) -> Point {
        (self.at.0 + self.out.0 * by, self.at.1 + self.out.1 * by)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Side {
    Top,
    Bottom,
    Left,
    Right,
}

/// Where each arrow begins (false) and ends (true).
fn ends(boxes: &[Area], arrows: &[Arrow]) -> BTreeMap<(usize, bool), End> {
    let mut at_sides: BTreeMap<(usize, Side), Vec<(f64, usize, bool)>> = BTreeMap::new();
    for (number, arrow) in arrows.iter().enumerate() {
        if arrow.from == arrow.to {
            continue;
        }
        for (own, other, is_end) in [(arrow.from, arrow.to, false), (arrow.to, arrow.from, true)] {
            let (side, along) = side(&boxes[own], &boxes[other]);
            let at_side = at_sides.entry((own, side)).or_default();
            at_side.push((along, number, is_end));
        }
    }
    let mut ends = BTreeMap::new();
    for ((own, side), mut at_side) in at_sides {
        at_side.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let (area, count) = (&boxes[own], at_side.len() as f64 + 1.0);
        for (place, (_, number, is_end)) in at_side.into_iter().enumerate() {
            let share = (place as f64 + 1.0) / count;
            let (x, y) = (area.x + area.width * share, area.y + area.height * share);
            let (at, out) = match side {
                Side::Top => ((x, area.y), (0.0, -1.0)),
                Side::Bottom => ((x, area.y + area.height), (0.0, 1.0)),
                Side::Left => ((area.x, y), (-1.0, 0.0)),
                Side::Right => ((area.x + area.width, y), (1.0, 0.0)),
            };
            ends.insert((number, is_end), End { at, out });
        }
    }
    ends
}

/// The side of a box at which a line to another one leaves, and where that one is along the side.
fn side(own: &Area, other: &Area) -> (Side, f64) {
    let (a, b) = (own.center(), other.center());
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    // One stands beside the other.
    if dy.abs() < (own.height + other.height) / 2.0 + STUB {
        let side = if dx < 0.0 { Side::Left } else { Side::Right };
        return (side, b.1);
    }
    let side = if dy < 0.0 { Side::Top } else { Side::Bottom };
    (side, b.0)
}

fn way(boxes: &[Area], own: [usize; 2], from: End, to: End, number: usize) -> Way {
    let distance = (to.at.0 - from.at.0).hypot(to.at.1 - from.at.1);
    let pull = (distance / 2.5).clamp(STUB, 90.0);
    let curve = [from.at, from.outside(pull), to.outside(pull), to.at];
    let pieces = points_of(&curve);
    // It touches its own.
    if met(boxes, &pieces).all(|one| own.contains(&one)) {
        return Way::Curve(curve);
    }
    let corner = CORNER + MORE * (number % OTHERS) as f64;
    match around(boxes, from.outside(STUB), to.outside(STUB), corner) {
        Some(mut points) => {
            points.insert(0, from.at);
            points.push(to.at);
            Way::Corners(points)
        }
        None => Way::Curve(curve),
    }
}

/// The shortest way from a point to another one that meets no box.
fn around(boxes: &[Area], from: Point, to: Point, corner: f64) -> Option<Vec<Point>> {
    let mut known: Vec<usize> = Vec::new();
    loop {
        let obstacles: Vec<Area> = known.iter().map(|&one| boxes[one]).collect();
        let way = shortest(&obstacles, from, to, corner)?;
        let before = known.len();
        let new = met(boxes, &way).filter(|one| !known[..before].contains(one));
        let new: Vec<usize> = new.collect();
        if new.is_empty() {
            return Some(way);
        }
        known.extend(new);
        if known.len() > MOST {
            return None;
        }
    }
}

/// Dijkstra's way over the corners that are outside of all obstacles.
fn shortest(obstacles: &[Area], from: Point, to: Point, corner: f64) -> Option<Vec<Point>> {
    let mut points = vec![from, to];
    for area in obstacles {
        let (left, top) = (area.x - corner, area.y - corner);
        let (right, bottom) = (area.x + area.width + corner, area.y + area.height + corner);
        points.extend([(left, top), (right, top), (left, bottom), (right, bottom)]);
    }
    let mut best = vec![(f64::INFINITY, 0); points.len()];
    let mut open: Vec<usize> = (0..points.len()).collect();
    best[0].0 = 0.0;
    while let Some(next) =
        (0..open.len()).min_by(|&a, &b| best[open[a]].0.total_cmp(&best[open[b]].0))
    {
        let here = open.swap_remove(next);
        let (length, _) = best[here];
        if length.is_infinite() {
            return None;
        }
        if here == 1 {
            break;
        }
        for &there in &open {
            let (a, b) = (points[here], points[there]);
            let through = length + (a.0 - b.0).hypot(a.1 - b.1);
            if through < best[there].0 && !meets_any(obstacles, &[a, b]) {
                best[there] = (through, here);
            }
        }
    }
    let mut way = vec![to];
    let mut at = 1;
    while at != 0 {
        at = best[at].1;
        way.push(points[at]);
    }
    way.reverse();
    Some(way)
}

fn meets_any(areas: &[Area], way: &[Point]) -> bool {
    areas.iter().any(|area| meets(area, way))
}

/// The boxes that a way comes too near to.
fn met(boxes: &[Area], way: &[Point]) -> impl Iterator<Item = usize> {
    let least = |of: fn(&Point) -> f64| way.iter().map(of).fold(f64::MAX, f64::min) - APART;
    let most = |of: fn(&Point) -> f64| way.iter().map(of).fold(f64::MIN, f64::max) + APART;
    let (left, right) = (least(|at| at.0), most(|at| at.0));
    let (top, bottom) = (least(|at| at.1), most(|at| at.1));
    let near = boxes.iter().enumerate().filter(move |(_, area)| {
        area.x < right
            && area.x + area.width > left
            && area.y < bottom
            && area.y + area.height > top
    });
    near.filter(|(_, area)| meets(area, way))
        .map(|(number, _)| number)
}

/// Whether a way comes too near to a box.
fn meets(area: &Area, way: &[Point]) -> bool {
    let (left, top) = (area.x - APART, area.y - APART);
    let (right, bottom) = (area.x + area.width + APART, area.y + area.height + APART);
    way.windows(2).any(|piece| {
        let ((x1, y1), (x2, y2)) = (piece[0], piece[1]);
        if x1.max(x2) <= left || x1.min(x2) >= right || y1.max(y2) <= top || y1.min(y2) >= bottom {
            return false;
        }
        // Both are there, and the box is not wholly on one side of the line.
        let side = |x: f64, y: f64| (x2 - x1) * (y - y1) - (y2 - y1) * (x - x1);
        let sides = [
            side(left, top),
            side(right, top),
            side(left, bottom),
            side(right, bottom),
        ];
        !(sides.iter().all(|one| *one >= 0.0) || sides.iter().all(|one| *one <= 0.0))
    })
}

/// Points of a curve, both ends included.
fn points_of(&[a, b, c, d]: &[Point; 4]) -> Vec<Point> {
    let at = |number: usize| {
        let t = number as f64 / PIECES as f64;
        let u = 1.0 - t;
        let of = |a: f64, b: f64, c: f64, d: f64| {
            u * u * u * a + 3.0 * u * u * t * b + 3.0 * u * t * t * c + t * t * t * d
        };
        (of(a.0, b.0, c.0, d.0), of(a.1, b.1, c.1, d.1))
    };
    (0..=PIECES).map(at).collect()
}

impl Way {
    /// Points along it.
    pub(super) fn points(&self) -> Vec<Point> {
        match self {
            Way::Curve(curve) => points_of(curve),
            Way::Corners(points) => points.clone(),
        }
    }

    /// The path of an SVG, without its head.
    pub(super) fn path(&self) -> String {
        let at = |(x, y): Point| format!("{x:.1} {y:.1}");
        match self {
            Way::Curve([a, b, c, d]) => format!("M{}C{} {} {}", at(*a), at(*b), at(*c), at(*d)),
            Way::Corners(points) => {
                let mut path = format!("M{}", at(points[0]));
                for three in points.windows(3) {
                    let [before, corner, after] = [three[0], three[1], three[2]];
                    let (begin, end) = (toward(corner, before), toward(corner, after));
                    path += &format!("L{}Q{} {}", at(begin), at(corner), at(end));
                }
                path + &format!("L{}", at(points[points.len() - 1]))
            }
        }
    }

    /// From where it comes to its end.
    pub(super) fn before_end(&self) -> Point {
        match self {
            Way::Curve([_, _, before, _]) => *before,
            Way::Corners(points) => points[points.len() - 2],
        }
    }
}

/// A point near a corner, on the way to another point.
fn toward(corner: Point, other: Point) -> Point {
    const ROUND: f64 = 10.0;
    let (dx, dy) = (other.0 - corner.0, other.1 - corner.1);
    let length = dx.hypot(dy).max(0.001);
    let part = (ROUND / length).min(0.5);
    (corner.0 + dx * part, corner.1 + dy * part)
}
