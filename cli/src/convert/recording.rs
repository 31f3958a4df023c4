//! A recording, read record by record.

use super::Converted;
use super::selection::Filter;
use crate::failure::{Failure, failed};
use crate::progress::Progress;
use luna_logger::format::{Losing, Reader, Record};
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

/// How many errors are printed in full.
const MAX_SAID: usize = 5;

/// The file of a recording, which shows how far it is read.
#[derive(Debug)]
pub(crate) struct Watched {
    file: File,
    name: String,
    read: u64,
    /// 0 if it is not known.
    length: u64,
    progress: Progress,
}

impl Read for Watched {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(buffer)?;
        self.read += read as u64;
        let (name, done, length) = (&self.name, self.read, self.length);
        self.progress.show(|| match length {
            0 => format!("reading {name}: {} MiB", done >> 20),
            // It may grow meanwhile.
            _ => format!("reading {name}: {} %", (done.min(length) * 100) / length),
        });
        Ok(read)
    }
}

/// A recording that can be opened.
pub(crate) fn open(path: &Path) -> Result<Reader<BufReader<Watched>>, Failure> {
    let file = File::open(path).map_err(failed(path))?;
    let length = file.metadata().map_or(0, |about| about.len());
    let name = path.file_name().unwrap_or(path.as_os_str());
    let watched = Watched {
        name: name.to_string_lossy().into_owned(),
        file,
        read: 0,
        length,
        progress: Progress::new(),
    };
    let reader = Reader::new(BufReader::with_capacity(1 << 16, watched));
    reader.map_err(failed(path))
}

/// Calls `take` with each record that can be read and that the filter takes, and counts them.
pub(super) fn each(
    path: &Path,
    filter: &Filter,
    mut take: impl FnMut(&Record<'_>) -> Result<(), Failure>,
) -> Result<Converted, Failure> {
    let mut reader = open(path)?;
    let mut converted = Converted::default();
    let mut signals = std::collections::HashSet::new();
    let mut lost: HashMap<Losing, u64> = HashMap::new();
    loop {
        let record = match reader.next() {
            Ok(Some(record)) => record,
            Ok(None) => break,
            Err(error) => {
                let damage = &mut converted.damage;
                damage.count += 1;
                if damage.found.len() < MAX_SAID {
                    damage.found.push(error);
                }
                // The blocks after the damage are as good as those before.
                match reader.resume() {
                    Ok(Some(skipped)) => damage.skipped += skipped,
                    Ok(None) | Err(_) => break,
                }
                continue;
            }
        };
        if !filter.takes(&record) {
            // It is no part of the output, but begins a row there.
            if filter.is_cycle(&record) {
                take(&record)?;
            }
            continue;
        }
        match &record {
            Record::Sample { .. } => converted.samples += 1,
            Record::Message { .. } => converted.messages += 1,
            Record::Event(_) => converted.events += 1,
            Record::Signal(info) => {
                signals.insert(info.number);
            }
            Record::Losses { of, lost: number } => {
                lost.insert(*of, *number);
            }
            _ => {}
        }
        take(&record)?;
    }
    converted.signals = signals.len();
    converted.damage.missing = reader.missing_blocks();
    for (of, lost) in lost {
        match of {
            Losing::Blocks => converted.lost_blocks += lost,
            Losing::Events(_) => converted.lost_events += lost,
            _ => converted.lost += lost,
        }
    }
    Ok(converted)
}

/// The time of a record, if it has one that something happened at.
pub(super) fn time(record: &Record<'_>) -> Option<u64> {
    match record {
        Record::Sample { time, .. } | Record::Message { time, .. } => Some(*time),
        Record::Event(event) => Some(event.time),
        _ => None,
    }
}
