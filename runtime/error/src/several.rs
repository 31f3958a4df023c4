//! Several errors that came of one construct.

use super::Error;
use smallvec::SmallVec;
use std::fmt;
use std::iter::FusedIterator;

/// The errors of a parallel construct in which more than one branch failed, in the order in which
/// the branches are written.
///
/// Errors that are no more than their kind (poisoned, closed, full, empty, timeout, cancelled) take
/// no memory of their own: a network in which all branches end poisoned or closed allocates
/// nothing. Up to sixteen runs of equal neighbours are stored in the error itself. That is enough
/// for any `par!` with branches that are no constructs themselves; the constructs
/// over collections reserve room for any outcome when they are created. Memory is allocated in two
/// cases: when nested constructs come to more than sixteen runs (each bracket around an inner
/// construct counts as one), and when an error carries more (a name, a message), and so was
/// allocated by its maker already.
///
/// ```
/// use luna::prelude::*;
///
/// let (sender, receiver) = luna::channel::<u8>();
/// receiver.poison();
/// let outcome: luna::Result<_> =
///     luna::run(async { par!(sender.send(1), async { Err::<(), _>(luna::Error::other("no encoder")) }).await });
/// let luna::Error::Several(several) = outcome.unwrap_err() else { panic!("both branches failed") };
/// assert_eq!(several.len(), 2);
/// assert!(several.first().is_poisoned());
/// assert_eq!(several.errors().last().unwrap().to_string(), "no encoder");
/// ```
#[derive(Clone, Default, PartialEq, Eq)]
pub struct Several {
    /// The outcomes of the branches in written order. Networks end alike throughout, so thousands
    /// of branches take a few runs. With more runs in place, every `Result` would grow.
    runs: SmallVec<[Run; 16]>,
    /// The errors of kind [`CARRIED`], in written order.
    carried: Vec<Error>,
}

/// Neighbouring branches with the same outcome: its kind in the lowest four bits, their number
/// above.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Run(u16);

impl Run {
    /// The greatest number of branches in one.
    const MOST: usize = (u16::MAX >> 4) as usize;

    const fn new(kind: Kind, count: usize) -> Self {
        Run((count as u16) << 4 | kind)
    }

    fn kind(self) -> Kind {
        self.0 & 0xf
    }

    fn count(self) -> usize {
        usize::from(self.0 >> 4)
    }
}

/// The outcome of one branch, or a bracket around the branches of an inner construct: a place in
/// `PLAIN`, or one of the constants.
type Kind = u16;

/// The errors that need no memory of their own.
static PLAIN: [Error; 6] = [
    Error::Poisoned,
    Error::Closed,
    Error::Full,
    Error::Empty,
    Error::Timeout,
    Error::Cancelled,
];
/// An error that is stored in the list beside.
const CARRIED: Kind = PLAIN.len() as Kind;
/// The branch has not failed.
const FINE: Kind = CARRIED + 1;
/// The branch is a construct itself; its branches follow.
const OPEN: Kind = CARRIED + 2;
const CLOSE: Kind = CARRIED + 3;

fn kind_of(error: &Error) -> Kind {
    let plain = PLAIN.iter().position(|plain| plain == error);
    plain.map_or(CARRIED, |place| place as Kind)
}

fn plain_error(kind: Kind) -> Option<&'static Error> {
    PLAIN.get(usize::from(kind))
}

impl Several {
    /// How many errors there are; at least two. O(number of branches).
    #[expect(clippy::len_without_is_empty, reason = "it never is")]
    pub fn len(&self) -> usize {
        self.errors().count()
    }

    /// The first in written order.
    pub fn first(&self) -> &Error {
        self.errors()
            .next()
            .expect("there are two errors at the least")
    }

    /// All of them in written order; those of a construct within a branch stand in the place of
    /// that branch.
    pub fn errors(&self) -> Errors<'_> {
        Errors {
            one: None,
            run: NOTHING,
            runs: self.runs.iter(),
            carried: self.carried.iter(),
        }
    }

    fn add(&mut self, error: Error) {
        if let Error::Several(nested) = error {
            self.add_run(OPEN, 1);
            for run in nested.runs {
                self.add_run(run.kind(), run.count());
            }
            self.add_run(CLOSE, 1);
            self.carried.extend(nested.carried);
            return;
        }
        let kind = kind_of(&error);
        self.add_run(kind, 1);
        if kind == CARRIED {
            self.carried.push(error);
        }
    }

    /// Adds branches of one kind. Allocates if it no longer fits.
    fn add_run(&mut self, kind: Kind, mut count: usize) {
        // Brackets are never joined: each is one branch.
        if let Some(last) = self.runs.last_mut()
            && last.kind() == kind
            && !matches!(kind, OPEN | CLOSE)
        {
            let more = count.min(Run::MOST - last.count());
            *last = Run::new(kind, last.count() + more);
            count -= more;
        }
        while count > 0 {
            let part = count.min(Run::MOST);
            self.runs.push(Run::new(kind, part));
            count -= part;
        }
    }
}

