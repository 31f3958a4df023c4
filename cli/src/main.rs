//! The `luna` command: the demo, measurements of a machine, and whether it is fit.

mod alloc;
mod args;
mod beside;
mod card;
mod columns;
mod convert;
mod demo;
mod doctor;
mod exit;
mod failure;
mod histogram_text;
mod jitter;
#[cfg_attr(not(target_os = "linux"), path = "no_joystick.rs")]
mod joystick;
mod output;
mod place;
#[cfg(target_os = "linux")]
mod production_cell;
mod record;
mod report;
mod scope;
mod scope_parameters;
mod text;

#[cfg(target_os = "linux")]
use args::Machine;
use args::{Arguments, Command};
use clap::Parser;
use std::process::ExitCode;

/// Counts allocations, which the real-time path must not make.
#[global_allocator]
static ALLOCATOR: alloc::Counting = alloc::Counting::new(luna::realtime::on_path);

fn main() -> ExitCode {
    let outcome = match Arguments::parse().command() {
        Command::Demo(demos) => match &demos.machine {
            None => demo::run(&demos.jiwy, &ALLOCATOR),
            #[cfg(target_os = "linux")]
            Some(Machine::ProductionCell(arguments)) => production_cell::run(arguments),
            #[cfg(target_os = "linux")]
            Some(Machine::ProductionCellUnit(arguments)) => production_cell::run_unit(arguments),
            #[cfg(not(target_os = "linux"))]
            Some(machine) => match *machine {},
        },
        Command::Jitter(arguments) => jitter::run(&arguments, &ALLOCATOR),
        Command::Doctor(arguments) => doctor::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Record(arguments) => record::run(&arguments),
        Command::Scope(arguments) => scope::run(&arguments),
    };
    match outcome {
        Ok(code) => code,
        Err(failure) => {
            eprintln!("luna: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}
