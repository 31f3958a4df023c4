//! Several errors that came of one construct.

mod runs;

use super::Error;
use runs::{Kind, Runs};
use std::fmt;
use std::iter::FusedIterator;

/// The errors of a parallel construct in which more than one branch failed, in the order in which
/// the branches are written.
///
/// Errors that are no more than their kind (poisoned, closed, full, empty, timeout, cancelled) take
/// no memory of their own: a network in which all branches end poisoned or closed allocates
/// nothing. Up to sixteen runs of equal neighbours are stored in the error itself. That is enough
/// for any [`par!`](crate::par) with branches that are no constructs themselves; the constructs
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
#[derive(Clone, PartialEq, Eq)]
pub struct Several {
    runs: Runs,
    carried: Vec<Error>,
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
        Errors(Inner::Several {
            runs: self.runs.packed().iter(),
            kind: Kind::Fine,
            left: 0,
            carried: self.carried.iter(),
        })
    }

    fn add(&mut self, error: Error) {
        match (kind_of(&error), error) {
            (Kind::Open, Error::Several(nested)) => {
                self.runs.add_nested(&nested.runs);
                self.carried.extend(nested.carried);
            }
            (Kind::Carried, error) => {
                self.runs.add(Kind::Carried, 1);
                self.carried.push(error);
            }
            (kind, _) => self.runs.add(kind, 1),
        }
    }
}

fn kind_of(error: &Error) -> Kind {
    match error {
        Error::Poisoned => Kind::Poisoned,
        Error::Closed => Kind::Closed,
        Error::Full => Kind::Full,
        Error::Empty => Kind::Empty,
        Error::Timeout => Kind::Timeout,
        Error::Cancelled => Kind::Cancelled,
        Error::Several(_) => Kind::Open,
        _ => Kind::Carried,
    }
}

/// The error that is no more than this kind.
fn plain(kind: Kind) -> Option<&'static Error> {
    static POISONED: Error = Error::Poisoned;
    static CLOSED: Error = Error::Closed;
    static FULL: Error = Error::Full;
    static EMPTY: Error = Error::Empty;
    static TIMEOUT: Error = Error::Timeout;
    static CANCELLED: Error = Error::Cancelled;
    match kind {
        Kind::Poisoned => Some(&POISONED),
        Kind::Closed => Some(&CLOSED),
        Kind::Full => Some(&FULL),
        Kind::Empty => Some(&EMPTY),
        Kind::Timeout => Some(&TIMEOUT),
        Kind::Cancelled => Some(&CANCELLED),
        Kind::Fine | Kind::Carried | Kind::Open | Kind::Close => None,
    }
}

impl fmt::Debug for Several {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// Each error with the number of its branch, counted from 1; equal neighbours are listed once. A
/// branch within a branch has both numbers: `2.1`.
impl fmt::Display for Several {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} errors in a parallel construct", self.len())?;
        let mut carried = self.carried.iter();
        // The branch that comes next, in each of the constructs that are open.
        let mut next = vec![1usize];
        let mut separator = ':';
        let mut runs = self.runs.iter().peekable();
        while let Some((kind, mut count)) = runs.next() {
            match kind {
                Kind::Open => {
                    next.push(1);
                    continue;
                }
                Kind::Close => {
                    next.pop();
                    step(&mut next, 1);
                    continue;
                }
                Kind::Fine => {
                    step(&mut next, count);
                    continue;
                }
                _ => {}
            }
            if let Some(error) = plain(kind) {
                // A long run is stored in parts.
                while let Some((_, more)) = runs.next_if(|&(next, _)| next == kind) {
                    count += more;
                }
                write_error(f, separator, &next, count, error)?;
                step(&mut next, count);
            } else {
                for error in carried.by_ref().take(count) {
                    write_error(f, separator, &next, 1, error)?;
                    step(&mut next, 1);
                    separator = ';';
                }
            }
            separator = ';';
        }
        Ok(())
    }
}

impl std::error::Error for Several {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        Some(self.first())
    }
}

fn step(next: &mut [usize], count: usize) {
    if let Some(branch) = next.last_mut() {
        *branch += count;
    }
}

