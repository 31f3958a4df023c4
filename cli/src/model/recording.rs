//! What a recording says of communications, and of what communicates.

use crate::convert::open;
use crate::failure::{Failure, failed};
use luna_events::code;
use luna_logger::format::{ClockBase, Event, Losing, ReadError, Record, Subject};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A recording, up to where it is whole.
#[derive(Debug, Default)]
pub(super) struct Recording {
    pub(super) system: String,
    pub(super) is_virtual: bool,
    /// All times count from here.
    pub(super) start: u64,
    /// By their numbers.
    pub(super) processes: BTreeMap<u32, Named>,
    /// With what their buffers are, as a name record has it.
    pub(super) channels: BTreeMap<u32, (String, u32)>,
    pub(super) threads: BTreeMap<u32, String>,
    pub(super) communications: Vec<Seen>,
    /// The processes that have ended by themselves, and when.
    pub(super) ended: BTreeMap<u32, u64>,
    /// When the first process was ended by something else.
    pub(super) stopped: Option<u64>,
    pub(super) loops: BTreeMap<u32, Slots>,
    /// The cores on which cycles of a thread began late.
    pub(super) cores: BTreeMap<u32, BTreeSet<usize>>,
    /// So many communications came before anything was lost.
    pub(super) certain: usize,
    pub(super) cut: Option<Cut>,
}

/// A process.
#[derive(Debug, Default)]
pub(super) struct Named {
    pub(super) name: String,
    /// The numbers of its executor, and its level there; none for one of another system.
    pub(super) runs_on: Option<(u32, u8)>,
}

/// A communication. 0 is no process.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub(super) thread: u32,
    pub(super) time: u64,
    pub(super) channel: u32,
    pub(super) sender: u32,
    pub(super) receiver: u32,
}

/// The cycles of a loop: the number and the slot of the first and of the last.
#[derive(Debug)]
pub(super) struct Slots {
    pub(super) process: u32,
    pub(super) ends: Option<[(u64, u64); 2]>,
}

/// Why a recording is not used to its end.
#[derive(Debug, thiserror::Error)]
pub(super) enum Cut {
    /// Events of this thread found no room in its ring.
    #[error(
        "{events} events of the thread {thread} were lost while it was recorded: give the \
         rings more room (`Logging::room_for_events`, LUNA_LOG_EVENTS)"
    )]
    Lost { thread: String, events: u64 },
    /// Blocks were lost on the way to the recorder.
    #[error("{0} blocks were lost on the way to the recorder")]
    Blocks(u64),
    /// The recorder had to start again.
    #[error("the recorder had to start again")]
    Again,
    /// The program was killed: what was lost just before is not recorded.
    #[error("the recording has no end: what was lost just before is not known")]
    Killed,
    /// It is damaged.
    #[error(transparent)]
    Damaged(ReadError),
}

impl Recording {
    /// Reads it. What comes after the first loss or damage is left out.
    pub(super) fn read(path: &Path) -> Result<Self, Failure> {
        let mut reader = open(path)?;
        let mut recording = Self::default();
        let mut has_start = false;
        let mut sessions = 0;
        loop {
            let record = match reader.next() {
                Ok(Some(record)) => record,
                Ok(None) => break,
                // What a killed program leaves.
                Err(error) if error.is_truncated() => break,
                Err(error) => {
                    recording.cut(Cut::Damaged(error), true);
                    break;
                }
            };
            let time = match &record {
                Record::Epoch { time, .. } => Some(*time),
                Record::Event(event) => Some(event.time),
                _ => None,
            };
            if let Some(time) = time.filter(|_| !has_start) {
                (recording.start, has_start) = (time, true);
            }
            match record {
                Record::Session { system, clock, .. } => {
                    sessions += 1;
                    if sessions > 1 {
                        recording.cut(Cut::Again, true);
                        break;
                    }
                    system.clone_into(&mut recording.system);
                    recording.is_virtual = clock == ClockBase::Virtual;
                }
                // It stands at the begin of a round of the recorder. What is lost after that is
                // reported after it.
                Record::Epoch { .. } => recording.certain = recording.communications.len(),
                Record::Losses { of, lost } if lost > 0 => match of {
                    Losing::Events(thread) => {
                        let thread = recording.thread(thread);
                        let lost = Cut::Lost {
                            thread,
                            events: lost,
                        };
                        recording.cut(lost, false);
                        break;
                    }
                    Losing::Blocks => {
                        recording.cut(Cut::Blocks(lost), true);
                        break;
                    }
                    _ => {}
                },
                Record::Event(event) => recording.take(&event),
                Record::Thread { number, name } => {
                    recording.threads.insert(number, name.to_owned());
                }
                Record::Name {
                    subject,
                    number,
                    parent,
                    name,
                    runs_on,
                } => recording.name(
                    subject,
                    (number, parent),
                    name,
                    runs_on.map(|on| (on.executor, on.level)),
                ),
                _ => {}
            }
        }
        if recording.cut.is_none() && !reader.has_ended() {
            recording.cut(Cut::Killed, false);
        }
        if recording.cut.is_none() {
            recording.certain = recording.communications.len();
        }
        if recording.communications.is_empty() && matches!(recording.cut, None | Some(Cut::Killed))
        {
            return Err(failed(path)(
                "it has no communications: record it with events (`Logging::events`, or \
                 LUNA_LOG_EVENTS in its environment)",
            ));
        }
        Ok(recording)
    }

