//! `luna list`: what runs, and what is between the programs.

use super::survey::Survey;
use super::table;
use crate::args;
use crate::failure::Failure;
use crate::print::{print, say};
use clap::Args;
use glob::Pattern;
use std::process::ExitCode;
use std::thread::sleep;
use std::time::Duration;

/// The options of `luna list`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
It looks from outside: but for --clean-up it takes no lock and writes nothing, and no program notices it.

A system has a name here if it is announced: `system.announce()`, or LUNA_ANNOUNCE=1 in its environment.

JSON: programs (pid, program, systems), channels (name, kind, type, sender, receiver, state, openings, sent, taken, per_second),
blackboards (name, writer, readers, has_readers, keys), interval_s, left_behind, hidden. With --watch, one object a line.

Exit codes: 0 listed, 1 standard output is closed, or the folder of shared memory cannot be read, 2 bad arguments.")]
pub(crate) struct Arguments {
    /// Only channels and blackboards of these names, as cell/*,arm/state, and their programs
    #[arg(value_name = "NAMES", value_delimiter = ',')]
    names: Vec<Pattern>,
    /// The time between the two looks that rates are made of, in seconds; 0 for one look, without
    /// rates
    #[arg(long, value_name = "S", default_value = "0.5", value_parser = args::instant)]
    interval: Duration,
    /// Print it again each so many seconds, until Ctrl-C
    #[arg(long, value_name = "S", value_parser = args::seconds, allow_negative_numbers = true)]
    watch: Option<f64>,
    /// Remove what killed programs have left, first: the names that are counted as left behind
    #[arg(long)]
    clean_up: bool,
    /// Print one JSON object and nothing else
    #[arg(long)]
    json: bool,
}

/// Prints it.
pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    if arguments.clean_up {
        luna_ipc::clean_up().map_err(Failure::SharedMemory)?;
    }
    loop {
        let survey = Survey::of(&arguments.names, arguments.interval);
        let survey = survey.map_err(Failure::SharedMemory)?;
        print(arguments.json, &survey, || [table::draw(&survey)])?;
        let Some(pause) = arguments.watch else {
            return Ok(ExitCode::SUCCESS);
        };
        if !arguments.json {
            say("\n")?;
        }
        sleep(Duration::from_secs_f64(pause).saturating_sub(arguments.interval));
    }
}
