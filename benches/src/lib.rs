//! LUNA compared with its peers, in the same run on the same machine.
//!
//! A *case* is one scenario with one peer. It is measured in *blocks*: a block performs a number of
//! operations, checks their result, and returns how long they took. [`harness::run`] repeats the
//! blocks of all cases round by round, so that disturbances affect all cases alike.
//!
//! A scenario is written once, over three small traits: [`processes`] are futures over the ends of
//! a [channel](channels::Channel), and an [executor](executors::Executor) runs them. A row of a
//! table is then one combination, such as `commstime::<Smol, AsyncChannel>`.
//!
//! Each bench also measures [primitives] of the machine, and peers in [other languages](external)
//! where they are installed. Some cases have [goals](harness::Goal). `all-benches` runs every
//! bench, and makes a [page] of the results.
//!
//! Like all benchmarks, these are limited: they show the cost of a communication when nothing else
//! happens.

pub mod channels;
pub mod cores;
pub mod executors;
pub mod external;
pub mod harness;
pub mod machine;
pub mod networks;
pub mod ours;
pub mod page;
pub mod primitives;
pub mod processes;
