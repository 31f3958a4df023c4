//! Tests of executors, tasks and threads. One program; a module a subject.

#[path = "../support/mod.rs"]
#[macro_use]
mod support;

#[path = "../support/files.rs"]
mod file_support;

mod blocking_calls;
mod endings;
mod exit_value;
mod files;
mod files_before_the_start;
mod files_shared;
mod foreign_combinators;
mod interference;
mod joining;
mod levels;
mod observing;
mod operations_outlive_their_process;
mod os_threads;
mod quiescence;
mod spawning;
mod stopping;
mod timers;
mod wakers_outlive_the_executor;
mod wakes_from_elsewhere;
mod wakes_of_the_ended;
mod ways_to_wake;
