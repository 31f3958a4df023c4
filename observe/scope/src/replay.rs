//! A recording, played at its pace or another.

use crate::scope::Shared;
use crate::store::{Recording, time};
use luna_logger::format::{ReadError, Reader};
use std::io::{Read, Seek};
use std::str::FromStr;
use std::time::{Duration, Instant};

/// How fast a recording is played: a factor of recorded time, or at once.
///
/// ```
/// use luna_scope::Speed;
/// assert_eq!("0.5".parse::<Speed>(), Ok(Speed::times(0.5)));
/// assert_eq!("max".parse::<Speed>(), Ok(Speed::AT_ONCE));
/// assert!("-1".parse::<Speed>().is_err());
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Speed(f64);

impl Speed {
    /// As fast as it can be read.
    pub const AT_ONCE: Speed = Speed(f64::INFINITY);

    /// A factor of the recorded speed. Values that are not above 0 count as 1.
    pub fn times(factor: f64) -> Speed {
        Speed(if factor > 0.0 { factor } else { 1.0 })
    }
}

impl FromStr for Speed {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.parse::<f64>() {
            Ok(factor) if factor > 0.0 => Ok(Speed(factor)),
            _ if text == "max" => Ok(Speed::AT_ONCE),
            _ => Err("it must be a number above 0, or max".to_owned()),
        }
    }
}

/// Why a recording could not be played to its end.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// It is no recording, or cannot be read at all; there is nothing to show.
    #[error(transparent)]
    Open(ReadError),
    /// It cannot be read to its end; what came before the error is shown.
    #[error(transparent)]
    Read(ReadError),
    /// It cannot be read again from its beginning.
    #[error("it cannot be read again: {0}")]
    Rewind(std::io::Error),
}

/// The times that a viewer seeks: the file is shown from one on, at once until the other, and at
/// its pace from there; until there alone, if it is played at once.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Range {
    pub(crate) from: u64,
    pub(crate) until: u64,
}

/// How far records may be out of the order of their times, in nanoseconds.
const LATE: u64 = 100_000_000;

/// Plays a recording; returns early when the scope is closed.
pub(crate) fn play(shared: &Shared, input: impl Read, speed: Speed) -> Result<(), ReplayError> {
    let reader = Reader::new(input).map_err(ReplayError::Open)?;
    let recording = shared.store().begin();
    pass(shared, reader, recording, Pace::new(speed, 0)).map(drop)
}

/// Plays a recording that is read twice: at first for its overview.
pub(crate) fn play_file(
    shared: &Shared,
    input: &mut (impl Read + Seek),
    speed: Speed,
) -> Result<(), ReplayError> {
    let mut reader = Reader::new(&mut *input).map_err(ReplayError::Open)?;
    shared.store().survey();
    // What is damaged is reported when it is played.
    while let Ok(Some(record)) = reader.next() {
        shared.store().overview(&record);
        if shared.is_closed() {
            return Ok(());
        }
    }
    play_from(shared, input, speed, Range { from: 0, until: 0 })
}

/// Plays a file from where it is sought to its end.
pub(crate) fn play_from(
    shared: &Shared,
    input: &mut (impl Read + Seek),
    speed: Speed,
    range: Range,
) -> Result<(), ReplayError> {
    let mut next = Some(range);
    while let Some(Range { from, until }) = next {
        input.rewind().map_err(ReplayError::Rewind)?;
        let reader = Reader::new(&mut *input).map_err(ReplayError::Open)?;
        let recording = shared.store().begin_at(from);
        let passed = pass(shared, reader, recording, Pace::new(speed, until));
        shared.store().reveal();
        next = passed?;
    }
    Ok(())
}

/// Plays to the end or where the pace ends, or until a viewer seeks.
fn pass(
    shared: &Shared,
    mut reader: Reader<impl Read>,
    recording: Recording,
    mut pace: Pace,
) -> Result<Option<Range>, ReplayError> {
    let mut is_there = false;
    for count in 0u64.. {
        let record = match reader.next() {
            Ok(Some(record)) => record,
            Ok(None) => return Ok(None),
            Err(error) => {
                shared.store().fail(recording, error.to_string());
                return Err(ReplayError::Read(error));
            }
        };
        if let (Some(end), Some(time)) = (pace.end(), time(&record)) {
            if time > end.saturating_add(LATE) {
                return Ok(None);
            }
            if is_there && time > end {
                continue;
            }
            is_there |= time >= end;
        }
        let wait = time(&record).and_then(|time| pace.until(time));
        if wait.is_some() || count % 1024 == 0 {
            let sought = shared.sought_within(wait.unwrap_or_default());
            if sought.is_some() || shared.is_closed() {
                return Ok(sought);
            }
        }
        shared.store().take(recording, &record);
    }
    Ok(None)
}

struct Pace {
    speed: f64,
    /// What is before is shown at once.
    from: u64,
    begun: Option<(Instant, u64)>,
}

impl Pace {
    fn new(speed: Speed, from: u64) -> Self {
        Self {
            speed: speed.0,
            from,
            begun: None,
        }
    }

    /// Where it ends: without a pace to go on with, viewers stand at what was sought.
    fn end(&self) -> Option<u64> {
        Some(self.from).filter(|from| self.speed.is_infinite() && *from > 0)
    }

    /// The time until a record of `time` is due; records that are due within a frame of the screen
    /// go together.
    fn until(&mut self, time: u64) -> Option<Duration> {
        if time < self.from {
            return None;
        }
        let now = Instant::now();
        let (begun, first) = *self.begun.get_or_insert((now, time));
        let after = Duration::from_nanos(time.saturating_sub(first)).as_secs_f64() / self.speed;
        let due = begun.checked_add(Duration::try_from_secs_f64(after).ok()?)?;
        Some(due.saturating_duration_since(now)).filter(|wait| *wait > Duration::from_millis(10))
    }
}
