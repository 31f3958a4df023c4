//! Where boxes go: each group by itself, the innermost first, by the method of Sugiyama.
//!
//! `rust-sugiyama` takes graphs without circles and double edges. An arrow that would close a
//! circle is left out of the layout, and drawn all the same.
//!
//! What the file places is where it says; what it does not place is laid out as if nothing were.

use super::picture::{Arrow, Groups, Item, contents, details, short};
use crate::file::At;
use crate::network::Network;
use rust_sugiyama::configure::Config;
use std::collections::{BTreeMap, BTreeSet};

pub(super) const MARGIN: f64 = 24.0;
/// Above what is in a group: its name.
pub(super) const TITLE: f64 = 22.0;
const HEIGHT: f64 = 44.0;
pub(super) const LETTER: f64 = 7.2;
const SPACING: f64 = 64.0;
/// From so many rows on, and if it is so much higher than wide, a chain becomes columns.
const MANY_ROWS: usize = 5;
const HIGH: f64 = 1.6;
/// Room for `waits for` before the name of a channel, in letters of a name. It is written smaller.
const WAITS: f64 = 7.0;
const SMALLER: f64 = 0.8;

/// A rectangle, by its upper left corner.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Area {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) width: f64,
    pub(super) height: f64,
}

impl Area {
    pub(super) fn center(&self) -> (f64, f64) {
        (self.x + self.width / 2.0, self.y + self.height / 2.0)
    }
}

/// All in units of a pixel.
#[derive(Debug)]
pub(super) struct Layout {
    pub(super) groups: Vec<Area>,
    pub(super) processes: Vec<Area>,
}

pub(super) fn layout(network: &Network, groups: &Groups<'_>, arrows: &[Arrow]) -> Layout {
    let contents = contents(groups);
    let edges = edges(groups, arrows);
    let mut found = Layout {
        groups: vec![Area::default(); groups.all.len()],
        processes: vec![Area::default(); network.processes.len()],
    };
    let waits = waits(network);
    for (number, process) in network.processes.iter().enumerate() {
        let area = &mut found.processes[number];
        (area.width, area.height) = size(short(&process.name), &details(network, number));
        area.width = area.width.max(waits[number] * LETTER + MARGIN);
    }
    // A group stands behind the one that it is in.
    for number in (0..groups.all.len()).rev() {
        let title = groups.all[number].name.chars().count() as f64 * LETTER + MARGIN;
        let size = arrange(&mut found, &contents[number], &edges[number]);
        let (width, height) = place(network, groups, &mut found, &contents[number], size);
        let group = &mut found.groups[number];
        group.width = (width + 2.0 * MARGIN).max(title);
        group.height = height + 2.0 * MARGIN + TITLE;
    }
    // Places were those within the group.
    for (number, items) in contents.iter().enumerate() {
        let Area { x, y, .. } = found.groups[number];
        for &item in items {
            let area = found.area(item);
            area.x += x + MARGIN;
            area.y += y + MARGIN + TITLE;
        }
    }
    found
}

/// Where an element of an array is, if the array is placed: below the one before.
pub(crate) fn of_element((x, y): At, number: usize) -> At {
    (
        x,
        y.saturating_add(number as i32 * (HEIGHT + MARGIN) as i32),
    )
}

/// Boxes of these sizes, with arrows between them: their upper left corners.
pub(crate) fn corners(sizes: &[(f64, f64)], arrows: &[(usize, usize)]) -> Vec<(f64, f64)> {
    let areas = sizes.iter().map(|&(width, height)| Area {
        width,
        height,
        ..Area::default()
    });
    let mut found = Layout {
        groups: Vec::new(),
        processes: areas.collect(),
    };
    let items: Vec<Item> = (0..sizes.len()).map(Item::Process).collect();
    let edges = arrows.iter().filter(|(from, to)| from != to);
    let edges = edges.map(|&(from, to)| (Item::Process(from), Item::Process(to)));
    arrange(&mut found, &items, &edges.collect());
    found
        .processes
        .iter()
        .map(|area| (area.x, area.y))
        .collect()
}

/// The size of a box with these two lines of text.
pub(crate) fn size(first: &str, second: &str) -> (f64, f64) {
    let letters = first.chars().count().max(second.chars().count());
    (letters as f64 * LETTER + MARGIN, HEIGHT)
}

