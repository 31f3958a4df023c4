//! A recording that was read.

use super::error::RecordError;
use super::event::{Event, Kind, Reader};
use super::file::{BlockKind, blocks};
use super::recorder::file_error;
use luna_core::replay_log::About;
use std::path::Path;

/// A recording that was read from its file, to be given to
/// `System::replay`. It can be replayed any number of times.
#[derive(Debug, Clone)]
pub struct Recording {
    pub(super) system: String,
    pub(super) note: String,
    /// What parameters began with: names and values.
    pub(super) parameters: Vec<(String, String)>,
    pub(super) processes: Vec<Recorded>,
    /// All that was recorded is there.
    pub(super) is_whole: bool,
    /// What a process did that is not recorded.
    outside: Option<RecordError>,
}

/// The events of one process.
#[derive(Debug, Clone)]
pub(super) struct Recorded {
    /// The process that spawned it: its number from 1, or 0.
    pub(super) parent: u32,
    pub(super) name: String,
    /// Which of its name and parent it is.
    pub(super) occurrence: u32,
    pub(super) events: Vec<Event>,
}

impl Recording {
    /// Reads a recording. Not for the real-time path: it keeps all of it in memory.
    ///
    /// # Errors
    ///
    /// [`RecordError`]: a file that cannot be read, is no recording, or is damaged or truncated;
    /// one of a run that did what is not recorded.
    pub fn open(path: impl AsRef<Path>) -> Result<Recording, RecordError> {
        match Self::salvage(path)? {
            (recording, None) => Ok(recording),
            (_, Some(error)) => Err(error),
        }
    }

    /// Reads a recording as far as it is whole, and returns the fault behind that. A replay of one
    /// goes up to there. It may report a difference where the events of a channel's first sender
    /// are lost: their communications have no stamp.
    ///
    /// # Errors
    ///
    /// [`RecordError`]: a file that cannot be read, or has not even the begin of a recording of
    /// this version.
    pub fn salvage(
        path: impl AsRef<Path>,
    ) -> Result<(Recording, Option<RecordError>), RecordError> {
        let path = path.as_ref();
        let file = std::fs::read(path).map_err(|error| file_error(path, &error))?;
        Self::parse(&file)
    }

    pub(super) fn parse(file: &[u8]) -> Result<(Recording, Option<RecordError>), RecordError> {
        let (blocks, mut wrong) = blocks(file)?;
        let mut recording = Recording {
            system: String::new(),
            note: String::new(),
            parameters: Vec::new(),
            processes: Vec::new(),
            is_whole: wrong.is_none(),
            outside: None,
        };
        // Of each process.
        let mut streams: Vec<Vec<u8>> = Vec::new();
        for (kind, bytes) in blocks {
            if recording.take(kind, bytes, &mut streams).is_none() {
                // The checksum is right, so this is not how it was written.
                wrong.get_or_insert(RecordError::NoRecording);
                recording.is_whole = false;
                break;
            }
        }
        if wrong.is_none() {
            wrong.clone_from(&recording.outside);
        }
        for (process, bytes) in recording.processes.iter_mut().zip(&streams) {
            let mut reader = Reader::new(bytes);
            process.events = std::iter::from_fn(|| reader.next()).collect();
            if reader.left() > 0 && recording.is_whole {
                wrong.get_or_insert(RecordError::NoRecording);
            }
        }
        Ok((recording, wrong))
    }

    fn take(&mut self, kind: BlockKind, bytes: &[u8], streams: &mut Vec<Vec<u8>>) -> Option<()> {
        let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).ok();
        // Of all kinds but the first three.
        let numbered = || word(bytes);
        match kind {
            BlockKind::System => self.system = text(bytes)?,
            BlockKind::Note => self.note = text(bytes)?,
            BlockKind::End => {}
            BlockKind::Process => {
                let (number, rest) = numbered()?;
                let (parent, rest) = word(rest)?;
                let (occurrence, name) = word(rest)?;
                // Numbers are those of their order, and the spawning process was there before.
                if number as usize != self.processes.len() || parent > number {
                    return None;
                }
                let recorded = Recorded {
                    parent,
                    name: text(name)?,
                    occurrence,
                    events: Vec::new(),
                };
                self.processes.push(recorded);
                streams.push(Vec::new());
            }
            BlockKind::Events => {
                let (number, rest) = numbered()?;
                streams.get_mut(number as usize)?.extend(rest);
            }
            BlockKind::Lost => {
                let (number, _) = numbered()?;
                self.processes.get(number as usize)?;
                self.is_whole = false;
            }
            BlockKind::Outside => {
                let (number, rest) = numbered()?;
                let process = self.processes.get(number as usize)?.name.clone();
                self.outside.get_or_insert(RecordError::Outside {
                    process,
                    construct: text(rest)?,
                });
            }
            BlockKind::Parameter => {
                let (number, rest) = numbered()?;
                let (name, value) = rest.split_at_checked(number as usize)?;
                self.parameters.push((text(name)?, text(value)?));
            }
        }
        Some(())
    }

    /// The name of the system that was recorded.
    pub fn system(&self) -> &str {
        &self.system
    }

    /// The text of `System::record_note`.
    pub fn note(&self) -> &str {
        &self.note
    }

    /// The names of the processes that were recorded, in the order of their begin.
    pub fn processes(&self) -> impl Iterator<Item = &str> {
        self.processes.iter().map(|process| process.name.as_str())
    }

    /// How many events there are.
    pub fn events(&self) -> u64 {
        let counts = self.processes.iter().map(|process| process.events.len());
        counts.sum::<usize>() as u64
    }

    /// How many of these are [outputs](crate::output), or bytes written by a link, which a
    /// replay compares.
    pub fn outputs(&self) -> u64 {
        let events = self.processes.iter().flat_map(|process| &process.events);
        let is_output = |event: &&Event| {
            matches!(
                event.kind,
                Kind::Bytes {
                    about: About::Output,
                    ..
                }
            )
        };
        events.filter(is_output).count() as u64
    }

    /// Whether the recording is whole: it was written to its end, and nothing was lost for want of
    /// room.
    pub fn is_whole(&self) -> bool {
        self.is_whole
    }

    /// Whether every process had returned when the recording ended.
    pub fn has_ended(&self) -> bool {
        let has_ended = |process: &Recorded| {
            let last = process.events.iter().rfind(|event| event.path == 0);
            last.is_some_and(|event| event.kind == Kind::Ended)
        };
        self.processes.iter().all(has_ended)
    }
}

fn word(bytes: &[u8]) -> Option<(u32, &[u8])> {
    let (word, rest) = bytes.split_first_chunk()?;
    Some((u32::from_le_bytes(*word), rest))
}
