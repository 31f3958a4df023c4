//! A trace that opens in ui.perfetto.dev: each element of a signal is a counter track, each thread
//! a track with its messages as instants, and with events each process and executor one with what
//! it does (`activity`). Each recording is a process of the trace.
//!
//! The file is compressed by gzip, as Perfetto reads it. Field numbers are those of
//! `perfetto_trace.proto`; they never change.

use super::Converted;
use super::activity::Activity;
use super::clocks::shifted;
use super::recording::each;
use super::selection::Filter;
use crate::failure::{self, Failure};
use crate::result_file::ResultFile;
use flate2::{Compression, write::GzEncoder};
use luna_logger::format::protobuf::Message;
use luna_logger::format::{Event, Names, Record, SignalInfo, Value};
use std::collections::HashSet;
use std::io::Write;
use std::path::Path;

/// Everything is of one writer.
const SEQUENCE: u64 = 1;

/// The system as a process of the trace: the first recording's.
pub(super) const PROCESS: u64 = 1;

/// Tracks of threads are numbered from here, and behind those the tracks of signals.
pub(super) const THREADS: u64 = 1 << 8;
const SIGNALS: u64 = 1 << 40;

/// Those of the next recording are numbered so much higher.
const RECORDING: u64 = 1 << 48;

/// `BuiltinClock`: that of the packets' times, which the first snapshot makes the trace's own, and
/// that of the day.
const REALTIME: u64 = 1;
const MONOTONIC: u64 = 3;

/// `TrackEvent.Type`
pub(super) const INSTANT: u64 = 3;
const COUNTER: u64 = 4;

/// Writes the recordings, each with what is taken of it, and what is added to its times.
pub(super) fn write<'a>(
    sources: impl Iterator<Item = (&'a Path, &'a Filter, i64)>,
    output: &Path,
    replaces: bool,
) -> Result<Vec<Converted>, Failure> {
    let result = ResultFile::create(output, replaces)?;
    let mut file = GzEncoder::new(result, Compression::fast());
    let failed = failure::failed(output);
    let mut is_first = true;
    let mut all = Vec::new();
    for (number, (input, filter, shift)) in (0..).zip(sources) {
        let mut one = Recording {
            number,
            shift,
            described: HashSet::new(),
            names: Names::default(),
            activity: Activity::of(number * RECORDING),
        };
        let mut put = |packet: Message| {
            let packet = packet.number(10, SEQUENCE);
            // In the first packet: nothing before it is needed to understand what follows.
            let packet = if std::mem::take(&mut is_first) {
                packet.number(13, 1)
            } else {
                packet
            };
            let framed = Message::default().message(1, &packet);
            file.write_all(framed.as_bytes()).map_err(&failed)
        };
        all.push(each(input, filter, |record| one.put(record, &mut put))?);
    }
    file.finish().map_err(&failed)?.finish()?;
    Ok(all)
}

/// A recording that is being written.
struct Recording {
    /// Counted from 0.
    number: u64,
    shift: i64,
    described: HashSet<u32>,
    names: Names,
    activity: Activity,
}

impl Recording {
    /// A number of a track, of this recording.
    fn track(&self, number: u64) -> u64 {
        self.number * RECORDING + number
    }

    fn put(
        &mut self,
        record: &Record<'_>,
        put: &mut impl FnMut(Message) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        self.names.take(record);
        let shift = self.shift;
        let time = |time: u64| shifted(time, shift);
        match record {
            Record::Session { system, .. } => {
                let pid = PROCESS + self.number;
                let process = Message::default().number(1, pid).text(6, system);
                put(track(self.track(PROCESS), None, |track| {
                    track.message(3, &process)
                }))
            }
            Record::Thread { number, name } => {
                let pid = PROCESS + self.number;
                // A thread with the number of its process is the main thread, which that names;
                // and the trace's processes share the numbers of threads.
                let tid = (self.number << 20) + u64::from(*number) + 2 + self.number;
                let thread = Message::default()
                    .number(1, pid)
                    .number(2, tid)
                    .text(5, name);
                let uuid = self.track(THREADS + u64::from(*number));
                put(track(uuid, Some(self.track(PROCESS)), |track| {
                    track.message(4, &thread)
                }))
            }
            Record::Signal(info) => {
                if !self.described.insert(info.number) {
                    return Ok(());
                }
                (0..info.elements).try_for_each(|element| put(self.counter(info, element)))
            }
            Record::Sample {
                signal,
                time: at,
                values,
            } => values.iter().enumerate().try_for_each(|(element, value)| {
                let event = Message::default()
                    .number(9, COUNTER)
                    .number(11, self.signal(*signal, element));
                let event = match value {
                    Value::Bool(value) => event.number(30, value.into()),
                    Value::Signed(value) => event.number(30, value as u64),
                    // A counter of the trace is signed.
                    Value::Unsigned(value) if value > i64::MAX as u64 => {
                        event.double(44, value as f64)
                    }
                    Value::Unsigned(value) => event.number(30, value),
                    Value::Float(value) => event.double(44, value),
                };
                put(Message::default().number(8, time(*at)).message(11, &event))
            }),
            Record::Message {
                thread,
                time: at,
                level,
                target,
                text,
                ..
            } => {
                let from = Message::default().text(10, "target").text(6, target);
                let event = Message::default()
                    .number(9, INSTANT)
                    .number(11, self.track(THREADS + u64::from(*thread)))
                    .text(22, level.name())
                    .text(23, text)
                    .message(4, &from);
                put(Message::default().number(8, time(*at)).message(11, &event))
            }
            // The trace has one clock, that of the first recording.
            Record::Epoch { .. } if self.number > 0 => Ok(()),
            Record::Epoch { time, unix } => {
                let clock = |id, time| Message::default().number(1, id).number(2, time);
                let clocks = Message::default()
                    .message(1, &clock(MONOTONIC, *time))
                    .message(1, &clock(REALTIME, unix.cast_unsigned()))
                    .number(2, MONOTONIC);
                // Of all packets from here on. The schema's own default is another clock.
                let defaults = Message::default().number(58, MONOTONIC);
                put(Message::default()
                    .number(8, *time)
                    .message(59, &defaults)
                    .message(6, &clocks))
            }
            Record::Event(event) => {
                let event = Event {
                    time: time(event.time),
                    ..*event
                };
                self.activity.put(&self.names, &event, put)
            }
            _ => Ok(()),
        }
    }

    fn counter(&self, info: &SignalInfo<'_>, element: u8) -> Message {
        let name = if info.elements > 1 {
            format!("{}[{element}]", info.name)
        } else {
            info.name.to_owned()
        };
        let counter = match info.unit {
            "" => Message::default(),
            unit => Message::default().text(6, unit),
        };
        let uuid = self.signal(info.number, element.into());
        track(uuid, Some(self.track(PROCESS)), |track| {
            track.text(2, &name).message(8, &counter)
        })
    }

    fn signal(&self, signal: u32, element: usize) -> u64 {
        // A signal has at most 16 elements.
        self.track(SIGNALS + u64::from(signal) * 16 + element as u64)
    }
}

/// A packet that describes a track.
pub(super) fn track(
    uuid: u64,
    parent: Option<u64>,
    more: impl FnOnce(Message) -> Message,
) -> Message {
    let described = Message::default().number(1, uuid);
    let described = match parent {
        Some(parent) => described.number(5, parent),
        None => described,
    };
    Message::default().message(60, &more(described))
}
