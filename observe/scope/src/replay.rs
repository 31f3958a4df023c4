//! A recording, played at its pace or another.

use crate::scope::Shared;
use luna_logger::format::{ReadError, Reader, Record};
use std::io::Read;
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
}

/// Plays a recording; returns early when the scope is closed.
pub(crate) fn play(shared: &Shared, input: impl Read, speed: Speed) -> Result<(), ReplayError> {
    let mut reader = Reader::new(input).map_err(ReplayError::Open)?;
    let recording = shared.store().begin();
    let mut pace = Pace {
        speed: speed.0,
        begun: None,
    };
    loop {
        let record = match reader.next() {
            Ok(Some(record)) => record,
            Ok(None) => return Ok(()),
            Err(error) => {
                shared.store().fail(recording, error.to_string());
                return Err(ReplayError::Read(error));
            }
        };
        if let Some(wait) = time(&record).and_then(|time| pace.until(time))
            && shared.closes_within(wait)
        {
            return Ok(());
        }
        shared.store().take(recording, &record);
    }
}

struct Pace {
    speed: f64,
    begun: Option<(Instant, u64)>,
}

impl Pace {
    /// The time until a record of `time` is due; records that are due within a frame of the screen
    /// go together.
    fn until(&mut self, time: u64) -> Option<Duration> {
        let now = Instant::now();
        let (begun, first) = *self.begun.get_or_insert((now, time));
        let after = Duration::from_nanos(time.saturating_sub(first)).as_secs_f64() / self.speed;
        let due = begun.checked_add(Duration::try_from_secs_f64(after).ok()?)?;
        Some(due.saturating_duration_since(now)).filter(|wait| *wait > Duration::from_millis(10))
    }
}

fn time(record: &Record<'_>) -> Option<u64> {
    match record {
        Record::Sample { time, .. } | Record::Message { time, .. } => Some(*time),
        Record::Event(event) => Some(event.time),
        _ => None,
    }
}
