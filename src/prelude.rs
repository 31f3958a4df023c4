//! What most programs use: `use luna::prelude::*;`.

pub use crate::{
    Alternative, Barrier, Buffer, Parameter, Policy, Process, Receiver, Sender, Signal, System,
    alt, par, pri_alt, pri_par,
};
