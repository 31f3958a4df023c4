//! The states that were seen, folded: a state is a tree of pairs, and equal parts of states are kept
//! once. States that lie near each other share nearly all of their pairs, so one that differs from a
//! known one in a value costs some pairs of 8 bytes, however long it is.

use super::state::State;
use hashbrown::HashTable;
use rustc_hash::FxBuildHasher;
use std::hash::BuildHasher;

/// Pairs by their numbers, and the numbers by the pairs.
#[derive(Debug, Default)]
struct Pairs {
    pairs: Vec<(u32, u32)>,
    numbers: HashTable<u32>,
}

fn hash((left, right): (u32, u32)) -> u64 {
    FxBuildHasher.hash_one(u64::from(left) << 32 | u64::from(right))
}

impl Pairs {
    fn find(&self, pair: (u32, u32)) -> Option<u32> {
        let is_it = |&number: &u32| self.pairs[number as usize] == pair;
        self.numbers.find(hash(pair), is_it).copied()
    }

    /// The number of a pair, and whether it is new. There is room for it.
    fn add(&mut self, pair: (u32, u32)) -> (u32, bool) {
        if let Some(known) = self.find(pair) {
            return (known, false);
        }
        let number = self.pairs.len() as u32;
        push(&mut self.pairs, pair);
        let pairs = &self.pairs;
        let again = |&number: &u32| hash(pairs[number as usize]);
        self.numbers.insert_unique(hash(pair), number, again);
        (number, true)
    }

    /// The bytes that it takes, also while it grows by `more` pairs.
    fn bytes_with(&self, more: usize) -> u64 {
        let table = self.numbers.allocation_size() as u64;
        let is_full = self.numbers.len() + more >= self.numbers.capacity();
        // The new table has twice the places, and the old one is there until it is filled.
        let table = if is_full { 3 * table } else { table };
        table + vec_bytes(&self.pairs, more)
    }
}

/// Appends; a full vector grows by a quarter, since its memory is bounded.
pub(super) fn push<T>(vec: &mut Vec<T>, value: T) {
    if vec.len() == vec.capacity() {
        vec.reserve_exact(vec.capacity() / 4 + 1024);
    }
    vec.push(value);
}

/// The bytes of a vector, also while it grows by `more` values.
pub(super) fn vec_bytes<T>(vec: &Vec<T>, more: usize) -> u64 {
    let places = match vec.len() + more >= vec.capacity() {
        // It may be copied.
        true => vec.capacity() + vec.capacity() / 4 * 5 + 1024 + more,
        false => vec.capacity(),
    };
    places as u64 * size_of::<T>() as u64
}

/// States of one length, numbered in the order in which they were added.
#[derive(Debug)]
pub(crate) struct Store {
    /// The length of each level of the tree: the values of a state, pairs of those, and so on.
    lengths: Vec<usize>,
    /// All pairs but those of whole states.
    parts: Pairs,
    wholes: Pairs,
    /// The levels of the state that was unfolded last: others are folded by what differs.
    near: Vec<Vec<u32>>,
    is_near: bool,
    /// Where a state differs from that one, in one level and in the next.
    changed: Vec<usize>,
    above: Vec<usize>,
    /// What to set back: level, place, number.
    undo: Vec<(usize, usize, u32)>,
}

