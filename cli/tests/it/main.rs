//! Tests of the command `luna`, run as its users run it. One program; a module a subject.

mod card;
mod command;
mod convert;
#[cfg(target_os = "linux")]
mod corner_applications;
mod doctor;
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
mod model_tutorial;
#[cfg(target_os = "linux")]
mod production_cell;
#[cfg(target_os = "linux")]
mod programs;
mod record;
mod recordings;
mod schedule;
mod schedule_recorded;
mod scope;
mod trace;
mod verdict;