    /// It is not read on. `is_here`: nothing is missing before.
    fn cut(&mut self, cut: Cut, is_here: bool) {
        self.cut = Some(cut);
        if is_here {
            self.certain = self.communications.len();
        }
    }

    fn take(&mut self, event: &Event) {
        let [first, second] = event.arguments;
        let number = |argument: u64| u32::try_from(argument).unwrap_or_default();
        match event.code {
            code::COMMUNICATION => self.communications.push(Seen {
                thread: event.thread,
                time: event.time,
                channel: event.subject,
                sender: number(first),
                receiver: number(second),
            }),
            code::DONE => match first {
                code::ended::OK | code::ended::ERROR => {
                    self.ended.insert(event.subject, event.time);
                }
                _ => {
                    let stopped = self.stopped.unwrap_or(u64::MAX);
                    self.stopped = Some(stopped.min(event.time));
                }
            },
            code::SLOT => {
                let slot = (first, event.time.saturating_sub(second));
                if let Some(found) = self.loops.get_mut(&event.subject) {
                    found.ends.get_or_insert([slot; 2])[1] = slot;
                }
            }
            code::LATE => {
                let core = code::late::core(second);
                self.cores.entry(event.thread).or_default().extend(core);
            }
            _ => {}
        }
    }

    fn name(
        &mut self,
        subject: Subject,
        (number, parent): (u32, u32),
        name: &str,
        runs_on: Option<(u32, u8)>,
    ) {
        let name = name.to_owned();
        match subject {
            Subject::Process => {
                self.processes.insert(number, Named { name, runs_on });
            }
            Subject::Channel => drop(self.channels.insert(number, (name, parent))),
            Subject::Executor => drop(self.threads.insert(number, name)),
            Subject::Loop => {
                let found = self.loops.entry(number).or_insert(Slots {
                    process: parent,
                    ends: None,
                });
                found.process = parent;
            }
            _ => {}
        }
    }

    /// The name of a process; none for 0.
    pub(super) fn process(&self, number: u32) -> Option<String> {
        let known = self.processes.get(&number).map(|one| one.name.clone());
        (number != 0).then(|| known.unwrap_or_else(|| format!("process {number}")))
    }

    pub(super) fn channel(&self, number: u32) -> String {
        let known = self.channels.get(&number).map(|(name, _)| name.clone());
        known.unwrap_or_else(|| format!("channel {number}"))
    }

    pub(super) fn thread(&self, number: u32) -> String {
        let known = self.threads.get(&number).cloned();
        known.unwrap_or_else(|| format!("thread {number}"))
    }

    /// Seconds since the start.
    pub(super) fn seconds(&self, time: u64) -> String {
        let nanos = time.saturating_sub(self.start);
        format!("{}.{:09} s", nanos / 1_000_000_000, nanos % 1_000_000_000)
    }
}
