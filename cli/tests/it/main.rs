//! Tests of the command `luna`, run as its users run it. One program; a module a subject.

mod book;
mod card;
mod command;
mod convert;
#[cfg(target_os = "linux")]
mod corner_applications;
mod doctor;
mod evidence;
#[cfg(feature = "foxglove")]
mod foxglove;
#[cfg(target_os = "linux")]
mod generate;
mod listing;
mod merge;
mod model;
mod model_editor;
mod model_from;
mod model_trace;
#[cfg(target_os = "linux")]
mod model_traces;
mod model_tutorial;
#[cfg(target_os = "linux")]
mod new;
#[cfg_attr(
    not(target_os = "linux"),
    allow(dead_code, reason = "most of its users are tests of Linux")
)]
mod package;
#[cfg(target_os = "linux")]
mod production_cell;
#[cfg(target_os = "linux")]
mod programs;
mod record;
mod recordings;
#[cfg(target_os = "linux")]
mod replay;
mod run;
mod schedule;
mod schedule_recorded;
mod scope;
mod trace;
mod verdict;

/// Whether the tests are to be longer: LUNA_LONG=1.
fn is_long() -> bool {
    std::env::var("LUNA_LONG").is_ok_and(|long| long == "1")
}
