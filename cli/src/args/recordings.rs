//! The options of what makes and reads recordings.

use super::SCOPE;
use clap::{Args, ValueEnum};
use glob::Pattern;
use luna_command::values::{instant, offset};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// The options of `luna convert`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
Exit codes: 0 converted, 1 a recording is damaged (what is before the damage was converted), or standard output is closed, 2 bad arguments or files.")]
pub(crate) struct Convert {
    /// The recording of the logger (.luna), as `System::log_to` or LUNA_LOG has made it. Several
    /// recordings become one Perfetto trace, with a process for each, and flows from a value's send
    /// in one program to its receive in another
    #[arg(value_name = "FILES", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// What to make of it
    #[arg(long, value_name = "FORMAT")]
    pub(crate) to: Format,
    /// How the times of several recordings are made those of one clock
    #[arg(long, value_name = "CLOCK", default_value = "monotonic")]
    pub(crate) clock: Clock,
    /// Seconds to be added to the times of the second recording, the third, and so on, beside what
    /// --clock does: 0.25,-3
    #[arg(
        long,
        value_name = "SECONDS",
        value_delimiter = ',',
        value_parser = offset,
        allow_hyphen_values = true
    )]
    pub(crate) offset: Vec<i64>,
    /// Where to write [default: beside the first recording]
    #[arg(long, short, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// Replace files of the output's name: what is in them is lost
    #[arg(long)]
    pub(crate) replace: bool,
    /// CSV: a signal that was not sampled at a row's time holds its last value, instead of an empty
    /// cell
    #[arg(long)]
    pub(crate) hold: bool,
    /// CSV: a row for each cycle of this loop, with the last value of each signal in the cycle; for
    /// recordings with events [default: the loop with the most cycles, if there is one, without
    /// the cycles in which nothing was sampled]
    #[arg(long, value_name = "LOOP")]
    pub(crate) per_cycle: Option<String>,
    /// CSV: a row for each instant at which something was sampled, also where there are loops
    #[arg(long, conflicts_with = "per_cycle")]
    pub(crate) per_sample: bool,
    #[command(flatten)]
    pub(crate) selection: Selection,
}

/// Where the times of several recordings come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Clock {
    /// Programs of one computer, since its start: their times are those of one clock already
    Monotonic,
    /// Programs of several computers, or of one that was started anew: by the times of the day
    Wall,
}

/// What of a recording is converted. Without an option of a kind, all of that kind is.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct Selection {
    /// Only signals of these names, as pan/*,tilt/angle; none for no signals
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) signals: Vec<Pattern>,
    /// Only events of these kinds, as late*,communication; none for no events
    #[arg(long, value_name = "KINDS", value_delimiter = ',')]
    pub(crate) events: Vec<Pattern>,
    /// Only events and messages of processes of these names
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) process: Vec<Pattern>,
    /// Only what came so many seconds after the beginning of the recording, or later
    #[arg(long, value_name = "S", value_parser = instant)]
    pub(crate) from: Option<Duration>,
    /// Only what came before so many seconds after the beginning of the recording
    #[arg(long, value_name = "S", value_parser = instant)]
    pub(crate) until: Option<Duration>,
}

/// What a recording can be made to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    /// A row for each cycle or instant, a column for each signal; messages and events in files
    /// beside it
    Csv,
    /// For Foxglove, Lichtblick and PlotJuggler
    #[cfg(feature = "mcap")]
    Mcap,
    /// For ui.perfetto.dev
    Perfetto,
}

impl Format {
    /// How its files' names end.
    pub(crate) fn extension(self) -> &'static str {
        match self {
            Format::Csv => "csv",
            #[cfg(feature = "mcap")]
            Format::Mcap => "mcap",
            Format::Perfetto => "perfetto-trace",
        }
    }
}

