//! What is kept of processes, by their numbers.
//!
//! Numbers are given out one after the other, so what is kept of neighbours lies side by side: the
//! process that comes next, and the one that is forgotten next, are found in memory that was just
//! looked at. A hash table of processes would spread them over all of its memory, and leave a part
//! of it empty.

use luna_core::current::ProcessId;
use rustc_hash::FxHashMap;

/// How many neighbours lie side by side.
const PAGE: usize = 32;

struct Page<T> {
    count: usize,
    entries: [Option<T>; PAGE],
}

impl<T> Page<T> {
    fn new() -> Box<Self> {
        Box::new(Self {
            count: 0,
            entries: [const { None }; PAGE],
        })
    }
}

/// At most one `T` for each process.
pub(super) struct ById<T> {
    /// The page of the number that was entered last, and its number: most looks are for these.
    latest: (u32, Box<Page<T>>),
    /// The others; none is empty.
    pages: FxHashMap<u32, Box<Page<T>>>,
    /// The page that was emptied last, for the next that is needed.
    spare: Option<Box<Page<T>>>,
    len: usize,
}

/// The page of a number, and the place in it. Numbers begin with 1.
fn place(id: ProcessId) -> (u32, usize) {
    let number = id.get() - 1;
    (number / PAGE as u32, number as usize % PAGE)
}

impl<T> Default for ById<T> {
    fn default() -> Self {
        Self {
            latest: (0, Page::new()),
            pages: FxHashMap::default(),
            spare: None,
            len: 0,
        }
    }
}

impl<T> ById<T> {
    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Makes room for as many more, if they are neighbours.
    pub(super) fn reserve(&mut self, more: usize) {
        self.pages.reserve(more.div_ceil(PAGE));
    }

    fn page_mut(&mut self, number: u32) -> Option<&mut Box<Page<T>>> {
        match number == self.latest.0 {
            true => Some(&mut self.latest.1),
            false => self.pages.get_mut(&number),
        }
    }

    pub(super) fn get(&self, id: ProcessId) -> Option<&T> {
        let (number, place) = place(id);
        let page = match number == self.latest.0 {
            true => &self.latest.1,
            false => self.pages.get(&number)?,
        };
        page.entries[place].as_ref()
    }

    pub(super) fn get_mut(&mut self, id: ProcessId) -> Option<&mut T> {
        let (number, place) = place(id);
        self.page_mut(number)?.entries[place].as_mut()
    }

    /// Keeps `value` in the place of what was kept before.
    pub(super) fn insert(&mut self, id: ProcessId, value: T) {
        let (number, place) = place(id);
        if number != self.latest.0 {
            self.turn_to(number);
        }
        let page = &mut self.latest.1;
        if page.entries[place].replace(value).is_none() {
            page.count += 1;
            self.len += 1;
        }
    }

    /// Makes a page the latest.
    #[cold]
    fn turn_to(&mut self, number: u32) {
        let page = self.pages.remove(&number).or_else(|| self.spare.take());
        let page = page.unwrap_or_else(Page::new);
        let (number, page) = std::mem::replace(&mut self.latest, (number, page));
        if page.count == 0 {
            self.spare = Some(page);
        } else {
            self.pages.insert(number, page);
        }
    }

    pub(super) fn remove(&mut self, id: ProcessId) -> Option<T> {
        let (number, place) = place(id);
        let page = self.page_mut(number)?;
        let removed = page.entries[place].take()?;
        page.count -= 1;
        let is_empty = page.count == 0;
        self.len -= 1;
        if is_empty && number != self.latest.0 {
            self.spare = self.pages.remove(&number);
        }
        Some(removed)
    }

    /// All of them, in no order.
    pub(super) fn iter(&self) -> impl Iterator<Item = (ProcessId, &T)> {
        let latest = (&self.latest.0, &self.latest.1);
        self.pages
            .iter()
            .chain([latest])
            .flat_map(|(&page, entries)| {
                let entries = entries.entries.iter().enumerate();
                entries.filter_map(move |(place, entry)| {
                    // The last place of all is unused.
                    let number = (page * PAGE as u32 + place as u32).wrapping_add(1);
                    Some((ProcessId::from_number(number)?, entry.as_ref()?))
                })
            })
    }

    /// As [`iter`](Self::iter), to change them.
    pub(super) fn values_mut(&mut self) -> impl Iterator<Item = &mut T> {
        let pages = self.pages.values_mut().chain([&mut self.latest.1]);
        pages.flat_map(|page| page.entries.iter_mut().flatten())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn it_keeps_what_a_map_keeps() {
        let mut map = BTreeMap::new();
        let mut by_id = ById::default();
        let mut state = 1_u64;
        for step in 0..20_000 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            // Neighbours, with some far away, and the last of all.
            let number = match state >> 60 {
                0 => u32::MAX - (state >> 33) as u32 % 3,
                _ => 1 + (state >> 33) as u32 % 300,
            };
            let id = ProcessId::from_number(number).unwrap();
            if state >> 40 & 1 == 0 {
                by_id.insert(id, step);
                map.insert(number, step);
            } else {
                assert_eq!(by_id.remove(id), map.remove(&number));
            }
            assert_eq!(by_id.get(id), map.get(&number));
            assert_eq!(by_id.get_mut(id), map.get_mut(&number));
            assert_eq!(by_id.len(), map.len());
        }
        let mut all: Vec<_> = by_id.iter().map(|(id, &step)| (id.get(), step)).collect();
        all.sort_unstable();
        assert!(
            all.iter()
                .copied()
                .eq(map.iter().map(|(&id, &step)| (id, step)))
        );
        assert_eq!(by_id.values_mut().count(), map.len());
        for number in map.into_keys() {
            by_id.remove(ProcessId::from_number(number).unwrap());
        }
        assert!(by_id.pages.is_empty(), "empty pages go");
    }
}
