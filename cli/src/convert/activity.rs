//! Events as tracks of a Perfetto trace: what each process and each named part of one does, and
//! what each executor runs.

use super::perfetto::{INSTANT, PROCESS, THREADS, track};
use super::protobuf::Message;
use luna_core::events::code;
use luna_logger::format::{Event, Names, Subject};
use std::collections::{HashMap, HashSet};

/// Tracks of executors, those of processes, and those of sub-processes are numbered from here.
const EXECUTORS: u64 = 1 << 36;
const PROCESSES: u64 = 1 << 41;
const SUB_PROCESSES: u64 = 1 << 42;

/// `TrackEvent.Type`
const BEGIN: u64 = 1;
const END: u64 = 2;

/// What a process does.
#[derive(Clone, Copy, PartialEq)]
enum State {
    Running,
    Ready,
    Waiting,
}

/// The open slices of the tracks.
#[derive(Default)]
pub(super) struct Activity {
    described: HashSet<u64>,
    processes: HashMap<u32, State>,
    /// The process with an open slice on an executor's track; 0 while the executor sleeps.
    executors: HashMap<u32, u32>,
    /// The tracks of running sub-processes, and whether a slice is open there.
    sub_processes: HashMap<u32, (Position, u64, bool)>,
    /// The tracks of ended processes, for later ones at the same place.
    free: HashMap<Position, Vec<u64>>,
    places: u64,
    flows: u64,
}

/// Where a sub-process stands: the track that it is below, and its name. One that begins again and
/// again has one track.
type Position = (u64, String);

/// The packets of one event, in their order.
struct Packets<'a, P> {
    put: P,
    names: &'a Names,
    described: &'a mut HashSet<u64>,
    time: u64,
}

impl<E, P: FnMut(Message) -> Result<(), E>> Packets<'_, P> {
    fn event(&mut self, event: &Message) -> Result<(), E> {
        let packet = Message::default().number(8, self.time);
        (self.put)(packet.message(11, event))
    }

    /// The track of a process or executor, which is described the first time.
    fn track(&mut self, of: Subject, number: u32) -> Result<u64, E> {
        let (first, kind) = match of {
            Subject::Executor => (EXECUTORS, "executor "),
            _ => (PROCESSES, ""),
        };
        let uuid = first + u64::from(number);
        if self.described.insert(uuid) {
            let name = format!("{kind}{}", self.names.of(of, number.into()));
            (self.put)(track(uuid, Some(PROCESS), |track| track.text(2, &name)))?;
        }
        Ok(uuid)
    }

    fn begin(&mut self, track: u64, name: &str) -> Result<(), E> {
        let event = Message::default().number(9, BEGIN).number(11, track);
        self.event(&event.text(23, name))
    }

    fn end(&mut self, track: u64) -> Result<(), E> {
        self.event(&Message::default().number(9, END).number(11, track))
    }

    fn instant(
        &mut self,
        track: u64,
        name: &str,
        more: impl FnOnce(Message) -> Message,
    ) -> Result<(), E> {
        let event = Message::default().number(9, INSTANT).number(11, track);
        self.event(&more(event.text(23, name)))
    }
}

