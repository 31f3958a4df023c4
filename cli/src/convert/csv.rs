//! CSV, as the thesis' recorder wrote it: a column of times and one for each element of each
//! signal.
//!
//! Times are seconds from the recording's first time. Where loops were recorded a row is a cycle:
//! what was sampled from its begin to that of the next, the last value of each signal. Elsewhere it
//! is what was sampled at one instant. A signal that was not sampled leaves its column empty, or
//! holds its last value, if that is asked for. Messages and events go to files beside it.

use super::recording::each;
use super::selection::Filter;
use super::{Converted, Rows};
use crate::failure::{self, Failure};
use crate::result_file::ResultFile;
use luna_logger::format::{Names, Record, Subject, Value, Words};
use std::collections::{BTreeMap, HashSet};
use std::fmt;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// How many samples are held back to put them in order: a recording is in order but for what a
/// thread was interrupted in.
const WINDOW: usize = 1 << 16;

/// The columns of a signal.
struct Columns {
    first: usize,
    name: String,
    unit: String,
    elements: u8,
}

pub(super) fn write(
    input: &Path,
    output: &Path,
    filter: &Filter,
    hold: bool,
    replaces: bool,
) -> Result<Converted, Failure> {
    let mut signals: BTreeMap<u32, Columns> = BTreeMap::new();
    let start = filter.start;
    each(input, filter, |record| {
        if let Record::Signal(info) = record {
            // A later declaration of the same is no other signal.
            signals.entry(info.number).or_insert_with(|| Columns {
                first: 0,
                name: info.name.to_owned(),
                unit: info.unit.to_owned(),
                elements: info.elements,
            });
        }
        Ok(())
    })?;
    let mut width = 0;
    for columns in signals.values_mut() {
        columns.first = width;
        width += usize::from(columns.elements);
    }
    let mut table = Table {
        output: ResultFile::create(output, replaces)?,
        row: vec![None; width],
        at: None,
        start,
        hold,
        per_cycle: filter.per_cycle().is_some(),
        has_empty_rows: filter.is_asked_per_cycle(),
        left_out: 0,
        sampled: HashSet::new(),
    };
    let failed = failure::failed(output);
    table.head(&signals).map_err(&failed)?;

    let heading = "time [s],level,thread,process,target,text";
    let mut messages = Beside::new(output.with_extension("messages.csv"), heading, replaces);
    let heading = "time [s],event,thread,subject,first,second";
    let mut events = Beside::new(output.with_extension("events.csv"), heading, replaces);
    let mut names = Names::default();
    // By time, begins of cycles before samples, and place in the recording: on a virtual clock all
    // of a cycle has one time.
    let mut waiting: BTreeMap<(u64, bool, u64), Entry> = BTreeMap::new();
    let mut number = 0;
    let mut converted = each(input, filter, |record| {
        names.take(record);
        let entry = match record {
            Record::Sample {
                signal,
                time,
                values,
            } => Some((*time, Some(*signal), values.iter().collect())),
            Record::Event(event) if filter.is_cycle(record) => Some((event.time, None, Vec::new())),
            _ => None,
        };
        if let Some((time, signal, values)) = entry {
            number += 1;
            waiting.insert((time, signal.is_some(), number), (signal, values));
            if waiting.len() > WINDOW
                && let Some(((time, ..), entry)) = waiting.pop_first()
            {
                table.take(&signals, time, entry).map_err(&failed)?;
            }
        }
        match record {
            Record::Event(event) if filter.takes(record) => {
                let Words {
                    what,
                    subject,
                    first,
                    second,
                } = names.words(event);
                events.line(format_args!(
                    "{},{},{},{},{},{}",
                    Seconds::between(start, event.time),
                    Text(&what),
                    Text(&names.thread(event.thread)),
                    Text(&subject),
                    Text(&first),
                    Text(&second)
                ))?;
            }
            Record::Message {
                thread,
                time,
                level,
                process,
                target,
                text,
                ..
            } => {
                let thread = names.thread(*thread);
                messages.line(format_args!(
                    "{},{level},{},{},{},{}",
                    Seconds::between(start, *time),
                    Text(&thread),
                    Text(&names.process((*process).into())),
                    Text(target),
                    Text(text)
                ))?;
            }
            _ => {}
        }
        Ok(())
    })?;
    for ((time, ..), entry) in waiting {
        table.take(&signals, time, entry).map_err(&failed)?;
    }
    let (output, left_out) = table.end().map_err(&failed)?;
    messages.end()?;
    events.end()?;
    // Last: where the table is, what belongs to it is too.
    output.finish()?;
    if let Some(number) = filter.per_cycle() {
        let rows = Rows {
            of: names.of(Subject::Loop, number.into()),
            left_out,
        };
        converted.rows = Some(rows);
    }
    Ok(converted)
}

