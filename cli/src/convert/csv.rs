//! CSV, as the thesis' recorder wrote it: a column of times and one for each element of each
//! signal.
//!
//! Times are seconds from the first sample or message. What was sampled at one instant stands in
//! one row; a signal that was not leaves its column empty, or, if that is asked for, holds its last
//! value. Messages and events go to files beside it.

use super::events::{Names, Words};
use super::recording::{each, time};
use super::{Converted, broken, create};
use crate::failure::Failure;
use luna_logger::format::{Record, Value};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::io::{self, Write};
use std::path::Path;

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

pub(super) fn write(input: &Path, output: &Path, hold: bool) -> Result<Converted, Failure> {
    let mut signals: BTreeMap<u32, Columns> = BTreeMap::new();
    let mut start = u64::MAX;
    each(input, |record| {
        if let Some(time) = time(record) {
            start = start.min(time);
        }
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
        output: create(output)?,
        row: vec![None; width],
        at: None,
        start,
        hold,
    };
    let failed = broken(output);
    table.head(&signals).map_err(&failed)?;

    let beside = output.with_extension("messages.csv");
    let mut messages = None;
    let beside_events = output.with_extension("events.csv");
    let mut events = None;
    let mut names = Names::default();
    let mut waiting: BinaryHeap<Reverse<(u64, u64, u32, Cells)>> = BinaryHeap::new();
    let mut number = 0;
    let converted = each(input, |record| {
        names.take(record);
        match record {
            Record::Sample {
                signal,
                time,
                values,
            } => {
                number += 1;
                let cells = Cells(values.iter().collect());
                waiting.push(Reverse((*time, number, *signal, cells)));
                if waiting.len() > WINDOW {
                    table.take(&signals, waiting.pop()).map_err(&failed)?;
                }
            }
            Record::Event(event) => {
                let file = match &mut events {
                    Some(file) => file,
                    none => {
                        let mut file = create(&beside_events)?;
                        writeln!(file, "time,event,thread,subject,first,second")
                            .map_err(broken(&beside_events))?;
                        none.insert(file)
                    }
                };
                let Words {
                    what,
                    subject,
                    first,
                    second,
                } = names.words(event);
                writeln!(
                    file,
                    "{},{},{},{},{},{}",
                    Seconds(event.time - start),
                    Text(&what),
                    Text(names.thread(event.thread)),
                    Text(&subject),
                    Text(&first),
                    Text(&second)
                )
                .map_err(broken(&beside_events))?;
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
                let file = match &mut messages {
                    Some(file) => file,
                    none => {
                        let mut file = create(&beside)?;
                        writeln!(file, "time,level,thread,process,target,text")
                            .map_err(broken(&beside))?;
                        none.insert(file)
                    }
                };
                let thread = names.thread(*thread);
                writeln!(
                    file,
                    "{},{level},{},{process},{},{}",
                    Seconds(time - start),
                    Text(thread),
                    Text(target),
                    Text(text)
                )
                .map_err(broken(&beside))?;
            }
            _ => {}
        }
        Ok(())
    })?;
    while let Some(next) = waiting.pop() {
        table.take(&signals, Some(next)).map_err(&failed)?;
    }
    table.end().map_err(&failed)?;
    if let Some(mut file) = messages {
        file.flush().map_err(broken(&beside))?;
    }
    if let Some(mut file) = events {
        file.flush().map_err(broken(&beside_events))?;
    }
    Ok(converted)
}

/// Values without an order: the columns before them decide.
struct Cells(Vec<Value>);

impl PartialEq for Cells {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}
impl Eq for Cells {}
impl PartialOrd for Cells {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Cells {
    fn cmp(&self, _: &Self) -> std::cmp::Ordering {
        std::cmp::Ordering::Equal
    }
}

/// The rows as they are written.
struct Table<W> {
    output: W,
    row: Vec<Option<Value>>,
    /// The time of the row.
    at: Option<u64>,
    start: u64,
    hold: bool,
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
        sample: Option<Reverse<(u64, u64, u32, Cells)>>,
    ) -> io::Result<()> {
        let Some(Reverse((time, _, signal, Cells(values)))) = sample else {
            return Ok(());
        };
        let Some(columns) = signals.get(&signal) else {
            return Ok(());
        };
        let cells = columns.first..columns.first + usize::from(columns.elements);
        // A second sample of the instant has a row of its own.
        let is_taken = !self.hold && self.row[cells.clone()].iter().any(Option::is_some);
        if self.at != Some(time) || is_taken {
            self.end_row()?;
            self.at = Some(time);
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
        write!(self.output, "{}", Seconds(at - self.start))?;
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

    fn end(mut self) -> io::Result<()> {
        self.end_row()?;
        self.output.flush()
    }
}

/// Nanoseconds as seconds, exactly.
struct Seconds(u64);

impl std::fmt::Display for Seconds {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Seconds(nanos) = self;
        write!(f, "{}.{:09}", nanos / 1_000_000_000, nanos % 1_000_000_000)
    }
}

/// A text as a cell: in quotes where it has to be.
struct Text<'a>(&'a str);

impl std::fmt::Display for Text<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.0.contains([',', '"', '\n', '\r']) {
            write!(f, "\"{}\"", self.0.replace('"', "\"\""))
        } else {
            f.write_str(self.0)
        }
    }
}