impl Activity {
    /// Adds an event to the trace.
    pub(super) fn put<E>(
        &mut self,
        names: &Names,
        event: &Event,
        put: impl FnMut(Message) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut packets = Packets {
            put,
            names,
            described: &mut self.described,
            time: event.time,
        };
        let process = event.subject;
        let [a, b] = event.arguments;
        let words = names.words(event);
        match event.code {
            code::READY => {
                // A process that is woken while it runs, or once more, keeps its state.
                let state = self.processes.get(&process);
                if matches!(state, None | Some(State::Waiting)) {
                    turn(
                        &mut self.processes,
                        &mut packets,
                        process,
                        State::Ready,
                        "ready",
                    )?;
                }
            }
            code::RUNNING => {
                turn(
                    &mut self.processes,
                    &mut packets,
                    process,
                    State::Running,
                    "running",
                )?;
                let track = packets.track(Subject::Executor, event.thread)?;
                if self.executors.insert(event.thread, process).is_some() {
                    packets.end(track)?;
                }
                packets.begin(track, &words.subject)?;
            }
            code::WAITING => {
                if a == code::STILL_READY {
                    turn(
                        &mut self.processes,
                        &mut packets,
                        process,
                        State::Ready,
                        "ready",
                    )?;
                } else {
                    let name = waiting(&words.first);
                    turn(
                        &mut self.processes,
                        &mut packets,
                        process,
                        State::Waiting,
                        &name,
                    )?;
                }
                leave(&mut self.executors, &mut packets, event.thread)?;
            }
            code::DONE => {
                let track = packets.track(Subject::Process, process)?;
                if self.processes.remove(&process).is_some() {
                    packets.end(track)?;
                }
                packets.instant(track, &format!("done: {}", words.first), |event| event)?;
                if self.executors.get(&event.thread) == Some(&process) {
                    leave(&mut self.executors, &mut packets, event.thread)?;
                }
            }
            code::ASLEEP => {
                let track = packets.track(Subject::Executor, event.subject)?;
                if self.executors.insert(event.subject, 0).is_some() {
                    packets.end(track)?;
                }
                packets.begin(track, "asleep")?;
            }
            code::AWAKE => leave(&mut self.executors, &mut packets, event.subject)?,
            code::SUB_RUNNING => {
                if !self.sub_processes.contains_key(&process) {
                    let around = u32::try_from(b).ok();
                    let around = around.and_then(|around| self.sub_processes.get(&around));
                    let below = match around {
                        Some((_, track, _)) => *track,
                        None => packets.track(Subject::Process, a as u32)?,
                    };
                    let place = (below, words.subject.clone());
                    let track = match self.free.get_mut(&place).and_then(Vec::pop) {
                        Some(track) => track,
                        None => {
                            self.places += 1;
                            let uuid = SUB_PROCESSES + self.places;
                            let described =
                                track(uuid, Some(below), |track| track.text(2, &words.subject));
                            (packets.put)(described)?;
                            uuid
                        }
                    };
                    self.sub_processes.insert(process, (place, track, false));
                }
                sub_turn(
                    &mut self.sub_processes,
                    &mut packets,
                    process,
                    Some("running"),
                )?;
            }
            code::SUB_WAITING => {
                let name = waiting(&words.first);
                sub_turn(&mut self.sub_processes, &mut packets, process, Some(&name))?;
            }
            code::SUB_DONE => {
                sub_turn(&mut self.sub_processes, &mut packets, process, None)?;
                if let Some((place, track, _)) = self.sub_processes.remove(&process) {
                    self.free.entry(place).or_default().push(track);
                }
            }
            code::COMMUNICATION => {
                let ends = [(a, "send"), (b, "receive")];
                self.flows += 1;
                let flow = self.flows;
                for (index, (process, does)) in ends.into_iter().enumerate() {
                    let Some(process) = u32::try_from(process).ok().filter(|one| *one != 0) else {
                        continue;
                    };
                    let track = packets.track(Subject::Process, process)?;
                    let name = format!("{does} {}", words.subject);
                    // `flow_ids`, and where it ends `terminating_flow_ids`; only from one to
                    // another.
                    packets.instant(track, &name, |event| match (a, b) {
                        (0, _) | (_, 0) => event,
                        _ if index == 0 => event.fixed(47, flow),
                        _ => event.fixed(48, flow),
                    })?;
                }
            }
            _ => {
                let owner = match event.code {
                    code::SLOT | code::LATE => names.process_of_loop(event.subject),
                    code::SPAWNED => u32::try_from(a).unwrap_or_default(),
                    code::ALTERNATIVE | code::PRIORITY | code::EMERGENCY => process,
                    _ => 0,
                };
                let track = match owner {
                    0 => THREADS + u64::from(event.thread),
                    owner => packets.track(Subject::Process, owner)?,
                };
                let note = |name: &str, text: &str| Message::default().text(10, name).text(6, text);
                packets.instant(
                    track,
                    &format!("{} {}", words.what, words.subject),
                    |event| {
                        event
                            .message(4, &note("first", &words.first))
                            .message(4, &note("second", &words.second))
                    },
                )?;
            }
        }
        Ok(())
    }
}

fn waiting(awaited: &str) -> String {
    match awaited {
        "" => "waiting".to_owned(),
        awaited => format!("waiting for {awaited}"),
    }
}

/// A sub-process does something else now, or has ended. If its begin was lost, nothing is known of
/// it.
fn sub_turn<E, P: FnMut(Message) -> Result<(), E>>(
    sub_processes: &mut HashMap<u32, (Position, u64, bool)>,
    packets: &mut Packets<'_, P>,
    one: u32,
    does: Option<&str>,
) -> Result<(), E> {
    let Some((_, track, is_open)) = sub_processes.get_mut(&one) else {
        return Ok(());
    };
    if std::mem::replace(is_open, does.is_some()) {
        packets.end(*track)?;
    }
    does.map_or(Ok(()), |name| packets.begin(*track, name))
}

/// A process does something else now.
fn turn<E, P: FnMut(Message) -> Result<(), E>>(
    processes: &mut HashMap<u32, State>,
    packets: &mut Packets<'_, P>,
    process: u32,
    state: State,
    name: &str,
) -> Result<(), E> {
    let track = packets.track(Subject::Process, process)?;
    if processes.insert(process, state).is_some() {
        packets.end(track)?;
    }
    packets.begin(track, name)
}

/// An executor runs no process now, or has woken.
fn leave<E, P: FnMut(Message) -> Result<(), E>>(
    executors: &mut HashMap<u32, u32>,
    packets: &mut Packets<'_, P>,
    executor: u32,
) -> Result<(), E> {
    if executors.remove(&executor).is_some() {
        let track = packets.track(Subject::Executor, executor)?;
        packets.end(track)?;
    }
    Ok(())
}
