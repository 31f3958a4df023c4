//! The options of `luna demo`.

#[cfg(target_os = "linux")]
use clap::Subcommand;
use clap::{Args, Parser};
use luna_command::SCOPE;
use luna_command::place::Placement;
use luna_command::values::{rate, seconds};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// Where Foxglove looks first: this machine alone can reach it.
#[cfg(feature = "foxglove")]
const FOXGLOVE: &str = "127.0.0.1:8765";

/// `luna demo --strict`: the control loop missed slots.
pub(crate) const SLOTS_MISSED: u8 = 5;

/// What `luna demo --help` says of them.
pub(crate) const EXIT_CODES: &str = "\
Exit codes: 0 complete (--replay: the outputs are the same), 1 not complete, or failed, or --log or --record could not be written
(--replay: the outputs differ), 2 bad arguments or files, 5 complete, but the control loop missed slots (--strict).";

/// What `luna demo` runs: the camera, unless another machine is named.
#[derive(Debug, Clone, Parser)]
#[command(
    name = "luna demo",
    bin_name = "luna demo",
    version,
    args_conflicts_with_subcommands = true
)]
pub(crate) struct Demos {
    #[cfg(target_os = "linux")]
    #[command(subcommand)]
    pub(crate) machine: Option<Machine>,
    #[command(flatten)]
    pub(crate) jiwy: Demo,
}

/// The other machines.
#[cfg(target_os = "linux")]
#[derive(Debug, Clone, Subcommand)]
pub(crate) enum Machine {
    /// Six units in a circle, on one executor, on six threads, as six programs or on six hosts
    ProductionCell(crate::production_cell::Arguments),
    /// One unit of the Production Cell as a program of its own, started by `--deploy programs`
    #[command(hide = true)]
    ProductionCellUnit(crate::production_cell::UnitArguments),
    /// A neck and two eyes that follow a target, with vision that is not real-time
    Head(crate::head::Arguments),
    /// The vision of the head, for another computer: `luna demo head --vision ADDR`
    HeadVision(crate::head::VisionArguments),
    /// A robot with fourteen joints that walks behind a ball
    Tulip(crate::tulip::Arguments),
    /// The operator of TUlip, for another computer: `luna demo tulip --operator ADDR`
    TulipOperator(crate::tulip::OperatorArguments),
}

/// The options of `luna demo`.
#[derive(Debug, Clone, Args)]
#[command(after_help = EXIT_CODES)]
pub(crate) struct Demo {
    /// How long to run, in seconds
    #[arg(long, value_name = "S", default_value = "10", value_parser = seconds, allow_negative_numbers = true)]
    pub(crate) seconds: f64,
    /// Cycles of control in a second
    #[arg(long, value_name = "HZ", default_value_t = 1000, value_parser = rate, allow_negative_numbers = true)]
    pub(crate) rate: u32,
    #[command(flatten)]
    pub(crate) place: Placement,
    /// A CSV file with the columns time (s), pan and tilt (-1 to 1), or an input device
    /// (/dev/input/event0) [default: such a file within the program]
    #[arg(long, value_name = "FILE")]
    pub(crate) joystick: Option<PathBuf>,
    /// On a virtual clock: time jumps to the next cycle when all is computed, and every run is the
    /// same
    #[arg(long = "virtual")]
    pub(crate) on_virtual_clock: bool,
    /// Record signals, messages and events, for `luna convert` and `luna scope` (.luna)
    #[arg(long, value_name = "FILE", conflicts_with = "replay")]
    pub(crate) log: Option<PathBuf>,
    /// Write a replay log (.replay): what was not determined in the run, for --replay
    #[arg(long, value_name = "FILE")]
    pub(crate) record: Option<PathBuf>,
    /// Replace the files of --log and --record if they are there: what is in them is lost
    #[arg(long)]
    pub(crate) replace: bool,
    /// Do the run of a replay log again, on a virtual clock, and say whether its outputs are the
    /// same, or at which event they differ
    #[arg(long, value_name = "FILE", conflicts_with_all = ["record", "seconds", "rate", "joystick", "calibrated", "core", "policy", "parameters", "set"])]
    pub(crate) replay: Option<PathBuf>,
    /// A TOML file with the controllers' parameters: kp, ki, kd and filter below [pan] and [tilt]
    #[arg(long, value_name = "FILE")]
    pub(crate) parameters: Option<PathBuf>,
    /// The value of a parameter, over that of the file: pan/kp=2.5. Several are set by several
    /// --set
    #[arg(long, value_name = "NAME=VALUE")]
    pub(crate) set: Vec<String>,
    /// End with exit code 5 if the control loop missed a slot
    #[arg(long, conflicts_with = "replay")]
    pub(crate) strict: bool,
    /// Print the run's row of table 4 of the LUNA paper, beside the paper's of the same rate
    #[arg(long, conflicts_with = "replay")]
    pub(crate) table_4: bool,
    /// Do not look for the end stops first: the encoders are known to count from the middle
    #[arg(long)]
    pub(crate) calibrated: bool,
    /// The card between the processes and the machine: mesa-sim, a simulated Mesa 7I92 in this
    /// program, or mesa:HOST[:PORT], a real one [default: none, the machine is simulated by
    /// processes]
    #[arg(long, value_name = "CARD", value_parser = crate::card::parse, conflicts_with = "on_virtual_clock")]
    pub(crate) card: Option<crate::card::Choice>,
    /// Serve the live scope while it runs, for a browser on this machine; ADDR is host:port
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = SCOPE, conflicts_with = "replay")]
    pub(crate) scope: Option<SocketAddr>,
    /// Print the scope's address with a token: with it a viewer may set the controllers' parameters
    #[arg(long, requires = "scope")]
    pub(crate) scope_token: bool,
    /// Serve signals, messages and events while it runs, for Foxglove and Lichtblick on this
    /// machine; ADDR is host:port
    #[cfg(feature = "foxglove")]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = FOXGLOVE, conflicts_with = "replay")]
    pub(crate) foxglove: Option<SocketAddr>,
}

impl Demo {
    /// The time from one cycle to the next.
    pub(crate) fn period(&self) -> Duration {
        Duration::from_secs(1) / self.rate
    }

    /// How many cycles the run has: at least one.
    pub(crate) fn cycles(&self) -> u64 {
        // Within range by the parsers: at most a day at 4 kHz.
        ((self.seconds * f64::from(self.rate)).round() as u64).max(1)
    }
}

#[cfg(test)]
mod tests;
