//! Recording: the events of each process, and the thread that writes them.

mod track;

pub(crate) use track::Track;

use super::error::RecordError;
use super::file::{BlockKind, Writer};
use luna_core::Name;
use luna_events::ByteRing;
use luna_machine::{new_file, signals};
use luna_platform::thread::{Attributes, Policy, Thread, spawn};
use std::collections::HashMap;
use std::convert::Infallible;
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// The default room of a process' ring.
pub const ROOM: usize = 64 << 10;
/// The interval at which the thread looks at the rings.
const PAUSE: Duration = Duration::from_millis(2);
/// The longest wait for the file at the end of a recording, and the longest when a signal asks for
/// the end of the program; the pauses meanwhile.
const END_WITHIN: Duration = Duration::from_secs(10);
const PATIENCE: Duration = Duration::from_millis(50);
const LONGEST_PAUSE: Duration = Duration::from_millis(5);
/// The longest part of a ring in one block.
const MAX_AT_ONCE: usize = 32 << 10;

/// Counters of a recording or a replay: in the report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct RecordReport {
    /// Number of recorded events; of a replay, the number of events that were replayed.
    pub events: u64,
    /// Number of lost events of the recording: a process made more than its room holds before the
    /// writing thread came. From its first lost event on the recording has nothing of that process.
    pub lost: u64,
    /// Number of processes that did what is not recorded. A replay may differ there unnoticed, so
    /// none begins. The run's error names the first.
    pub outside: u64,
    /// Size of the file in bytes.
    pub bytes: u64,
}

/// The recorder of a system.
pub(crate) struct Recorder {
    stamps: AtomicU64,
    room: usize,
    known: Mutex<Known>,
    stops: AtomicBool,
    writer: Mutex<Option<Writing>>,
    path: PathBuf,
}

/// The writing thread. Without the sender it does not wait any more.
struct Writing {
    wakes: Sender<()>,
    thread: Thread<std::io::Result<u64>>,
}

impl Writing {
    /// Waits for the thread, and detaches it if it does not end.
    fn end(self, is_hurried: &dyn Fn() -> bool) -> std::io::Result<u64> {
        drop(self.wakes);
        let mut until = Instant::now() + END_WITHIN;
        let (mut has_hurried, mut pause) = (false, Duration::from_micros(20));
        while !self.thread.is_finished() {
            if !has_hurried && is_hurried() {
                has_hurried = true;
                until = until.min(Instant::now() + PATIENCE);
            }
            if Instant::now() >= until {
                return Err(std::io::Error::new(
                    std::io::ErrorKind::TimedOut,
                    "it takes nothing more, so the end of the recording is not in it; see whether \
                     its disk or network answers",
                ));
            }
            std::thread::sleep(pause);
            pause = (pause * 2).min(LONGEST_PAUSE);
        }
        // The panic hook has reported a panic.
        self.thread.join().unwrap_or(Ok(0))
    }
}

#[derive(Default)]
struct Known {
    rings: Vec<Listed>,
    /// Number of processes of each name, by the process that spawned them.
    names: HashMap<(u32, Name), u32>,
}

/// A process, with its ring.
#[derive(Clone)]
struct Listed {
    /// The process that spawned it: its number from 1, or 0.
    parent: u32,
    name: Name,
    /// Its index among the processes of its name and parent.
    occurrence: u32,
    ring: Arc<ByteRing>,
}

