//! `luna model`: models of systems.

mod check;
mod draw;
mod edit;
mod found;
mod from;
mod generate;
mod names;
mod new;
mod recording;
mod schedule;
mod trace;

use crate::failure::{Failure, failed};
use crate::result_file;
use clap::Subcommand;
use luna_model::{Model, Problem};
use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

/// The exit code if nothing is wrong as far as is known, but that is not all.
const UNKNOWN: u8 = 4;

/// What can be done with a model.
#[derive(Debug, Clone, Subcommand)]
pub(crate) enum Command {
    /// Writes a small model with comments, to begin with
    New(new::Arguments),
    /// Looks at all states of a model: deadlocks, livelocks, assertions, branches that no run takes
    Check(check::Arguments),
    /// Draws the composition and the communication of a model
    Draw(draw::Arguments),
    /// Edits a model in the browser: processes, channels, properties, findings, times
    Edit(edit::Arguments),
    /// Bounds when each cycle is over, and says whether that is in time
    Schedule(schedule::Arguments),
    /// Compares a recording with a model: are its communications a trace of the model?
    Trace(trace::Arguments),
    /// Writes a model of what a recording has: its processes and channels, to be refined
    From(from::Arguments),
    /// Generates a Rust package that runs a model
    Generate(generate::Arguments),
}

/// Does it.
pub(crate) fn run(command: &Command) -> Result<ExitCode, Failure> {
    match command {
        Command::New(arguments) => new::run(arguments),
        Command::Check(arguments) => check::run(arguments),
        Command::Draw(arguments) => draw::run(arguments),
        Command::Edit(arguments) => edit::run(arguments),
        Command::Schedule(arguments) => schedule::run(arguments),
        Command::Trace(arguments) => trace::run(arguments),
        Command::From(arguments) => from::run(arguments),
        Command::Generate(arguments) => generate::run(arguments),
    }
}

/// The drawing of the model in a file, as SVG.
pub(crate) fn drawing(path: &Path) -> Result<String, Failure> {
    Ok(read(path)?.to_svg())
}

fn read(path: &Path) -> Result<Model, Failure> {
    let text = fs::read_to_string(path).map_err(failed(path))?;
    Model::parse(&path.display().to_string(), &text).map_err(problem)
}

/// A model is wrong: with its file, line and column.
fn problem(problem: Problem) -> Failure {
    Failure::Unusable(problem.to_string())
}

/// Writes what is made of a model anew each time, and replaces the last one.
fn write(path: &Path, text: &str) -> Result<(), Failure> {
    result_file::write(path, text, true)
}

/// Writes a file that is not there yet.
fn write_new(path: &Path, text: &str) -> Result<(), Failure> {
    let written = fs::File::create_new(path).and_then(|mut file| file.write_all(text.as_bytes()));
    written.map_err(failed(path))
}