/// A file beside the table. Its first line makes it.
struct Beside {
    path: PathBuf,
    heading: &'static str,
    replaces: bool,
    file: Option<ResultFile>,
}

impl Beside {
    fn new(path: PathBuf, heading: &'static str, replaces: bool) -> Self {
        Self {
            path,
            heading,
            replaces,
            file: None,
        }
    }

    fn line(&mut self, line: fmt::Arguments<'_>) -> Result<(), Failure> {
        let failed = failure::failed(&self.path);
        let file = match &mut self.file {
            Some(file) => file,
            none => {
                let mut file = ResultFile::create(&self.path, self.replaces)?;
                writeln!(file, "{}", self.heading).map_err(&failed)?;
                none.insert(file)
            }
        };
        writeln!(file, "{line}").map_err(&failed)
    }

    fn end(self) -> Result<(), Failure> {
        self.file.map_or(Ok(()), ResultFile::finish)
    }
}

/// The values of a signal's sample; without a signal, the begin of a cycle.
type Entry = (Option<u32>, Vec<Value>);

/// The rows as they are written.
struct Table<W> {
    output: W,
    row: Vec<Option<Value>>,
    /// The time of the row.
    at: Option<u64>,
    start: u64,
    hold: bool,
    per_cycle: bool,
    /// Cycles without a sample are rows too.
    has_empty_rows: bool,
    /// Samples that no row has: before the first cycle, or not the last of theirs.
    left_out: u64,
    /// The signals that were sampled in the cycle.
    sampled: HashSet<u32>,
}

impl<W: Write> Table<W> {
    fn head(&mut self, signals: &BTreeMap<u32, Columns>) -> io::Result<()> {
        write!(self.output, "time [s]")?;
        for signal in signals.values() {
            for element in 0..signal.elements {
                let mut name = signal.name.clone();
                if signal.elements > 1 {
                    name += &format!("[{element}]");
                }
                if !signal.unit.is_empty() {
                    name += &format!(" [{}]", signal.unit);
                }
                write!(self.output, ",{}", Text(&name))?;
            }
        }
        writeln!(self.output)
    }

    fn take(
        &mut self,
        signals: &BTreeMap<u32, Columns>,
        time: u64,
        (signal, values): Entry,
    ) -> io::Result<()> {
        let Some(signal) = signal else {
            self.end_row()?;
            self.at = Some(time);
            return Ok(());
        };
        let Some(columns) = signals.get(&signal) else {
            return Ok(());
        };
        let cells = columns.first..columns.first + usize::from(columns.elements);
        if self.per_cycle {
            // What was sampled before the first cycle is of none.
            if self.at.is_none() {
                self.left_out += 1;
                return Ok(());
            }
            // With `hold` the row has values of former cycles.
            self.left_out += u64::from(!self.sampled.insert(signal));
        } else {
            // A second sample of the instant has a row of its own.
            let is_taken = !self.hold && self.row[cells.clone()].iter().any(Option::is_some);
            if self.at != Some(time) || is_taken {
                self.end_row()?;
                self.at = Some(time);
            }
        }
        for (cell, value) in self.row[cells].iter_mut().zip(values) {
            *cell = Some(value);
        }
        Ok(())
    }

    fn end_row(&mut self) -> io::Result<()> {
        let Some(at) = self.at.take() else {
            return Ok(());
        };
        let has_sample = !self.sampled.is_empty();
        self.sampled.clear();
        if self.per_cycle && !has_sample && !self.has_empty_rows {
            return Ok(());
        }
        write!(self.output, "{}", Seconds::between(self.start, at))?;
        for cell in &mut self.row {
            match cell {
                Some(value) => write!(self.output, ",{value}")?,
                None => write!(self.output, ",")?,
            }
            if !self.hold {
                *cell = None;
            }
        }
        writeln!(self.output)
    }

    fn end(mut self) -> io::Result<(W, u64)> {
        self.end_row()?;
        Ok((self.output, self.left_out))
    }
}

/// Nanoseconds as seconds, exactly. What a thread did just before the recording began has a
/// negative time.
struct Seconds(i64);

impl Seconds {
    fn between(start: u64, time: u64) -> Self {
        Self(time.wrapping_sub(start).cast_signed())
    }
}

impl fmt::Display for Seconds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Seconds(nanos) = self;
        let sign = if *nanos < 0 { "-" } else { "" };
        let nanos = nanos.unsigned_abs();
        write!(
            f,
            "{sign}{}.{:09}",
            nanos / 1_000_000_000,
            nanos % 1_000_000_000
        )
    }
}

/// A text as a cell: in quotes where it has to be.
struct Text<'a>(&'a str);

impl fmt::Display for Text<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.contains([',', '"', '\n', '\r']) {
            write!(f, "\"{}\"", self.0.replace('"', "\"\""))
        } else {
            f.write_str(self.0)
        }
    }
}
