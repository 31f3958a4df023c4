//! `luna convert`: a recording in formats that other programs read, or several in one trace.
//!
//! `recording` reads it, `selection` leaves out what was not asked for, `clocks` makes the times
//! of several recordings those of one clock, `csv`, `mcap` and `perfetto` write. What events mean
//! is known to `luna_logger::format::Names`. Each holds in memory what the signals are, and a
//! bounded number of samples.

mod activity;
mod clocks;
mod csv;
#[cfg(feature = "mcap")]
mod mcap;
mod perfetto;
mod recording;
mod selection;

pub(crate) use recording::open;

use crate::args::{Convert, Format};
use crate::failure::{Failure, failed};
use crate::print::say;
use crate::text::Count;
use std::fmt;
use std::path::Path;
use std::process::ExitCode;

/// Converts as the command line asks.
pub(crate) fn run(arguments: &Convert) -> Result<ExitCode, Failure> {
    check(arguments).map_err(Failure::Options)?;
    let inputs = &arguments.files;
    let output = arguments
        .output
        .clone()
        .unwrap_or_else(|| inputs[0].with_extension(arguments.to.extension()));
    // Also by another path: writing would erase the recording before it is read.
    let is_same = |one: &Path, other: &Path| {
        one == other
            || one
                .canonicalize()
                .is_ok_and(|one| Ok(one) == other.canonicalize().map_err(drop))
    };
    if inputs.iter().any(|input| is_same(input, &output)) {
        let why = "it is the recording itself; choose another with --output";
        return Err(failed(&output)(why));
    }
    // What cannot be read leaves no output.
    let mut filters = selection::Filter::of(arguments)?;
    let converted = match arguments.to {
        Format::Csv => vec![csv::write(
            &inputs[0],
            &output,
            &filters[0],
            arguments.hold,
            arguments.replace,
        )?],
        Format::Perfetto => {
            let shifts = clocks::shifts(arguments, &filters)?;
            // All that is chosen by time counts from one instant.
            let start = filters[0].start;
            for (filter, shift) in filters.iter_mut().zip(&shifts) {
                filter.count_from(clocks::shifted(start, shift.saturating_neg()));
            }
            let sources = inputs.iter().zip(&filters).zip(shifts);
            perfetto::write(
                sources.map(|((path, filter), shift)| (&**path, filter, shift)),
                &output,
                arguments.replace,
            )?
        }
        #[cfg(feature = "mcap")]
        Format::Mcap => vec![mcap::write(
            &inputs[0],
            &output,
            &filters[0],
            arguments.replace,
        )?],
    };
    let mut said = format!("{}: ", output.display());
    if let [converted] = &*converted {
        said += &converted.to_string();
    } else {
        said += &format!("{} recordings\n", converted.len());
        for (input, converted) in inputs.iter().zip(&converted) {
            said += &format!("{}: {converted}", input.display());
        }
    }
    say(&said)?;
    let mut code = ExitCode::SUCCESS;
    for (input, converted) in inputs.iter().zip(&converted) {
        if say_damage(input, converted) {
            code = ExitCode::FAILURE;
        }
    }
    Ok(code)
}

/// What clap does not check: options that depend on the values of others.
fn check(arguments: &Convert) -> Result<(), &'static str> {
    let selection = &arguments.selection;
    let further = arguments.files.len() - 1;
    if arguments.to != Format::Perfetto && further > 0 {
        return Err("several recordings become one trace by --to perfetto alone");
    }
    if arguments.offset.len() > further {
        return Err("--offset is for the second recording and those after it: there are fewer");
    }
    if arguments.to != Format::Csv && arguments.per_cycle.is_some() {
        return Err("--per-cycle makes rows: it needs --to csv");
    }
    if arguments.to != Format::Csv && arguments.per_sample {
        return Err("--per-sample makes rows: it needs --to csv");
    }
    if arguments.to != Format::Csv && arguments.hold {
        return Err("--hold fills cells: it needs --to csv");
    }
    match (selection.from, selection.until) {
        (Some(from), Some(until)) if until <= from => {
            Err("--until must be later than --from: nothing lies between them")
        }
        _ => Ok(()),
    }
}

impl fmt::Display for Converted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let were = |number| if number == 1 { "was" } else { "were" };
        write!(
            f,
            "{} of {}, {}",
            Count(self.samples, "sample"),
            Count(self.signals as u64, "signal"),
            Count(self.messages, "message")
        )?;
        if self.events > 0 {
            write!(f, ", {}", Count(self.events, "event"))?;
        }
        writeln!(f)?;
        if let Some(Rows { of, left_out }) = &self.rows {
            writeln!(
                f,
                "a row is a cycle of {of}; --per-sample gives each instant one"
            )?;
            if *left_out > 0 {
                let samples = Count(*left_out, "sample");
                writeln!(
                    f,
                    "{samples} not in the rows: before the first cycle, or followed by another in theirs"
                )?;
            }
        }
        let lost = self.lost_events;
        if lost > 0 {
            let events = Count(lost, "event");
            writeln!(f, "{events} {} lost while it was recorded", were(lost))?;
        }
        match self.lost {
            0 => {}
            1 => writeln!(f, "1 sample or message was lost while it was recorded")?,
            lost => writeln!(
                f,
                "{lost} samples and messages were lost while it was recorded"
            )?,
        }
        let lost = self.lost_blocks;
        if lost > 0 {
            let blocks = Count(lost, "block");
            writeln!(f, "{blocks} {} lost on the way to the receiver", were(lost))?;
        }
        Ok(())
    }
}

/// Prints what is damaged, and what became of it. Whether that is more than an early end.
fn say_damage(input: &Path, converted: &Converted) -> bool {
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
        return false;
    };
    // A recording that only ends early is what a killed program leaves.
    if *count == 1 && last.is_truncated() {
        return false;
    }
    eprintln!(
        "luna: {input}: it is damaged: bytes skipped {skipped}, blocks missing {missing}; all others are converted"
    );
    true
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
    /// Of a table with a row for each cycle.
    rows: Option<Rows>,
}

/// The rows of a table that are cycles.
#[derive(Debug)]
struct Rows {
    /// The loop's name.
    of: String,
    /// Samples that no row has.
    left_out: u64,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_of_each_is_no_plural() {
        let one = Converted {
            samples: 1,
            signals: 1,
            messages: 1,
            events: 1,
            lost: 1,
            lost_events: 1,
            lost_blocks: 1,
            damage: Damage::default(),
            rows: None,
        };
        assert_eq!(
            one.to_string(),
            "1 sample of 1 signal, 1 message, 1 event\n\
             1 event was lost while it was recorded\n\
             1 sample or message was lost while it was recorded\n\
             1 block was lost on the way to the receiver\n"
        );
        let none = Converted {
            signals: 2,
            ..Converted::default()
        };
        assert_eq!(none.to_string(), "0 samples of 2 signals, 0 messages\n");
    }
}
