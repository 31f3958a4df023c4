//! A model file as it is written.

mod read;
mod values;

use crate::language::body::{Block, Named, Span};
use crate::language::expr::Expr;
use crate::language::parser::Path;
use crate::language::temporal::Formula;
use crate::network::Buffering;
use std::time::Duration;

pub(crate) use read::read;

/// All that a file says.
#[derive(Debug, Default)]
pub(crate) struct Document {
    pub(crate) name: Option<String>,
    pub(crate) definitions: Vec<Definition>,
    /// Where `[system]` stands, and what is in it.
    pub(crate) system: Option<(Span, Composition)>,
    pub(crate) deployment: Deployment,
    pub(crate) max_states: Option<usize>,
    pub(crate) always: Vec<(Named, Expr<Path>)>,
    pub(crate) ltl: Vec<(Named, Formula<Path>)>,
    /// By so much a release may be late.
    pub(crate) latency: Option<Duration>,
}

#[derive(Debug)]
pub(crate) struct Definition {
    pub(crate) name: Named,
    pub(crate) parameters: Vec<(Named, i32)>,
    pub(crate) ports: Vec<(Named, Side)>,
    pub(crate) variables: Vec<(Named, Range)>,
    pub(crate) content: Content,
}

#[derive(Debug)]
pub(crate) enum Content {
    Body(Block),
    Composition(Composition),
}

#[derive(Debug, Default)]
pub(crate) struct Composition {
    pub(crate) channels: Vec<Channel>,
    pub(crate) parts: Vec<Part>,
}

#[derive(Debug)]
pub(crate) struct Channel {
    pub(crate) name: Named,
    pub(crate) array: Option<Expr<Path>>,
    pub(crate) kind: Buffering,
    /// The type's name as written, and its values if the check is to know them.
    pub(crate) type_name: String,
    pub(crate) values: Option<Range>,
}

#[derive(Debug)]
pub(crate) struct Part {
    pub(crate) name: Named,
    pub(crate) process: Named,
    pub(crate) array: Option<Expr<Path>>,
    pub(crate) bind: Vec<(Named, Path)>,
    pub(crate) set: Vec<(Named, Expr<Path>)>,
    pub(crate) run: Run,
    /// Where it is drawn.
    pub(crate) at: Option<At>,
}

/// Where the upper left corner of a box is within what the part is in, in pixels.
pub(crate) type At = (i32, i32);

/// How a part runs. What is not stated is that of the part around it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Run {
    pub(crate) priority: Option<u8>,
    pub(crate) period: Option<Duration>,
    pub(crate) on: Option<Named>,
    /// The longest execution time of a job, and the longest poll.
    pub(crate) cost: Option<Duration>,
    pub(crate) longest_poll: Option<Duration>,
    pub(crate) deadline: Option<Duration>,
}

/// Which end of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Side {
    Send,
    Receive,
}

impl Side {
    pub(crate) const BOTH: [Self; 2] = [Self::Send, Self::Receive];
}

/// Values from `low` to `high`, of which a variable begins with `first`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Range {
    pub(crate) low: Expr<Path>,
    pub(crate) high: Expr<Path>,
    pub(crate) first: Option<Expr<Path>>,
    /// It is `bool`, and not `0..1`.
    pub(crate) is_bool: bool,
}

/// Where processes run.
#[derive(Debug, Default)]
pub(crate) struct Deployment {
    pub(crate) hosts: Vec<Named>,
    /// With their hosts.
    pub(crate) programs: Vec<(Named, Option<Named>)>,
    pub(crate) executors: Vec<Executor>,
}

/// An executor or a thread.
#[derive(Debug)]
pub(crate) struct Executor {
    pub(crate) name: Named,
    pub(crate) is_thread: bool,
    pub(crate) program: Option<Named>,
    pub(crate) core: Option<u16>,
    pub(crate) policy: Option<String>,
}
