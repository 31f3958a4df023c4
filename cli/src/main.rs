//! The `luna` command: measurements of a machine, whether it is fit, projects, recordings and
//! models.

mod apart;
mod args;
mod beside;
mod convert;
mod doctor;
mod jitter;
mod model;
mod new;
mod package;
#[cfg(target_os = "linux")]
mod programs;
mod record;
mod scope;

use args::{Arguments, Command};
use clap::{CommandFactory, FromArgMatches};
use luna_command::alloc;
use luna_command::{columns, exit, failure, place, print, progress, report, result_file, text};
use std::process::ExitCode;

/// Counts allocations, which the real-time path must not make.
#[global_allocator]
static ALLOCATOR: alloc::Counting = alloc::Counting::new(luna::realtime::on_path);

fn main() -> ExitCode {
    // SAFETY: no other thread has been started.
    unsafe { luna_command::begin() };
    let parsed = Arguments::command().after_help(apart::help()).get_matches();
    let arguments = Arguments::from_arg_matches(&parsed).unwrap_or_else(|error| error.exit());
    luna_command::end(run(arguments.command))
}

fn run(command: Command) -> Result<ExitCode, failure::Failure> {
    match command {
        Command::Demo(demo) => apart::run("demo", &demo.words),
        Command::Jitter(arguments) => jitter::run(&arguments, &ALLOCATOR),
        Command::Doctor(arguments) => doctor::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Record(arguments) => record::run(&arguments),
        Command::Scope(arguments) => scope::run(&arguments),
        Command::New(arguments) => new::run(&arguments),
        Command::Completions(completions) => complete(&completions),
        Command::Model(command) => model::run(&command),
        #[cfg(target_os = "linux")]
        Command::List(arguments) => programs::list::run(&arguments),
        #[cfg(target_os = "linux")]
        Command::Echo(arguments) => programs::echo::run(&arguments),
        #[cfg(target_os = "linux")]
        Command::Send(arguments) => programs::send::run(&arguments),
    }
}

fn complete(completions: &args::Completions) -> Result<ExitCode, failure::Failure> {
    let mut text = Vec::new();
    clap_complete::generate(
        completions.shell,
        &mut Arguments::command(),
        "luna",
        &mut text,
    );
    print::say(&String::from_utf8_lossy(&text))?;
    Ok(ExitCode::SUCCESS)
}