fn write_error(
    f: &mut fmt::Formatter<'_>,
    separator: char,
    first: &[usize],
    count: usize,
    error: &Error,
) -> fmt::Result {
    let (around, branch) = first.split_at(first.len() - 1);
    let number = |f: &mut fmt::Formatter<'_>, branch: usize| {
        around
            .iter()
            .try_for_each(|number| write!(f, "{number}."))?;
        write!(f, "{branch}")
    };
    write!(
        f,
        "{separator} branch{} ",
        if count > 1 { "es" } else { "" }
    )?;
    number(f, branch[0])?;
    if count > 1 {
        f.write_str(" to ")?;
        number(f, branch[0] + count - 1)?;
    }
    write!(f, ": {error}")
}

/// The errors in an error: see [`Error::errors`].
#[derive(Debug, Clone)]
pub struct Errors<'a>(Inner<'a>);

#[derive(Debug, Clone)]
enum Inner<'a> {
    One(Option<&'a Error>),
    Several {
        runs: std::slice::Iter<'a, u16>,
        kind: Kind,
        left: usize,
        carried: std::slice::Iter<'a, Error>,
    },
}

impl<'a> Errors<'a> {
    pub(super) fn of(error: &'a Error) -> Errors<'a> {
        match error {
            Error::Several(several) => several.errors(),
            one => Errors(Inner::One(Some(one))),
        }
    }
}

impl<'a> Iterator for Errors<'a> {
    type Item = &'a Error;

    fn next(&mut self) -> Option<&'a Error> {
        match &mut self.0 {
            Inner::One(error) => error.take(),
            Inner::Several {
                runs,
                kind,
                left,
                carried,
            } => loop {
                if *left == 0 {
                    (*kind, *left) = runs::unpack(*runs.next()?);
                }
                match kind {
                    Kind::Fine | Kind::Open | Kind::Close => *left = 0,
                    Kind::Carried => {
                        *left -= 1;
                        return carried.next();
                    }
                    _ => {
                        *left -= 1;
                        return plain(*kind);
                    }
                }
            },
        }
    }
}

impl FusedIterator for Errors<'_> {}

/// What a construct's branches failed with so far, added in written order.
pub(crate) struct Failures {
    first: Option<Error>,
    /// How many branches were added before the first that failed, or in all while none has.
    before: usize,
    fine_after: usize,
    several: Several,
}

impl Failures {
    pub(crate) fn new() -> Failures {
        Failures::with_room_for(0)
    }

    /// Adding this many branches allocates nothing, but if they fail with errors that are allocated
    /// themselves.
    pub(crate) fn with_room_for(branches: usize) -> Failures {
        Failures {
            first: None,
            before: 0,
            fine_after: 0,
            several: Several {
                runs: Runs::with_room_for(branches),
                carried: Vec::new(),
            },
        }
    }

    /// Adds the next branch.
    pub(crate) fn add(&mut self, error: Option<Error>) {
        let has_at_most_one = self.several.runs.packed().is_empty();
        match (error, &self.first) {
            (None, None) if has_at_most_one => self.before += 1,
            (None, Some(_)) => self.fine_after += 1,
            (None, None) => self.several.runs.add(Kind::Fine, 1),
            (Some(error), None) if has_at_most_one => self.first = Some(error),
            (Some(error), None) => self.several.add(error),
            (Some(error), Some(_)) => {
                self.several.runs.add(Kind::Fine, self.before);
                if let Some(first) = self.first.take() {
                    self.several.add(first);
                }
                self.several.runs.add(Kind::Fine, self.fine_after);
                self.several.add(error);
            }
        }
    }

    /// Returns the error of the construct: that of the branch if only one has failed.
    pub(crate) fn take_error(&mut self) -> Option<Error> {
        if self.several.runs.packed().is_empty() {
            self.first.take()
        } else {
            let none = Several {
                runs: Runs::new(),
                carried: Vec::new(),
            };
            Some(Error::Several(std::mem::replace(&mut self.several, none)))
        }
    }
}

#[cfg(test)]
mod tests;
