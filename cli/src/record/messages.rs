//! A sender's messages on standard output: time, level, system, process or thread, and the text.

use super::name::{plain, utc};
use super::say;
use luna_logger::Peer;
use luna_logger::format::{Encoder, Level, Reader, Record, Subject};
use std::collections::{HashMap, VecDeque};
use std::fmt;

/// How many names of processes and threads are kept, and how much of each.
const MAX_NAMES: usize = 4096;
const MAX_NAME: usize = 64;

/// Shows messages of blocks.
pub(super) struct Shown {
    system: String,
    most: Level,
    reader: Reader<VecDeque<u8>>,
    processes: HashMap<u32, String>,
    threads: HashMap<u32, String>,
    /// From the recording's clock to nanoseconds since 1970, if the recording has it.
    offset: Option<i64>,
}

impl Shown {
    pub(super) fn new(peer: &Peer, most: Level) -> Self {
        let reader = Reader::new(VecDeque::from(Encoder::head()));
        Self {
            system: plain(&peer.system),
            most,
            reader: reader.expect("it is a head of this version"),
            processes: HashMap::new(),
            threads: HashMap::new(),
            offset: None,
        }
    }

    /// Shows the messages of a block. Records that make no sense are left out: the file has them.
    pub(super) fn block(&mut self, block: &[u8]) {
        self.reader.input().extend(block);
        loop {
            match self.reader.next() {
                Ok(None) => return,
                Err(_) => {
                    if !matches!(self.reader.resume(), Ok(Some(_))) {
                        return;
                    }
                }
                Ok(Some(record)) => match record {
                    Record::Thread { number, name } => keep(&mut self.threads, number, name),
                    Record::Name {
                        subject: Subject::Process,
                        number,
                        name,
                        ..
                    } => keep(&mut self.processes, number, name),
                    Record::Epoch { time, unix } => {
                        self.offset = Some(unix.wrapping_sub(time.cast_signed()));
                    }
                    Record::Message {
                        thread,
                        time,
                        level,
                        process,
                        target,
                        text,
                        ..
                    } if level <= self.most => {
                        let name = self.processes.get(&process).filter(|_| process != 0);
                        let name = name.or_else(|| self.threads.get(&thread));
                        say(format_args!(
                            "{} {level:<5} {}/{}: {}: {}",
                            Time(self.offset, time),
                            self.system,
                            name.map_or("", String::as_str),
                            Line(target),
                            Line(text)
                        ));
                    }
                    _ => {}
                },
            }
        }
    }
}

fn keep(names: &mut HashMap<u32, String>, number: u32, name: &str) {
    if names.len() < MAX_NAMES || names.contains_key(&number) {
        let name = &name[..name.floor_char_boundary(MAX_NAME)];
        names.insert(number, Line(name).to_string());
    }
}

/// The time of day in UTC, or seconds where there is none.
struct Time(Option<i64>, u64);

impl fmt::Display for Time {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Time(offset, time) = *self;
        let Some(offset) = offset else {
            return write!(f, "{:>15.6}", time as f64 / 1e9);
        };
        let nanos = offset.wrapping_add(time.cast_signed());
        let (_, second) = utc(nanos);
        let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
        let micros = nanos.rem_euclid(1_000_000_000) / 1000;
        write!(f, "{hour:02}:{minute:02}:{second:02}.{micros:06}")
    }
}

/// A text without what a terminal would obey.
struct Line<'a>(&'a str);

impl fmt::Display for Line<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        use fmt::Write as _;
        let plain = |one: char| if one.is_control() { '\u{FFFD}' } else { one };
        self.0
            .chars()
            .map(plain)
            .try_for_each(|one| f.write_char(one))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_of_the_day_and_texts_obey_nobody() {
        let at = Time(Some(1_700_000_000_000_000_000), 1_500_001_000);
        assert_eq!(at.to_string(), "22:13:21.500001");
        assert_eq!(Time(None, 1_500_001_000).to_string(), "       1.500001");
        assert_eq!(Line("a\u{1b}[2Jb\nc").to_string(), "a\u{FFFD}[2Jb\u{FFFD}c");
    }
}