impl Store {
    /// For states of so many values.
    pub(crate) fn new(length: usize) -> Self {
        let mut lengths = vec![length];
        let mut last = length;
        while last > 2 {
            last = last.div_ceil(2);
            lengths.push(last);
        }
        Self {
            near: lengths.iter().map(|&length| vec![0; length]).collect(),
            lengths,
            parts: Pairs::default(),
            wholes: Pairs::default(),
            is_near: false,
            changed: Vec::new(),
            above: Vec::new(),
            undo: Vec::new(),
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.wholes.pairs.len()
    }

    /// The bytes that it takes, also while it grows by one more state.
    pub(crate) fn bytes(&self) -> u64 {
        let nears = 2 * self.lengths.iter().sum::<usize>() as u64 * 8;
        self.parts.bytes_with(self.lengths[0]) + self.wholes.bytes_with(1) + nears
    }

    /// Whether one more state has numbers left.
    pub(crate) fn has_numbers(&self) -> bool {
        self.parts.pairs.len() + self.lengths[0] < u32::MAX as usize
            && self.wholes.pairs.len() + 1 < u32::MAX as usize
    }

    /// The state with a number. What is added next is best one that differs little from it.
    pub(crate) fn unfold(&mut self, number: u32) -> State {
        self.is_near = true;
        let (near, parts) = (&mut self.near, &self.parts);
        spread(near, parts, self.wholes.pairs[number as usize]);
        near[0].iter().map(|&value| value as i32).collect()
    }

    /// The same, without an effect on what is added next.
    pub(crate) fn get(&self, number: u32) -> State {
        let mut levels: Vec<Vec<u32>> = self.lengths.iter().map(|&n| vec![0; n]).collect();
        spread(&mut levels, &self.parts, self.wholes.pairs[number as usize]);
        levels[0].iter().map(|&value| value as i32).collect()
    }

    /// The number of a state, and whether it is new; none if it is new and none `may_come`.
    pub(crate) fn add(&mut self, state: &State, may_come: bool) -> Option<(u32, bool)> {
        self.changed.clear();
        for (place, (&value, near)) in state.iter().zip(&mut self.near[0]).enumerate() {
            let value = value as u32;
            if *near != value || !self.is_near {
                self.undo.push((0, place, *near));
                self.changed.push(place);
                *near = value;
            }
        }
        let whole = self.fold(may_come);
        let found = whole.and_then(|whole| match may_come {
            true => Some(self.wholes.add(whole)),
            false => self.wholes.find(whole).map(|number| (number, false)),
        });
        match self.is_near {
            true => {
                for (level, place, number) in self.undo.drain(..).rev() {
                    self.near[level][place] = number;
                }
            }
            // The first state: others are near it.
            false => {
                self.undo.clear();
                self.is_near = whole.is_some();
            }
        }
        found
    }

    /// Folds what has changed. Returns the pair of the whole state; none if a part is new and none
    /// may come.
    fn fold(&mut self, may_come: bool) -> Option<(u32, u32)> {
        for level in 1..self.lengths.len() {
            self.above.clear();
            for &place in &self.changed {
                if self.above.last() != Some(&(place / 2)) {
                    self.above.push(place / 2);
                }
            }
            let (below, here) = self.near.split_at_mut(level);
            let (below, here) = (&below[level - 1], &mut here[0]);
            for &place in &self.above {
                let left = below[2 * place];
                let number = match below.get(2 * place + 1) {
                    Some(&right) if may_come => self.parts.add((left, right)).0,
                    Some(&right) => self.parts.find((left, right))?,
                    // The last of an odd number goes up as it is.
                    None => left,
                };
                self.undo.push((level, place, here[place]));
                here[place] = number;
            }
            std::mem::swap(&mut self.changed, &mut self.above);
        }
        let top = self.near.last()?;
        let at = |place: usize| top.get(place).copied().unwrap_or(0);
        Some((at(0), at(1)))
    }
}

/// Fills the levels of a state from the pair of the whole.
fn spread(levels: &mut [Vec<u32>], parts: &Pairs, whole: (u32, u32)) {
    if let Some(top) = levels.last_mut() {
        for (place, number) in top.iter_mut().zip([whole.0, whole.1]) {
            *place = number;
        }
    }
    for level in (1..levels.len()).rev() {
        let (below, here) = levels.split_at_mut(level);
        let below = &mut below[level - 1];
        for (pair, &number) in below.chunks_mut(2).zip(&here[0]) {
            match pair {
                [left, right] => (*left, *right) = parts.pairs[number as usize],
                [last] => *last = number,
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashMap;

    proptest! {
        /// As a map from states to numbers, whatever is unfolded in between.
        #[test]
        fn it_is_a_numbering_of_states(
            length in 0usize..20,
            steps in prop::collection::vec((any::<prop::sample::Index>(), -3i32..3, any::<bool>(), any::<bool>()), 1..200),
        ) {
            let mut store = Store::new(length);
            let mut numbers: HashMap<State, u32> = HashMap::new();
            let mut all: Vec<State> = Vec::new();
            let mut state: State = vec![0; length].into();
            for (place, value, jumps, may_come) in steps {
                if jumps && !all.is_empty() {
                    let number = place.index(all.len()) as u32;
                    state = store.unfold(number);
                    prop_assert_eq!(&state, &all[number as usize]);
                }
                if length > 0 {
                    let place = place.index(length);
                    state[place] = value;
                }
                let known = numbers.get(&state).copied();
                let expected = match known {
                    Some(number) => Some((number, false)),
                    None => may_come.then_some((all.len() as u32, true)),
                };
                prop_assert_eq!(store.add(&state, may_come), expected);
                if known.is_none() && may_come {
                    numbers.insert(state.clone(), all.len() as u32);
                    all.push(state.clone());
                }
                prop_assert_eq!(store.len(), all.len());
            }
            for (number, state) in all.iter().enumerate() {
                prop_assert_eq!(&store.get(number as u32), state);
            }
        }
    }

    /// All values of twelve places out of 1600, one step from each other: some pairs each.
    #[test]
    fn a_long_state_that_differs_in_a_value_costs_some_pairs() {
        let mut store = Store::new(1600);
        let mut state: State = vec![0; 1600].into();
        store.add(&state, true);
        let before = store.bytes();
        for number in 0..1_u32 << 12 {
            for bit in 0..12 {
                state[bit * 130] = (number >> bit & 1) as i32;
            }
            store.add(&state, true);
            if number % 7 == 0 {
                let last = store.len() as u32 - 1;
                store.unfold(last);
            }
        }
        assert_eq!(store.len(), 1 << 12);
        let each = (store.bytes() - before) / (1 << 12);
        assert!(each < 400, "{each}");
    }
}
