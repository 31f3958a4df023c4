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
#[cfg(target_os = "linux")]
mod head;
mod histogram_text;
mod jitter;
#[cfg_attr(not(target_os = "linux"), path = "no_joystick.rs")]
mod joystick;
mod model;
mod new;
mod output;
mod package;
mod place;
mod print;
#[cfg(target_os = "linux")]
mod production_cell;
#[cfg(target_os = "linux")]
mod programs;
mod progress;
mod record;
mod report;
mod result_file;
mod scope;
mod scope_parameters;
mod text;
#[cfg(target_os = "linux")]
mod tulip;

#[cfg(target_os = "linux")]
use args::Machine;
use args::{Arguments, Command};
use clap::Parser;
use std::process::ExitCode;

/// Counts allocations, which the real-time path must not make.
#[global_allocator]
static ALLOCATOR: alloc::Counting = alloc::Counting::new(luna::realtime::on_path);

fn main() -> ExitCode {
    // The file is of the user's programs, and has names that no system of this command has.
    // SAFETY: no other thread has been started, so none reads the environment.
    unsafe { std::env::remove_var("LUNA_DEPLOYMENT") };
    ignore_the_limit_of_files();
    let outcome = match Arguments::parse().command() {
        Command::Demo(demos) => run_demo(&demos),
        Command::Jitter(arguments) => jitter::run(&arguments, &ALLOCATOR),
        Command::Doctor(arguments) => doctor::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Record(arguments) => record::run(&arguments),
        Command::Scope(arguments) => scope::run(&arguments),
        Command::New(arguments) => new::run(&arguments),
        Command::Model(command) => model::run(&command),
        #[cfg(target_os = "linux")]
        Command::List(arguments) => programs::list::run(&arguments),
        #[cfg(target_os = "linux")]
        Command::Echo(arguments) => programs::echo::run(&arguments),
        #[cfg(target_os = "linux")]
        Command::Send(arguments) => programs::send::run(&arguments),
    };
    match outcome {
        Ok(code) => code,
        Err(failure) => {
            eprintln!("luna: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}

fn run_demo(demos: &args::Demos) -> Result<ExitCode, failure::Failure> {
    #[cfg(target_os = "linux")]
    match &demos.machine {
        Some(Machine::ProductionCell(arguments)) => return production_cell::run(arguments),
        Some(Machine::ProductionCellUnit(unit)) => return production_cell::run_unit(unit),
        Some(Machine::Head(arguments)) => return head::run(arguments, &ALLOCATOR),
        Some(Machine::HeadVision(arguments)) => return head::run_vision(arguments),
        Some(Machine::Tulip(arguments)) => return tulip::run(arguments, &ALLOCATOR),
        Some(Machine::TulipOperator(arguments)) => return tulip::run_operator(arguments),
        None => {}
    }
    demo::run(&demos.jiwy, &ALLOCATOR)
}

/// A file that reaches `RLIMIT_FSIZE` is an error of the write, which is reported, as a full disk is.
fn ignore_the_limit_of_files() {
    #[cfg(unix)]
    {
        use nix::sys::signal::{SigHandler, Signal, signal};
        // SAFETY: to ignore a signal runs nothing. It fails for no signal that can be ignored.
        let _ = unsafe { signal(Signal::SIGXFSZ, SigHandler::SigIgn) };
    }
}
