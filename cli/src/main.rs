//! The `luna` command: the demo, and measurements of a machine.

mod alloc;
mod args;
mod demo;
mod failure;
mod histogram_text;
mod jitter;
mod jiwy;
mod joystick;
mod output;
mod place;
mod report;
mod text;

use args::{Arguments, Command};
use clap::Parser;
use std::process::ExitCode;

/// Counts what the real-time path must not do.
#[global_allocator]
static ALLOCATOR: alloc::Counting = alloc::Counting::new(luna::on_path);

fn main() -> ExitCode {
    let outcome = match Arguments::parse().command() {
        Command::Demo(arguments) => demo::run(&arguments, &ALLOCATOR),
        Command::Jitter(arguments) => jitter::run(&arguments, &ALLOCATOR),
    };
    match outcome {
        Ok(complete) => ExitCode::from(u8::from(!complete)),
        Err(failure) => {
            eprintln!("luna: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}
