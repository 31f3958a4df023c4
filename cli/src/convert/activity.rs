//! Events as tracks of a Perfetto trace: what each process and each named part of one does, and
//! what each executor runs.

use super::perfetto::{INSTANT, PROCESS, THREADS, track};
use crate::failure::Failure;
use luna_events::code;
use luna_logger::format::protobuf::Message;
use luna_logger::format::{Event, Names, Subject, Words};
use std::collections::{HashMap, HashSet};

/// Tracks of executors, those of processes, and those of sub-processes are numbered from here.
const EXECUTORS: u64 = 1 << 36;
const PROCESSES: u64 = 1 << 41;
const SUB_PROCESSES: u64 = 1 << 42;

/// `TrackEvent.Type`
const BEGIN: u64 = 1;
const END: u64 = 2;

/// The open slices of the tracks.
#[derive(Default)]
pub(super) struct Activity {
    described: HashSet<u64>,
    /// Whether a process waits; it has an open slice.
    processes: HashMap<u32, bool>,
    /// The process with an open slice on an executor's track; 0 while the executor sleeps.
    executors: HashMap<u32, u32>,
    /// The tracks of running sub-processes, and whether a slice is open there.
    sub_processes: HashMap<u32, (Position, u64, bool)>,
    /// The tracks of ended processes, for later ones at the same place.
    free: HashMap<Position, Vec<u64>>,
    places: u64,
    flows: u64,
    /// Added to the numbers of tracks and flows: no other recording has them then.
    base: u64,
}

/// Where a sub-process stands: the track that it is below, and its name. One that begins again and
/// again has one track.
type Position = (u64, String);

impl Activity {
    /// Of a recording whose numbers begin there.
    pub(super) fn of(base: u64) -> Self {
        Self {
            base,
            ..Self::default()
        }
    }

    /// Adds an event to the trace.
    pub(super) fn put(
        &mut self,
        names: &Names,
        event: &Event,
        put: &mut dyn FnMut(Message) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let mut packets = Packets {
            activity: self,
            put,
            names,
            time: event.time,
        };
        packets.event(event, &names.words(event))
    }
}

/// The packets of one event, in their order.
struct Packets<'a> {
    activity: &'a mut Activity,
    put: &'a mut dyn FnMut(Message) -> Result<(), Failure>,
    names: &'a Names,
    time: u64,
}