/// Puts what the file places where it says, and all of it into the group; returns its size.
fn place(
    network: &Network,
    groups: &Groups<'_>,
    found: &mut Layout,
    items: &[Item],
    size: (f64, f64),
) -> (f64, f64) {
    let at = |item: Item| match item {
        Item::Group(number) => groups.all[number].at,
        Item::Process(number) => network.processes[number].at,
    };
    if items.iter().all(|&item| at(item).is_none()) {
        return size;
    }
    for &item in items {
        if let Some((x, y)) = at(item) {
            let area = found.area(item);
            (area.x, area.y) = (x.into(), y.into());
        }
    }
    let areas: Vec<(usize, Area)> = items.iter().map(|&item| (0, *found.area(item))).collect();
    let bounds = bounds(&areas);
    for &item in items {
        let area = found.area(item);
        area.x -= bounds.x;
        area.y -= bounds.y;
    }
    (bounds.width, bounds.height)
}

/// How long the text is that says for which channel a process waits, in letters.
fn waits(network: &Network) -> Vec<f64> {
    let mut waits = vec![0.0; network.processes.len()];
    for channel in &network.channels {
        let letters = WAITS + channel.name.chars().count() as f64 * SMALLER;
        for &process in channel.senders.iter().chain(&channel.receivers) {
            waits[process] = letters.max(waits[process]);
        }
    }
    waits
}

impl Layout {
    fn area(&mut self, item: Item) -> &mut Area {
        match item {
            Item::Group(number) => &mut self.groups[number],
            Item::Process(number) => &mut self.processes[number],
        }
    }
}

type Edges = BTreeSet<(Item, Item)>;

/// For each group the arrows between what is directly in it.
fn edges(groups: &Groups<'_>, arrows: &[Arrow]) -> Vec<Edges> {
    let way = |process: usize| {
        let mut group = groups.of[process];
        let mut way = vec![(group, Item::Process(process))];
        while let Some(parent) = groups.all[group].parent {
            way.push((parent, Item::Group(group)));
            group = parent;
        }
        way
    };
    let mut edges = vec![Edges::new(); groups.all.len()];
    for arrow in arrows {
        let (from, to) = (way(arrow.from), way(arrow.to));
        let common = from.iter().find_map(|&(group, item)| {
            let other = to.iter().find(|(other, _)| *other == group);
            other.map(|&(_, other)| (group, item, other))
        });
        if let Some((group, from, to)) = common.filter(|(_, from, to)| from != to) {
            edges[group].insert((from, to));
        }
    }
    edges
}

/// Places items, the first at 0; returns the width and height of all.
fn arrange(found: &mut Layout, items: &[Item], edges: &Edges) -> (f64, f64) {
    let numbers: BTreeMap<Item, u32> = items.iter().copied().zip(0..).collect();
    let sizes = items.iter().map(|&item| {
        let area = found.area(item);
        (numbers[&item], (area.width, area.height))
    });
    let sizes: Vec<(u32, (f64, f64))> = sizes.collect();
    let edges = without_circles(items, edges);
    let edges = edges.iter().map(|(from, to)| (numbers[from], numbers[to]));
    let edges: Vec<(u32, u32)> = edges.collect();
    let config = Config {
        vertex_spacing: SPACING,
        transpose: false,
        ..Config::default()
    };
    let parts = rust_sugiyama::from_vertices_and_edges(&sizes, &edges, &config);
    // Parts without a connection are put into rows that are about as wide as all is high.
    let mut parts: Vec<Vec<(usize, Area)>> = parts
        .into_iter()
        .map(|(places, _, _)| {
            let areas = places.into_iter().map(|(number, (x, y))| {
                let (width, height) = sizes[number].1;
                // The library gives centers.
                let (x, y) = (x - width / 2.0, y - height / 2.0);
                let area = Area {
                    x,
                    y,
                    width,
                    height,
                };
                (number, area)
            });
            let mut areas: Vec<(usize, Area)> = areas.collect();
            fold(&mut areas);
            areas
        })
        .collect();
    parts.sort_by_key(|part| part.iter().map(|(number, _)| *number).min());
    let bounds: Vec<Area> = parts.iter().map(|part| bounds(part)).collect();
    let surface: f64 = bounds
        .iter()
        .map(|area| (area.width + SPACING) * (area.height + SPACING))
        .sum();
    let widest = bounds.iter().map(|area| area.width).fold(0.0, f64::max);
    let limit = widest.max(surface.sqrt() * 1.4);
    let (mut x, mut y, mut row, mut width): (f64, f64, f64, f64) = (0.0, 0.0, 0.0, 0.0);
    for (part, bounds) in parts.iter().zip(&bounds) {
        if x > 0.0 && x + bounds.width > limit {
            (x, y, row) = (0.0, y + row + SPACING, 0.0);
        }
        for &(number, area) in part {
            *found.area(items[number]) = Area {
                x: area.x - bounds.x + x,
                y: area.y - bounds.y + y,
                ..area
            };
        }
        x += bounds.width + SPACING;
        row = row.max(bounds.height);
        width = width.max(x - SPACING);
    }
    (width, y + row)
}

