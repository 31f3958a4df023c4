//! A measured case.

use std::{cell::Cell, fmt, rc::Rc, time::Duration};

use super::goal::Goal;

/// One scenario with one peer.
pub struct Case {
    /// The scenario; cases of the same name are in one table.
    pub name: &'static str,
    /// The measured peer and configuration.
    pub peer: &'static str,
    /// Of one operation, such as `ns/cycle`.
    pub unit: &'static str,
    /// How large the scenario is, where it comes in sizes.
    pub size: Option<u64>,
    pub(super) goals: Vec<Goal>,
    pub(super) block: Block,
    /// The operations of the first block.
    pub(super) first: u64,
    /// Whether each block has as many.
    pub(super) fixed: bool,
    pub(super) apart: bool,
    pub(super) most_blocks: usize,
}

/// The measured function.
pub(super) enum Block {
    /// Performs this many operations, and returns how long they took.
    Timed(Box<dyn FnMut(u64) -> Duration>),
    /// Returns a figure.
    Once(Box<dyn FnMut() -> f64>),
}

impl Case {
    /// A case that is measured by repeated calls of `block`.
    ///
    /// `block` gets a number of operations, performs at least that many, checks their result (it
    /// panics when the result is wrong), and returns how long exactly that number took. Everything
    /// that it started has ended when it returns. It is called on a thread that is not pinned; see
    /// [`on_core`](crate::cores::on_core) and [`on_cores`](crate::cores::on_cores).
    pub fn new(
        name: &'static str,
        peer: &'static str,
        unit: &'static str,
        block: impl FnMut(u64) -> Duration + 'static,
    ) -> Self {
        Self::with(name, peer, unit, Block::Timed(Box::new(block)))
    }

    /// A case in which every block returns one figure in `unit`, by any method.
    pub fn once(
        name: &'static str,
        peer: &'static str,
        unit: &'static str,
        block: impl FnMut() -> f64 + 'static,
    ) -> Self {
        Self::with(name, peer, unit, Block::Once(Box::new(block)))
    }

    /// A case for each row, a name and a unit, of a measurement of several figures: the first case
    /// in a round measures, and the others use its figures.
    pub fn of_one<const ROWS: usize>(
        peer: &'static str,
        rows: [(&'static str, &'static str); ROWS],
        measure: impl Fn() -> [f64; ROWS] + 'static,
    ) -> [Self; ROWS] {
        let measured = Rc::new((measure, Cell::new([None; ROWS])));
        let mut places = 0..ROWS;
        rows.map(|(name, unit)| {
            let (measured, place) = (measured.clone(), places.next().unwrap_or_default());
            Self::once(name, peer, unit, move || {
                let (measure, left) = &*measured;
                let mut figures = left.get();
                if figures[place].is_none() {
                    figures = measure().map(Some);
                }
                let figure = figures[place].take();
                left.set(figures);
                figure.expect("it was measured")
            })
        })
    }

    fn with(name: &'static str, peer: &'static str, unit: &'static str, block: Block) -> Self {
        Case {
            name,
            peer,
            unit,
            size: None,
            goals: Vec::new(),
            block,
            first: 64,
            fixed: false,
            apart: false,
            most_blocks: usize::MAX,
        }
    }

    /// Sets the size: cases of one name and peer with several sizes make a line in a plot.
    pub fn size(mut self, size: u64) -> Self {
        self.size = Some(size);
        self
    }

    /// With a goal, which is printed with what was reached.
    pub fn goal(mut self, goal: Goal) -> Self {
        self.goals.push(goal);
        self
    }

    /// Sets the least number of operations in a block, for a scenario with an expensive set-up.
    pub fn at_least(mut self, operations: u64) -> Self {
        self.first = operations;
        self
    }

    /// With exactly this many operations in each block, however long they take.
    pub fn exactly(mut self, operations: u64) -> Self {
        self.first = operations;
        self.fixed = true;
        self
    }

    /// The limit of blocks.
    pub fn blocks(mut self, most: usize) -> Self {
        self.most_blocks = most;
        self
    }

    /// Uses an operating-system process for each block: its memory is fresh, and a scenario that is
    /// expensive to end can leave that to the system by [`finish`](super::finish).
    pub fn apart(mut self) -> Self {
        self.apart = true;
        self
    }

    /// The name, the peer, and the size.
    pub(super) fn title(&self) -> String {
        let mut title = format!("{}, {}", self.name, self.peer);
        if let Some(size) = self.size {
            title += &format!(", {size}");
        }
        title
    }
}

impl fmt::Debug for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Case")
            .field("title", &self.title())
            .field("unit", &self.unit)
            .finish_non_exhaustive()
    }
}