impl fmt::Debug for Several {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// Names each branch by the numbers of its construct's branches, from the outside: `2.1`.
/// Neighbours with the same plain error are named together.
impl fmt::Display for Several {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} errors in a parallel construct", self.len())?;
        let mut carried = self.carried.iter();
        let mut branches = Numbered {
            numbers: vec![1],
            separator: ':',
        };
        let mut runs = self.runs.iter().peekable();
        while let Some(run) = runs.next() {
            let mut count = run.count();
            match (run.kind(), plain_error(run.kind())) {
                (_, Some(error)) => {
                    // A long run is stored in parts.
                    while let Some(more) = runs.next_if(|next| next.kind() == run.kind()) {
                        count += more.count();
                    }
                    branches.write(f, count, error)?;
                }
                (CARRIED, _) => {
                    for error in carried.by_ref().take(count) {
                        branches.write(f, 1, error)?;
                    }
                }
                (OPEN, _) => branches.numbers.push(1),
                (CLOSE, _) => {
                    branches.numbers.pop();
                    branches.pass(1);
                }
                _ => branches.pass(count),
            }
        }
        Ok(())
    }
}

/// Where a text about branches has come to.
struct Numbered {
    /// The number of the next branch, behind those of the branches around it.
    numbers: Vec<usize>,
    separator: char,
}

impl Numbered {
    fn pass(&mut self, count: usize) {
        if let Some(next) = self.numbers.last_mut() {
            *next += count;
        }
    }

    fn write(&mut self, f: &mut fmt::Formatter<'_>, count: usize, error: &Error) -> fmt::Result {
        let separator = std::mem::replace(&mut self.separator, ';');
        if let Some((first, around)) = self.numbers.split_last() {
            let around: String = around.iter().map(|number| format!("{number}.")).collect();
            let last = first + count - 1;
            match count {
                1 => write!(f, "{separator} branch {around}{first}: {error}")?,
                _ => write!(
                    f,
                    "{separator} branches {around}{first} to {around}{last}: {error}"
                )?,
            }
        }
        self.pass(count);
        Ok(())
    }
}

impl std::error::Error for Several {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        Some(self.first())
    }
}

/// The errors in an error: see [`Error::errors`].
#[derive(Debug, Clone)]
pub struct Errors<'a> {
    /// Of an error that is not several.
    one: Option<&'a Error>,
    /// What is left of the current run.
    run: Run,
    runs: std::slice::Iter<'a, Run>,
    carried: std::slice::Iter<'a, Error>,
}

const NOTHING: Run = Run::new(FINE, 0);

impl<'a> Errors<'a> {
    pub(super) fn of(error: &'a Error) -> Errors<'a> {
        match error {
            Error::Several(several) => several.errors(),
            one => Errors {
                one: Some(one),
                run: NOTHING,
                runs: [].iter(),
                carried: [].iter(),
            },
        }
    }
}

impl<'a> Iterator for Errors<'a> {
    type Item = &'a Error;

    fn next(&mut self) -> Option<&'a Error> {
        if let Some(one) = self.one.take() {
            return Some(one);
        }
        loop {
            while self.run.count() == 0 {
                self.run = *self.runs.next()?;
            }
            let kind = self.run.kind();
            self.run = Run::new(kind, self.run.count() - 1);
            match kind {
                CARRIED => return self.carried.next(),
                FINE | OPEN | CLOSE => self.run = NOTHING,
                plain => return plain_error(plain),
            }
        }
    }
}

impl FusedIterator for Errors<'_> {}

/// What a construct's branches failed with so far, added in written order.
#[derive(Debug, Default)]
pub struct Failures {
    /// The error of the one branch that failed, while there is one.
    only: Option<Error>,
    has_failed: bool,
    /// How many branches have not failed since the last that did.
    fine: usize,
    several: Several,
}

impl Failures {
    /// Adding this many branches allocates nothing, but if they fail with errors that are allocated
    /// themselves.
    pub fn with_room_for(branches: usize) -> Failures {
        let mut failures = Failures::default();
        failures.several.runs.reserve_exact(branches);
        failures
    }

    /// Adds the next branch.
    pub fn add(&mut self, error: Option<Error>) {
        let Some(error) = error else {
            self.fine += 1;
            return;
        };
        let is_first = !std::mem::replace(&mut self.has_failed, true);
        if let Some(first) = self.only.take() {
            self.several.add(first);
        }
        self.several.add_run(FINE, std::mem::take(&mut self.fine));
        match is_first {
            true => self.only = Some(error),
            false => self.several.add(error),
        }
    }

    /// Returns the error of the construct: that of the branch if only one has failed.
    pub fn take_error(&mut self) -> Option<Error> {
        match self.only.take() {
            None if self.has_failed => Some(Error::Several(std::mem::take(&mut self.several))),
            only => only,
        }
    }
}

#[cfg(test)]
mod tests;
