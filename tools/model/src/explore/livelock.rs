//! Cycles of silent moves.

/// The state at which a cycle is entered, and its moves: each with its state and its number there.
/// Of several cycles the one whose state was seen first among those that lead to a cycle.
///
/// `silent` has the moves of `states` states: from, to, number; ascending by the first. It takes 12
/// bytes for each state and 4 for each move.
pub(crate) fn cycle(silent: &[(u32, u32, u32)], states: usize) -> Option<(u32, Vec<(u32, u32)>)> {
    // How many moves lead on, and where those begin that lead to a state.
    let mut open = vec![0_u32; states];
    let mut begins = vec![0_u32; states + 1];
    for &(from, to, _) in silent {
        open[from as usize] += 1;
        begins[to as usize + 1] += 1;
    }
    for state in 0..states {
        begins[state + 1] += begins[state];
    }
    let mut before = vec![0_u32; silent.len()];
    for &(from, to, _) in silent {
        // Filled from the front; the begins are set back below.
        before[begins[to as usize] as usize] = from;
        begins[to as usize] += 1;
    }
    begins.rotate_right(1);
    begins[0] = 0;
    // What leads nowhere is on no cycle; take it away until nothing more is found.
    let all = 0..states as u32;
    let mut ends: Vec<u32> = all.filter(|&state| open[state as usize] == 0).collect();
    while let Some(end) = ends.pop() {
        let [begin, to] = [begins[end as usize], begins[end as usize + 1]];
        for &from in &before[begin as usize..to as usize] {
            open[from as usize] -= 1;
            if open[from as usize] == 0 {
                ends.push(from);
            }
        }
    }
    // From what is left there is always a move to what is left: at some time a state comes again.
    let step_from = |state: u32| {
        let first = silent.partition_point(|&(from, ..)| from < state);
        let moves = silent[first..].iter();
        let mut moves = moves.take_while(|&&(from, ..)| from == state);
        moves.find(|&&(_, to, _)| open[to as usize] > 0).copied()
    };
    let mut at = silent
        .iter()
        .find(|&&(from, ..)| open[from as usize] > 0)?
        .0;
    let mut seen = vec![false; states];
    while !std::mem::replace(&mut seen[at as usize], true) {
        at = step_from(at)?.1;
    }
    let start = at;
    let mut moves = Vec::new();
    loop {
        let (_, to, number) = step_from(at)?;
        moves.push((at, number));
        at = to;
        if at == start {
            return Some((start, moves));
        }
    }
}
