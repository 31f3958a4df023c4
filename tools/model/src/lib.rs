//! Models of LUNA systems: read from a file, checked, drawn, [scheduled](schedule), generated as
//! Rust, compared with what runs. The page `docs/model.md` describes the file for those that write
//! it; `luna model` is the command.
//!
//! ```
//! let model = luna_model::Model::parse("first.toml", luna_model::TEMPLATE)?;
//! let explored = model.explore(model.max_states());
//! assert!(explored.is_complete && explored.findings.is_empty());
//! # Ok::<(), luna_model::Problem>(())
//! ```
//!
//! # Why bodies are text
//!
//! What a process does is a text in a string, `loop { alt { in? => eat | after => wait } }`, not
//! nested tables. A sequence of ten steps is ten short lines instead of ten tables with a key for
//! the kind of each; a step that is added or removed is one line of a difference; the operators are
//! those of CSP. What is a set of named things (processes, channels, parts, executors) is TOML's
//! tables, so that other tools read and write the structure without this language.
//!
//! # From the file to the verdict
//!
//! `file` reads tables, `language` the texts in them. `elaborate` lays out arrays and compositions
//! and resolves names (`bind`, `properties`, `deployment`); `compile` makes places and steps of
//! bodies. The result is a `network`, which most else works on: `explore` gives it its meaning,
//! `spin` translates it to Promela, `cspm` to CSPm, and `draw` shows it. `schedule` bounds response
//! times. `trace` compares it with a recording, `running` with a system, and `recorded` makes a file
//! of either. `generate` writes it in Rust: the wiring from the network, the bodies from their text.
//! [`edit`] changes the text of a file.
//!
//! # The meaning
//!
//! - A rendezvous takes place when both sides are ready for it, each by a plain operation or a
//!   guard. A buffer takes and gives values by its kind.
//! - All guards that are ready may be chosen: a check of `pri_alt` covers what any priority does.
//!   `skip` and `after` may always be chosen.
//! - A process that has done its last step drops its ends some time later. A receiver of which
//!   all senders have ended gets what the buffer holds; after that, and in a sender of which all
//!   receivers have ended, the operation fails and ends its process.
//! - A branch of `par` that fails makes its siblings' operations fail, also those that might still
//!   find a partner; when all branches have ended, the process ends.
//! - What a process does between two operations is one step with the operation before it.
//!
//! States are explored breadth first, without a reduction: the way to what is found is a shortest
//! one.

mod bind;
mod compile;
mod cspm;
mod deployment;
mod draw;
pub mod edit;
mod elaborate;
mod explore;
mod file;
mod generate;
mod language;
mod memory;
mod model;
mod network;
mod properties;
mod recorded;
mod running;
pub mod schedule;
mod spin;
mod text;
mod trace;

pub use cspm::CspmError;
pub use explore::words::communication;
pub use explore::{
    DEFAULT_MAX_STATES, Exploration, Finding, FindingKind, Limit, Limits, StepParts, Stuck,
    TraceStep, Unreached,
};
pub use generate::{File, Luna, is_luna, package_name};
pub use memory::default_memory;
pub use model::{Model, TEMPLATE};
pub use recorded::{Recorded, RecordedChannel, RecordedExecutor, RecordedProcess, name_in_model};
pub use running::{Difference, SystemModel, Wiring};
pub use spin::SpinCheck;
pub use spin::run::SpinError;
pub use text::Problem;
pub use trace::{Communication, Party, Rejected, TraceOptions, TraceVerdict, Traced};
