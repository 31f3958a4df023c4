//! Tests of channels and all that communicates. One program; a module a subject.

#![cfg(not(loom))]

#[path = "../common/mod.rs"]
mod common;

mod alternatives;
mod alternatives_anywhere;
mod alternatives_stress;
mod auto_traits;
mod barrier;
mod buffered;
mod call;
mod cancel;
mod close;
mod combinators;
mod compile_errors;
mod condition;
mod elders;
mod ended;
mod errors_give_way;
mod extended;
mod fairness;
mod fast_alternatives;
mod foreign_executors;
mod given_back;
mod hostile;
mod hostile_futures;
mod invariants;
mod late;
mod mutex;
mod order_of_fast_alternatives;
mod output_guards;
mod panicking;
mod poison;
mod priority;
mod registered;
mod rendezvous;
mod semaphore;
mod sequential_model;
mod stream;
mod stress;
mod timeout;
mod timeout_races;
mod waker;
