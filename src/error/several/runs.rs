//! The outcomes of the branches of a construct, in little memory.

/// The outcome of one branch, if it needs no memory of its own; or a bracket around the branches of
/// an inner construct.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Kind {
    Fine,
    Poisoned,
    Closed,
    Full,
    Empty,
    Timeout,
    Cancelled,
    /// An error that stands in the list beside, in its turn.
    Carried,
    /// The branch is a construct itself; its branches follow.
    Open,
    Close,
}

const KINDS: [Kind; 10] = [
    Kind::Fine,
    Kind::Poisoned,
    Kind::Closed,
    Kind::Full,
    Kind::Empty,
    Kind::Timeout,
    Kind::Cancelled,
    Kind::Carried,
    Kind::Open,
    Kind::Close,
];

/// How many runs lie in the error itself: twelve branches that all differ fit, with some constructs
/// within. With more, every `Result` would grow.
const INLINE: usize = 16;
const COUNT_BITS: u32 = 12;
const MAX: u16 = (1 << COUNT_BITS) - 1;

/// The branches in written order, as runs of neighbours of one kind. Networks end alike throughout,
/// so thousands of branches take a few runs. Up to sixteen runs lie in place.
#[derive(Clone)]
pub(super) enum Runs {
    Inline { used: u8, runs: [u16; INLINE] },
    Heap(Vec<u16>),
}

impl Runs {
    pub(super) const fn new() -> Runs {
        Runs::Inline {
            used: 0,
            runs: [0; INLINE],
        }
    }

    /// Room for the most runs of `branches` branches, so that adding them allocates nothing.
    pub(super) fn with_room_for(branches: usize) -> Runs {
        if branches <= INLINE {
            Runs::new()
        } else {
            Runs::Heap(Vec::with_capacity(branches))
        }
    }

    pub(super) fn packed(&self) -> &[u16] {
        match self {
            Runs::Inline { used, runs } => &runs[..usize::from(*used)],
            Runs::Heap(runs) => runs,
        }
    }

    fn last_mut(&mut self) -> Option<&mut u16> {
        match self {
            Runs::Inline { used, runs } => runs[..usize::from(*used)].last_mut(),
            Runs::Heap(runs) => runs.last_mut(),
        }
    }

    /// The runs: of which kind, and how many.
    pub(super) fn iter(&self) -> impl Iterator<Item = (Kind, usize)> + '_ {
        self.packed().iter().map(|&run| unpack(run))
    }

    /// Adds branches of one kind. Allocates if it no longer fits.
    pub(super) fn add(&mut self, kind: Kind, mut count: usize) {
        if let Some(last) = self.last_mut()
            && unpack(*last).0 == kind
        {
            let more = count.min(usize::from(MAX - (*last & MAX)));
            *last += more as u16;
            count -= more;
        }
        while count > 0 {
            let run = count.min(usize::from(MAX));
            self.push((kind as u16) << COUNT_BITS | run as u16);
            count -= run;
        }
    }

    fn push(&mut self, run: u16) {
        match self {
            Runs::Heap(runs) => runs.push(run),
            Runs::Inline { used, runs } => match runs.get_mut(usize::from(*used)) {
                Some(free) => {
                    *free = run;
                    *used += 1;
                }
                None => {
                    let mut moved = runs.to_vec();
                    moved.push(run);
                    *self = Runs::Heap(moved);
                }
            },
        }
    }

    /// Adds a branch that is a construct itself.
    pub(super) fn add_nested(&mut self, nested: &Runs) {
        self.push((Kind::Open as u16) << COUNT_BITS | 1);
        for (kind, count) in nested.iter() {
            match kind {
                // Brackets are never joined: each is one branch.
                Kind::Open | Kind::Close => self.push((kind as u16) << COUNT_BITS | 1),
                _ => self.add(kind, count),
            }
        }
        self.push((Kind::Close as u16) << COUNT_BITS | 1);
    }
}

impl PartialEq for Runs {
    fn eq(&self, other: &Self) -> bool {
        self.packed() == other.packed()
    }
}

impl Eq for Runs {}

pub(super) fn unpack(run: u16) -> (Kind, usize) {
    (
        KINDS[usize::from(run >> COUNT_BITS)],
        usize::from(run & MAX),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_come_out_as_they_went_in() {
        for (number, kind) in KINDS.into_iter().enumerate() {
            assert_eq!(kind as usize, number);
            assert_eq!(unpack((kind as u16) << COUNT_BITS | 7), (kind, 7));
        }
    }

    #[test]
    fn neighbours_join_and_long_runs_go_on() {
        let mut runs = Runs::new();
        runs.add(Kind::Poisoned, 1);
        runs.add(Kind::Poisoned, 9_999);
        runs.add(Kind::Closed, 1);
        assert!(matches!(runs, Runs::Inline { used: 4, .. }));
        let total = |wanted| -> usize {
            let of_kind = runs.iter().filter(|&(kind, _)| kind == wanted);
            of_kind.map(|(_, count)| count).sum()
        };
        assert_eq!((total(Kind::Poisoned), total(Kind::Closed)), (10_000, 1));
    }

    #[test]
    fn equal_wherever_they_lie() {
        let (mut inline, mut heap) = (Runs::new(), Runs::with_room_for(100));
        for runs in [&mut inline, &mut heap] {
            runs.add(Kind::Fine, 3);
            runs.add(Kind::Timeout, 1);
        }
        assert!(inline == heap);
        // Runs that do not fit inline are moved to the heap.
        for n in 0..20 {
            for runs in [&mut inline, &mut heap] {
                runs.add(if n % 2 == 0 { Kind::Full } else { Kind::Empty }, 1);
            }
        }
        assert!(inline == heap);
        assert!(matches!(inline, Runs::Heap(_)));
    }
}
