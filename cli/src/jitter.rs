//! `luna jitter`: how late a periodic process wakes up, and nothing else.

use crate::alloc::Counting;
use crate::beside::{self, Ended, EndsOnDrop};
use crate::failure::{Failure, failed};
use crate::print::print;
use crate::result_file::ResultFile;
use crate::{args, exit, place, report, text};
use luna::prelude::*;
use std::io::Write;
use std::process::ExitCode;
use std::time::Duration;

const NAME: &str = "jitter";

/// Measures, prints, and gives the exit code.
pub(crate) fn run(arguments: &args::Jitter, allocator: &Counting) -> Result<ExitCode, Failure> {
    // Before the measurement: a path that cannot be written should not cost its time.
    let path = arguments.histogram.as_deref();
    let create = |path| ResultFile::create(path, arguments.replace);
    let file = path.map(create).transpose()?;

    let mut system = System::new(NAME);
    system.lock_memory();
    // Kept, so that no process drops the last one on the real-time path.
    let _ended = spawn(&mut system, arguments)?;
    let mut report = system.run()?;
    let measurement = report::measurement(&report, NAME, &[NAME], allocator.counts());

    if let Some((mut file, path)) = file.zip(path) {
        write_histogram(&mut file, report::latencies(&report, NAME)).map_err(failed(path))?;
        file.finish()?;
    }
    print(arguments.place.json, &measurement, || {
        let head = format!(
            "{} wake-ups, {} µs apart: ",
            arguments.loops, arguments.interval
        );
        report::clear_shortfalls(&mut report);
        [
            head + &text::header(&measurement),
            report.to_string(),
            text::latency(NAME, report::latencies(&report, NAME)),
            text::memory(&measurement) + text::ending(&measurement),
        ]
    })?;
    Ok(exit::of_a_run(measurement.complete))
}

/// The measured loop, at the highest level of its executor, and what is to run beside it.
fn spawn(system: &mut System, arguments: &args::Jitter) -> luna::Result<Ended> {
    let loops = arguments.loops;
    let period = Duration::from_micros(arguments.interval);
    let guard = Duration::from_micros(arguments.guard);
    let executor = place::executor(system, NAME, &arguments.place)?;
    // The measured loop is one of them.
    system.max_loops(arguments.others as usize + 1);
    let ended = Ended::default();
    let measured = ended.clone();
    executor.process(NAME).priority(31).spawn(async move {
        // Also if it fails: the others wait for it.
        let _ends = EndsOnDrop(measured);
        let mut tick = luna::periodic(NAME, period)?.guard_spin(guard)?;
        for _ in 0..loops {
            tick.next().await;
        }
        Ok(())
    })?;
    beside::others(&executor, arguments.others, &ended)?;
    if let Some(burn) = arguments.burn {
        beside::burner(
            system,
            &arguments.place,
            Duration::from_millis(burn),
            &ended,
        )?;
    }
    Ok(ended)
}

/// A line for each latency that occurred, the shortest first.
fn write_histogram(
    file: &mut ResultFile,
    values: impl Iterator<Item = (u64, u64)>,
) -> std::io::Result<()> {
    writeln!(file, "latency_ns,count")?;
    for (value, count) in values {
        writeln!(file, "{value},{count}")?;
    }
    Ok(())
}
