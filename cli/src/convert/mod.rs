//! `luna convert`: a recording in formats that other programs read.
//!
//! `recording` reads it, `csv`, `mcap` and `perfetto` write, `events` knows what events mean. Each holds in memory what the signals are, and a bounded number of samples.

mod activity;
mod csv;
mod events;
#[cfg(feature = "mcap")]
mod mcap;
mod perfetto;
mod protobuf;
mod recording;

use crate::args::{Convert, Format};
use crate::failure::Failure;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Converts as the command line asks.
pub(crate) fn run(arguments: &Convert) -> Result<ExitCode, Failure> {
    let input = &arguments.file;
    let output = arguments
        .output
        .clone()
        .unwrap_or_else(|| input.with_extension(arguments.to.extension()));
    // Also by another name: the recording would be gone before it is read.
    let is_same = |one: &Path, other: &Path| {
        one == other
            || one
                .canonicalize()
                .is_ok_and(|one| Ok(one) == other.canonicalize().map_err(drop))
    };
    if is_same(input, &output) {
        return Err(Failure::Converted {
            path: output,
            error: "it is the recording itself; choose another with --output".to_owned(),
        });
    }
    // What cannot be read leaves no output.
    recording::check(input)?;
    let converted = match arguments.to {
        Format::Csv => csv::write(input, &output, arguments.hold)?,
        Format::Perfetto => perfetto::write(input, &output)?,
        #[cfg(feature = "mcap")]
        Format::Mcap => mcap::write(input, &output)?,
    };
    print!(
        "{}: {} samples of {} signals, {} messages",
        output.display(),
        converted.samples,
        converted.signals,
        converted.messages
    );
    match converted.events {
        0 => println!(),
        events => println!(", {events} events"),
    }
    if converted.lost_events > 0 {
        println!(
            "{} events were lost while it was recorded",
            converted.lost_events
        );
    }
    if converted.lost > 0 {
        println!(
            "{} samples and messages were lost while it was recorded",
            converted.lost
        );
    }
    if converted.lost_blocks > 0 {
        println!(
            "{} blocks were lost on the way to who received it",
            converted.lost_blocks
        );
    }
    Ok(say_damage(input, &converted))
}

/// Says what is damaged, and what became of it.
fn say_damage(input: &Path, converted: &Converted) -> ExitCode {
    let input = input.display();
    let Damage {
        found,
        count,
        skipped,
        missing,
    } = &converted.damage;
    for error in found {
        eprintln!("luna: {input}: {error}");
    }
    let Some(last) = found.last() else {
        return ExitCode::SUCCESS;
    };
    // A recording that only ends early is what a killed program leaves.
    if *count == 1 && last.is_truncated() {
        return ExitCode::SUCCESS;
    }
    eprintln!(
        "luna: {input}: it is damaged: bytes skipped {skipped}, blocks missing {missing}; all others are converted"
    );
    ExitCode::FAILURE
}

/// What was converted.
#[derive(Debug, Default)]
struct Converted {
    samples: u64,
    signals: usize,
    messages: u64,
    events: u64,
    lost: u64,
    lost_events: u64,
    lost_blocks: u64,
    damage: Damage,
}

/// What is wrong with a recording.
#[derive(Debug, Default)]
struct Damage {
    /// The first ones.
    found: Vec<luna_logger::format::ReadError>,
    count: u64,
    /// Bytes.
    skipped: u64,
    /// Blocks, by their numbers.
    missing: u64,
}

/// A new file to write.
fn create(path: &Path) -> Result<BufWriter<File>, Failure> {
    File::create(path).map(BufWriter::new).map_err(broken(path))
}

/// The failure of writing `path`.
fn broken<E: std::fmt::Display>(path: &Path) -> impl Fn(E) -> Failure {
    let path = PathBuf::from(path);
    move |error| Failure::Converted {
        path: path.clone(),
        error: error.to_string(),
    }
}
