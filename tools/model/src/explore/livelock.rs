//! Cycles of silent moves.

use super::state::Move;
use std::collections::{BTreeMap, BTreeSet};

/// The state at which a cycle is entered, and its moves. Of several the one whose state was seen
/// first among those that lead to a cycle.
pub(crate) fn cycle(silent: &[(u32, u32, Move)]) -> Option<(u32, Vec<Move>)> {
    let mut after: BTreeMap<u32, Vec<(u32, Move)>> = BTreeMap::new();
    let mut before: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    let mut open: BTreeMap<u32, usize> = BTreeMap::new();
    for &(from, to, step) in silent {
        after.entry(from).or_default().push((to, step));
        before.entry(to).or_default().push(from);
        *open.entry(from).or_default() += 1;
        open.entry(to).or_default();
    }
    // What leads nowhere is on no cycle; take it away until nothing more is found.
    let ends = open.iter().filter(|(_, count)| **count == 0);
    let mut ends: Vec<u32> = ends.map(|(&state, _)| state).collect();
    while let Some(end) = ends.pop() {
        open.remove(&end);
        for from in before.get(&end).into_iter().flatten() {
            if let Some(count) = open.get_mut(from) {
                *count -= 1;
                if *count == 0 {
                    ends.push(*from);
                }
            }
        }
    }
    // From what is left there is always a move to what is left: at some time a state comes again.
    let step_from = |state: u32| {
        let moves = after.get(&state).into_iter().flatten();
        moves.copied().find(|(to, _)| open.contains_key(to))
    };
    let mut at = *open.keys().next()?;
    let mut seen = BTreeSet::new();
    while seen.insert(at) {
        at = step_from(at)?.0;
    }
    let start = at;
    let mut moves = Vec::new();
    loop {
        let (to, step) = step_from(at)?;
        moves.push(step);
        at = to;
        if at == start {
            return Some((start, moves));
        }
    }
}
