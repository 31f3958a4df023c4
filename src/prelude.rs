//! What most programs use: `use luna::prelude::*;`.

pub use crate::{Buffer, Policy, Process, Receiver, Sender, System, par};
