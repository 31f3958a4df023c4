//! The options of `luna jitter`.

use clap::Args;
use luna_command::place::Placement;
use luna_command::values::interval;
use std::path::PathBuf;

/// Processes beside the measured one: as many as a system reserves room for, with some to spare.
const MAX_OTHERS: i64 = 250;

/// The options of `luna jitter`.
#[derive(Debug, Clone, Args)]
pub(crate) struct Jitter {
    /// From one wake-up to the next, in µs
    #[arg(long, value_name = "US", default_value_t = 1000, value_parser = interval, allow_negative_numbers = true)]
    pub(crate) interval: u64,
    /// How many wake-ups
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = clap::value_parser!(u64).range(1..), allow_negative_numbers = true)]
    pub(crate) loops: u64,
    /// Spin for the last so many µs before each wake-up: at most a sixteenth of the interval
    #[arg(
        long,
        value_name = "US",
        default_value_t = 0,
        allow_negative_numbers = true
    )]
    pub(crate) guard: u64,
    /// How many other loops run on the same executor, at 100 Hz to 1 kHz and lower priorities
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=MAX_OTHERS), allow_negative_numbers = true)]
    pub(crate) others: u32,
    /// Keep the core busy for so many ms at a time, from a thread of lower priority
    #[arg(long, value_name = "MS", value_parser = clap::value_parser!(u64).range(1..=1000), allow_negative_numbers = true)]
    pub(crate) burn: Option<u64>,
    #[command(flatten)]
    pub(crate) place: Placement,
    /// Where to write the histogram, as CSV: latency_ns,count
    #[arg(long, value_name = "FILE")]
    pub(crate) histogram: Option<PathBuf>,
    /// Replace the histogram's file if it is there: what is in it is lost
    #[arg(long, requires = "histogram")]
    pub(crate) replace: bool,
}