impl Packets<'_> {
    fn event(&mut self, event: &Event, words: &Words) -> Result<(), Failure> {
        let process = event.subject;
        let [a, b] = event.arguments;
        match event.code {
            code::READY => {
                // A process that is woken while it runs, or once more, keeps its state.
                let waits = self.activity.processes.get(&process);
                if waits.copied().unwrap_or(true) {
                    self.turn(process, false, "ready")?;
                }
            }
            code::RUNNING => {
                self.turn(process, false, "running")?;
                self.occupy(event.thread, process, &words.subject)?;
            }
            code::WAITING => {
                match a {
                    code::STILL_READY => self.turn(process, false, "ready")?,
                    _ => self.turn(process, true, &waiting(&words.first))?,
                }
                self.leave(event.thread)?;
            }
            code::DONE => {
                let track = self.track(Subject::Process, process)?;
                if self.activity.processes.remove(&process).is_some() {
                    self.end(track)?;
                }
                self.instant(track, &format!("done: {}", words.first), |event| event)?;
                if self.activity.executors.get(&event.thread) == Some(&process) {
                    self.leave(event.thread)?;
                }
            }
            code::ASLEEP => self.occupy(event.subject, 0, "asleep")?,
            code::AWAKE => self.leave(event.subject)?,
            code::SUB_RUNNING => {
                if !self.activity.sub_processes.contains_key(&process) {
                    self.begin_sub_process(process, [a, b], &words.subject)?;
                }
                self.sub_turn(process, Some("running"))?;
            }
            code::SUB_WAITING => self.sub_turn(process, Some(&waiting(&words.first)))?,
            code::SUB_DONE => {
                self.sub_turn(process, None)?;
                if let Some((place, track, _)) = self.activity.sub_processes.remove(&process) {
                    self.activity.free.entry(place).or_default().push(track);
                }
            }
            code::COMMUNICATION => {
                self.activity.flows += 1;
                let flow = self.activity.base + self.activity.flows;
                // `flow_ids`, and where it ends `terminating_flow_ids`; only from one to another.
                for (process, does, field) in [(a, "send", 47), (b, "receive", 48)] {
                    let Some(process) = u32::try_from(process).ok().filter(|one| *one != 0) else {
                        continue;
                    };
                    let track = self.track(Subject::Process, process)?;
                    let name = format!("{does} {}", words.subject);
                    self.instant(track, &name, |event| match (a, b) {
                        (0, _) | (_, 0) => event,
                        _ => event.fixed(field, flow),
                    })?;
                }
            }
            // One is in the recording of one program, the other in that of the other.
            code::LINK => {
                let is_taken = code::link::is_taken(b);
                let (does, field) = match is_taken {
                    true => ("take", 48),
                    false => ("give", 47),
                };
                let flow = between_programs(code::link::session(b), a);
                let track = self.track(Subject::Process, process)?;
                let name = format!("{does} value {a}");
                self.instant(track, &name, |event| event.fixed(field, flow))?;
            }
            _ => {
                let owner = match event.code {
                    code::SLOT | code::LATE => self.names.process_of_loop(event.subject),
                    code::SPAWNED => u32::try_from(a).unwrap_or_default(),
                    code::ALTERNATIVE | code::PRIORITY | code::EMERGENCY => process,
                    _ => 0,
                };
                let track = match owner {
                    0 => self.activity.base + THREADS + u64::from(event.thread),
                    owner => self.track(Subject::Process, owner)?,
                };
                let note = |name: &str, text: &str| Message::default().text(10, name).text(6, text);
                let name = format!("{} {}", words.what, words.subject);
                self.instant(track, &name, |event| {
                    event
                        .message(4, &note("first", &words.first))
                        .message(4, &note("second", &words.second))
                })?;
            }
        }
        Ok(())
    }

    /// A process does something else now.
    fn turn(&mut self, process: u32, waits: bool, name: &str) -> Result<(), Failure> {
        let track = self.track(Subject::Process, process)?;
        if self.activity.processes.insert(process, waits).is_some() {
            self.end(track)?;
        }
        self.begin(track, name)
    }

    /// An executor runs a process now, or sleeps.
    fn occupy(&mut self, executor: u32, process: u32, name: &str) -> Result<(), Failure> {
        let track = self.track(Subject::Executor, executor)?;
        if self.activity.executors.insert(executor, process).is_some() {
            self.end(track)?;
        }
        self.begin(track, name)
    }

    /// An executor runs no process now, or has woken.
    fn leave(&mut self, executor: u32) -> Result<(), Failure> {
        if self.activity.executors.remove(&executor).is_some() {
            let track = self.track(Subject::Executor, executor)?;
            self.end(track)?;
        }
        Ok(())
    }

    /// Gives a sub-process a track: one of an ended one at the same place, or a new one.
    fn begin_sub_process(
        &mut self,
        one: u32,
        [process, around]: [u64; 2],
        name: &str,
    ) -> Result<(), Failure> {
        let around = u32::try_from(around).ok();
        let around = around.and_then(|around| self.activity.sub_processes.get(&around));
        let below = match around {
            Some((_, track, _)) => *track,
            None => self.track(Subject::Process, process as u32)?,
        };
        let place = (below, name.to_owned());
        let track = match self.activity.free.get_mut(&place).and_then(Vec::pop) {
            Some(track) => track,
            None => {
                self.activity.places += 1;
                let uuid = self.activity.base + SUB_PROCESSES + self.activity.places;
                (self.put)(track(uuid, Some(below), |track| track.text(2, name)))?;
                uuid
            }
        };
        let sub_process = (place, track, false);
        self.activity.sub_processes.insert(one, sub_process);
        Ok(())
    }

    /// A sub-process does something else now, or has ended. If its begin was lost, nothing is known
    /// of it.
    fn sub_turn(&mut self, one: u32, does: Option<&str>) -> Result<(), Failure> {
        let Some((_, track, is_open)) = self.activity.sub_processes.get_mut(&one) else {
            return Ok(());
        };
        let (track, was_open) = (*track, std::mem::replace(is_open, does.is_some()));
        if was_open {
            self.end(track)?;
        }
        does.map_or(Ok(()), |name| self.begin(track, name))
    }

    /// The track of a process or executor, which is described the first time.
    fn track(&mut self, of: Subject, number: u32) -> Result<u64, Failure> {
        let (first, kind) = match of {
            Subject::Executor => (EXECUTORS, "executor "),
            _ => (PROCESSES, ""),
        };
        let uuid = self.activity.base + first + u64::from(number);
        if self.activity.described.insert(uuid) {
            let name = format!("{kind}{}", self.names.of(of, number.into()));
            let system = self.activity.base + PROCESS;
            (self.put)(track(uuid, Some(system), |track| track.text(2, &name)))?;
        }
        Ok(uuid)
    }

    fn begin(&mut self, track: u64, name: &str) -> Result<(), Failure> {
        self.packet(BEGIN, track, |event| event.text(23, name))
    }

    fn end(&mut self, track: u64) -> Result<(), Failure> {
        self.packet(END, track, |event| event)
    }

    fn instant(
        &mut self,
        track: u64,
        name: &str,
        more: impl FnOnce(Message) -> Message,
    ) -> Result<(), Failure> {
        self.packet(INSTANT, track, |event| more(event.text(23, name)))
    }

    fn packet(
        &mut self,
        kind: u64,
        track: u64,
        more: impl FnOnce(Message) -> Message,
    ) -> Result<(), Failure> {
        let event = Message::default().number(9, kind).number(11, track);
        let packet = Message::default().number(8, self.time);
        (self.put)(packet.message(11, &more(event)))
    }
}

/// The flow of a value: the same in both recordings, and above those within one.
fn between_programs(session: u64, number: u64) -> u64 {
    // The golden ratio, as of hashes: numbers of one session are far apart.
    const SPREAD: u64 = 0x9e37_79b9_7f4a_7c15;
    session.wrapping_add(number.wrapping_mul(SPREAD)) | 1 << 63
}

fn waiting(awaited: &str) -> String {
    match awaited {
        "" => "waiting".to_owned(),
        awaited => format!("waiting for {awaited}"),
    }
}
