//! The command line.

mod jitter;
mod recordings;
#[cfg(test)]
mod tests;

pub(crate) use jitter::Jitter;
pub(crate) use luna_command::SCOPE;
pub(crate) use luna_command::place::Placement;
pub(crate) use luna_command::values::{instant, seconds};
pub(crate) use recordings::{Clock, Convert, Format, Messages, Record, Scope, Selection};

use clap::{Args, Parser, Subcommand};
use std::ffi::OsString;
use std::path::PathBuf;

/// LUNA: hard real-time processes and channels, and the tools around them.
#[derive(Debug, Parser)]
#[command(name = "luna", version, arg_required_else_help = true)]
pub(crate) struct Arguments {
    /// What is to be done.
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// What the program can do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Runs a simulated machine and shows how well it kept time: a pan-tilt camera, or another
    Demo(Apart),
    /// Measures how late a periodic process wakes up, as cyclictest does
    Jitter(Jitter),
    /// Says whether this machine is fit for hard real time, and what to do about what is not
    Doctor(Doctor),
    /// Makes CSV, an MCAP file or a Perfetto trace of a recording
    Convert(Convert),
    /// Receives what other programs record (LUNA_LOG=tcp://HOST:PORT), also of other computers, and
    /// writes a file for each
    Record(Record),
    /// Shows a recording in the browser, as it was while it was made
    Scope(Scope),
    /// Makes a project that runs at once, with tests, a system file and CI
    New(crate::new::Arguments),
    /// Makes, checks and draws models of systems
    #[command(subcommand)]
    Model(crate::model::Command),
    /// Lists the systems, programs and channels between programs that are alive on this computer,
    /// with their rates
    #[cfg(target_os = "linux")]
    List(crate::programs::list::Arguments),
    /// Prints the values of a channel between programs, as its receiver, or of a blackboard
    #[cfg(target_os = "linux")]
    Echo(crate::programs::echo::Arguments),
    /// Sends values to a channel between programs, as its sender, or sets keys of a blackboard
    #[cfg(target_os = "linux")]
    Send(crate::programs::send::Arguments),
}

/// The words for a program that `luna` starts.
#[derive(Debug, Clone, Args)]
#[command(disable_help_flag = true)]
pub(crate) struct Apart {
    /// What `luna demo --help` lists
    #[arg(
        trailing_var_arg = true,
        allow_hyphen_values = true,
        value_name = "OPTIONS"
    )]
    pub(crate) words: Vec<OsString>,
}

/// The options of `luna doctor`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
Exit codes: 0 fit, or fit with findings (nothing is bad, but something could be better), 1 unfit (something is bad), 2 bad arguments,
3 broken (a self-test failed or hung), 4 unknown (nothing is bad, but too little could be read to say that it is fit).

JSON: schema, version, fitness (fit, fit_with_findings, unfit, broken, unknown), exit_code, core, this_machine,
counts (good, could_be_better, bad, unknown), self_tests (passed, failed, not_run), findings. A finding: name (stable), part (machine, measurement, self_test), verdict (good, could_be_better,
bad, unknown), read, from, why, advice (or null), and for a measurement ns (samples, min, p50, p99, max).")]
pub(crate) struct Doctor {
    /// The core that is to run real-time executors [default: the last isolated one, else the last]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub(crate) core: Option<usize>,
    /// Measure a shorter time: half a second instead of two
    #[arg(long)]
    pub(crate) quick: bool,
    /// Do not measure
    #[arg(long)]
    pub(crate) no_measure: bool,
    /// Do not test the library's components
    #[arg(long)]
    pub(crate) no_self_test: bool,
    /// Say of good findings too why they matter
    #[arg(long)]
    pub(crate) explain: bool,
    /// Read another machine's files (proc, sys, ...) below DIR; nothing is measured or tested then
    #[arg(long, value_name = "DIR")]
    pub(crate) root: Option<PathBuf>,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub(crate) json: bool,
}