/// What is much higher than wide, as a long chain is, becomes columns: its rows go on at the top of
/// the next one.
fn fold(part: &mut [(usize, Area)]) {
    let height = bounds(part).height;
    let mut rows: Vec<f64> = part.iter().map(|(_, area)| area.center().1).collect();
    rows.sort_by(f64::total_cmp);
    rows.dedup_by(|a, b| (*a - *b).abs() < 1.0);
    if rows.len() < MANY_ROWS {
        return;
    }
    // In its row each box keeps its distance from the others.
    let row = |area: &Area| rows.partition_point(|row| *row < area.center().1 - 1.0);
    let mut of_rows = vec![Vec::new(); rows.len()];
    for &(number, area) in part.iter() {
        if let Some(of_row) = of_rows.get_mut(row(&area)) {
            of_row.push((number, area));
        }
    }
    let bounds_of_rows: Vec<Area> = of_rows.iter().map(|row| bounds(row)).collect();
    let widest = bounds_of_rows
        .iter()
        .map(|row| row.width)
        .fold(0.0, f64::max);
    if height <= widest * HIGH {
        return;
    }
    let count = (height / HIGH / (widest + SPACING)).sqrt().ceil().max(2.0);
    let (most, mut x, mut y) = (height / count, 0.0, 0.0);
    let mut moves = Vec::new();
    for row in &bounds_of_rows {
        if y > 0.0 && y + row.height / 2.0 > most {
            (x, y) = (x + widest + 1.5 * SPACING, 0.0);
        }
        moves.push((x + (widest - row.width) / 2.0 - row.x, y - row.y));
        y += row.height + SPACING;
    }
    for (_, area) in part {
        if let Some((dx, dy)) = moves.get(row(area)) {
            (area.x, area.y) = (area.x + dx, area.y + dy);
        }
    }
}

fn bounds(part: &[(usize, Area)]) -> Area {
    let least = |of: fn(&Area) -> f64| part.iter().map(|(_, a)| of(a)).fold(f64::MAX, f64::min);
    let most = |of: fn(&Area) -> f64| part.iter().map(|(_, a)| of(a)).fold(f64::MIN, f64::max);
    let (x, y) = (least(|area| area.x), least(|area| area.y));
    Area {
        x,
        y,
        width: most(|area| area.x + area.width) - x,
        height: most(|area| area.y + area.height) - y,
    }
}

/// The edges but for those that lead back to where a depth-first search is.
fn without_circles(items: &[Item], edges: &Edges) -> Edges {
    let mut after: BTreeMap<Item, Vec<Item>> = BTreeMap::new();
    for &(from, to) in edges {
        after.entry(from).or_default().push(to);
    }
    let mut kept = Edges::new();
    let (mut seen, mut on_way) = (BTreeSet::new(), BTreeSet::new());
    for &start in items {
        if !seen.insert(start) {
            continue;
        }
        on_way.insert(start);
        let mut way = vec![(start, 0)];
        while let Some(&mut (item, ref mut tried)) = way.last_mut() {
            let next = after
                .get(&item)
                .and_then(|after| after.get(*tried))
                .copied();
            *tried += 1;
            let Some(next) = next else {
                on_way.remove(&item);
                way.pop();
                continue;
            };
            if !on_way.contains(&next) {
                kept.insert((item, next));
            }
            if seen.insert(next) {
                on_way.insert(next);
                way.push((next, 0));
            }
        }
    }
    kept
}