impl Recorder {
    /// The file of a recording.
    pub(crate) fn file(path: &Path, replaces: bool) -> Result<File, RecordError> {
        if path.extension().is_some_and(|suffix| suffix == "luna") {
            let path = path.display().to_string();
            return Err(RecordError::NameOfTheLogger { path });
        }
        let file = match replaces {
            true => new_file::replace(path),
            false => new_file::create(path),
        };
        file.map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => RecordError::IsThere {
                path: path.display().to_string(),
            },
            _ => file_error(path, &error),
        })
    }

    pub(crate) fn start(
        path: &Path,
        file: File,
        room: usize,
        system: &str,
        note: &str,
        parameters: &[(String, String)],
    ) -> Result<Arc<Self>, RecordError> {
        let failed = |error: std::io::Error| file_error(path, &error);
        let writer = Self::begin(file, system, note, parameters).map_err(failed)?;
        let recorder = Arc::new(Self {
            stamps: AtomicU64::new(1),
            room: room.max(256),
            known: Mutex::default(),
            stops: AtomicBool::new(false),
            writer: Mutex::new(None),
            path: path.to_owned(),
        });
        let shared = Arc::downgrade(&recorder);
        let (wakes, woken) = mpsc::channel();
        // Not `std`'s: the recording thread may have a real-time policy and one core, and this
        // thread is to have neither.
        let thread = spawn(
            Attributes::framework("luna-record", Policy::Other),
            |_| {
                signals::refuse_write_signals_here();
                Ok::<_, Infallible>(())
            },
            move |()| Self::write(&shared, writer, &woken),
        )
        .map_err(|error| failed(std::io::Error::other(error.to_string())))?;
        *lock(&recorder.writer) = Some(Writing { wakes, thread });
        Ok(recorder)
    }

    /// Writes what is known at the start, so that it is there, also if the program crashes.
    fn begin(
        file: File,
        system: &str,
        note: &str,
        parameters: &[(String, String)],
    ) -> std::io::Result<Writer> {
        let mut writer = Writer::begin(file)?;
        writer.block(BlockKind::System, &[system.as_bytes()])?;
        writer.block(BlockKind::Note, &[note.as_bytes()])?;
        for (name, value) in parameters {
            let length = (name.len() as u32).to_le_bytes();
            let parts = [&length[..], name.as_bytes(), value.as_bytes()];
            writer.block(BlockKind::Parameter, &parts)?;
        }
        writer.flush()?;
        Ok(writer)
    }

    /// Makes the recorder of a process of this name. Allocates.
    pub(crate) fn track(self: &Arc<Self>, parent: u32, name: &Name) -> Track {
        let ring = Arc::new(ByteRing::new(self.room));
        let mut known = lock(&self.known);
        let count = known.names.entry((parent, name.clone())).or_default();
        let occurrence = *count;
        *count += 1;
        known.rings.push(Listed {
            parent,
            name: name.clone(),
            occurrence,
            ring: ring.clone(),
        });
        Track::new(self.clone(), ring, known.rings.len() as u32)
    }

    fn write(
        shared: &Weak<Self>,
        mut writer: Writer,
        woken: &Receiver<()>,
    ) -> std::io::Result<u64> {
        let mut announced = 0;
        let mut rings: Vec<Listed> = Vec::new();
        let mut bytes = Vec::with_capacity(MAX_AT_ONCE);
        // If the recorder is gone, the recording has never begun.
        while let Some(recorder) = shared.upgrade() {
            // Before the look: no end is waited for that is entered after the flag has been set.
            let stops = recorder.stops.load(Ordering::Acquire);
            let count = lock(&recorder.known).rings.len();
            // Here, and the new ones alone: a spawning thread waits for the lock.
            rings.reserve(count - rings.len());
            rings.extend_from_slice(&lock(&recorder.known).rings[rings.len()..count]);
            for (number, listed) in rings.iter().enumerate().skip(announced) {
                let number = (number as u32).to_le_bytes();
                let parent = listed.parent.to_le_bytes();
                let occurrence = listed.occurrence.to_le_bytes();
                let name = listed.name.as_bytes();
                writer.block(BlockKind::Process, &[&number, &parent, &occurrence, name])?;
            }
            announced = rings.len();
            for (number, Listed { ring, .. }) in rings.iter().enumerate() {
                loop {
                    bytes.clear();
                    ring.take(&mut bytes, MAX_AT_ONCE);
                    if bytes.is_empty() {
                        break;
                    }
                    writer.block_of(number, BlockKind::Events, &bytes)?;
                    if !stops {
                        break;
                    }
                }
            }
            if stops {
                for (number, Listed { ring, .. }) in rings.iter().enumerate() {
                    if let Some(construct) = ring.outside() {
                        writer.block_of(number, BlockKind::Outside, construct.as_bytes())?;
                    }
                    let lost = ring.counts().1;
                    if lost > 0 || !ring.is_closed() {
                        writer.block_of(number, BlockKind::Lost, &lost.to_le_bytes())?;
                    }
                }
                writer.block(BlockKind::End, &[])?;
                writer.flush()?;
                return Ok(writer.bytes);
            }
            // What a round has found is in the file before the next: after a kill the last events
            // are the ones of interest.
            writer.flush()?;
            drop(recorder);
            let _ = woken.recv_timeout(PAUSE);
        }
        Ok(0)
    }

    /// The first process that did what is not recorded.
    pub(crate) fn outside(&self) -> Option<RecordError> {
        let known = lock(&self.known);
        known.rings.iter().find_map(|listed| {
            Some(RecordError::Outside {
                process: listed.name.to_string(),
                construct: listed.ring.outside()?.to_owned(),
            })
        })
    }

    /// Writes what is left. To be called when no process is left that could still end. Waits for
    /// the file at most [`END_WITHIN`], and for [`PATIENCE`] once it `is_hurried`.
    pub(crate) fn finish(
        &self,
        is_hurried: &dyn Fn() -> bool,
    ) -> Result<RecordReport, RecordError> {
        self.stops.store(true, Ordering::Release);
        let writing = lock(&self.writer).take();
        let bytes = match writing.map(|writing| writing.end(is_hurried)) {
            Some(Ok(bytes)) => bytes,
            Some(Err(error)) => return Err(file_error(&self.path, &error)),
            None => 0,
        };
        let known = lock(&self.known);
        let mut report = RecordReport {
            bytes,
            ..RecordReport::default()
        };
        for Listed { ring, .. } in &known.rings {
            report.outside += u64::from(ring.outside().is_some());
            let (events, lost) = ring.counts();
            report.events += events;
            report.lost += lost;
        }
        Ok(report)
    }
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

pub(super) fn file_error(path: &Path, error: &std::io::Error) -> RecordError {
    RecordError::File {
        path: path.display().to_string(),
        message: error.to_string(),
    }
}
