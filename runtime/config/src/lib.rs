//! What is stated about a program from outside: the values of its [`parameters`], and the system
//! file ([`deployment`]). Both are read by [`file`](mod@file), which gives errors with their
//! places.

pub mod arguments;
pub mod deployment;
pub mod file;
mod nearest;
pub mod parameters;