/// The options of `luna record`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
Exit codes: 0 ended in order, 1 a file could not be made or written, 2 bad arguments, files or addresses.")]
pub(crate) struct Record {
    /// Where to listen: HOST:PORT. Senders are not authenticated, so use 0.0.0.0 in trusted
    /// networks only
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:7411")]
    pub(crate) listen: String,
    /// Take UDP datagrams (LUNA_LOG=udp://HOST:PORT) instead of TCP
    #[arg(long)]
    pub(crate) udp: bool,
    /// The folder for the files, which are named by system and start; with --once, the file
    /// [default: this folder]
    #[arg(long, short, value_name = "PATH")]
    pub(crate) output: Option<PathBuf>,
    /// With --once: replace the file if it is there: what is in it is lost
    #[arg(long, requires = "once")]
    pub(crate) replace: bool,
    /// Show messages of LEVEL and what matters more: error, warn, info, debug, trace, or none
    #[arg(long, value_name = "LEVEL", default_value = "info", value_parser = level)]
    pub(crate) messages: Messages,
    /// End when the first recording has ended, and take no other
    #[arg(long)]
    pub(crate) once: bool,
    /// The most MiB of each file; a sender is refused then
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u64).range(1..=1 << 40), allow_negative_numbers = true)]
    pub(crate) limit: Option<u64>,
    /// Show what comes in the browser, too: all senders on one time axis. ADDR is host:port
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = SCOPE)]
    pub(crate) scope: Option<SocketAddr>,
    /// A picture of the machine in the scope, as of `luna scope`
    #[arg(long, value_name = "FILE", requires = "scope")]
    pub(crate) picture: Option<PathBuf>,
    /// The drawing of a model (.toml) in the scope, as of `luna scope`
    #[arg(
        long,
        value_name = "FILE",
        requires = "scope",
        conflicts_with = "picture"
    )]
    pub(crate) model: Option<PathBuf>,
}

/// Which messages are shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Messages(pub(crate) Option<luna::log::Level>);

fn level(text: &str) -> Result<Messages, String> {
    use luna::log::Level;
    Ok(Messages(match text {
        "none" => None,
        "error" => Some(Level::Error),
        "warn" => Some(Level::Warn),
        "info" => Some(Level::Info),
        "debug" => Some(Level::Debug),
        "trace" => Some(Level::Trace),
        _ => return Err("it must be error, warn, info, debug, trace or none".into()),
    }))
}

/// The options of `luna scope`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
Exit codes: it runs until a signal ends it, or with --once: 0 shown, 1 a recording is damaged; 2 bad arguments, files or addresses.")]
pub(crate) struct Scope {
    /// The recording of the logger (.luna), as `System::log_to` or LUNA_LOG has made it; - reads it
    /// from the standard input. Several recordings, of programs that ran at the same time, are
    /// shown on one time axis
    #[arg(value_name = "FILES", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// Where to listen; there is no encryption, so that what is no loopback is for a network that
    /// one trusts
    #[arg(long, value_name = "ADDR", default_value = SCOPE)]
    pub(crate) listen: SocketAddr,
    /// Answer under this name too, beside localhost and the address that was reached
    #[arg(long, value_name = "NAME")]
    pub(crate) host: Vec<String>,
    /// At most so many viewers
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u8).range(1..))]
    pub(crate) viewers: u8,
    /// Play it so many times as fast as it was recorded, or max for all at once
    #[arg(long, value_name = "X", default_value = "1")]
    pub(crate) speed: luna_scope::Speed,
    /// Show this picture of the machine, too: an SVG whose elements are bound to signals
    /// (docs/scope-pictures.md)
    #[arg(long, value_name = "FILE")]
    pub(crate) picture: Option<PathBuf>,
    /// Show the drawing of this model (.toml), animated by the recorded events: what each process
    /// does and waits for, and how often each channel communicates
    #[arg(long, value_name = "FILE", conflicts_with = "picture")]
    pub(crate) model: Option<PathBuf>,
    /// End with the recording, instead of showing its end until Ctrl-C
    #[arg(long)]
    pub(crate) once: bool,
}
