//! The recordings of several programs as one recording.

use super::{Merge, Place, day, shift};
use crate::store::time;
use luna_logger::format::{ReadError, Reader, Record, Writer};
use std::io::{self, Read, Seek, Write};
use std::time::Duration;

/// Why recordings could not be merged as a whole.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MergeError {
    /// The recording of this number, from 0, is none.
    #[error("{1}")]
    Open(usize, #[source] ReadError),
    /// The recording of this number, from 0, cannot be read to its end: what came before is in the
    /// output, and so are the others.
    #[error("{1}")]
    Read(usize, #[source] ReadError),
    /// The recording of this number, from 0, cannot be read again from its beginning.
    #[error("it cannot be read again: {1}")]
    Rewind(usize, #[source] io::Error),
    /// The output cannot be written.
    #[error("the merged recording cannot be written: {0}")]
    Write(#[source] io::Error),
    /// There are more than 64 recordings.
    #[error("at most {} programs can be shown together", super::MAX_PROGRAMS)]
    TooMany,
}

impl MergeError {
    /// The number of the recording that it is about, from 0.
    pub fn recording(&self) -> Option<usize> {
        match self {
            Self::Open(number, _) | Self::Read(number, _) | Self::Rewind(number, _) => {
                Some(*number)
            }
            Self::Write(_) | Self::TooMany => None,
        }
    }
}

/// A recording that is being read.
struct Source<R> {
    number: usize,
    reader: Reader<R>,
    place: Option<Place>,
    /// The last time that was read; at the beginning the first one of all.
    last: u64,
    day: Option<i64>,
}

/// Writes the recordings of several programs as one recording, as the scope shows several programs:
/// on one time axis, with the name of the system before each name that does not begin with it.
///
/// Programs of one computer have one clock. A recording whose clock differs by more than a second
/// from the first one's is placed by its times of the day. A recording that begins when another of
/// the same name has ended continues it.
///
/// ```
/// use luna_logger::format::{ClockBase, Reader, Record, Writer};
/// use std::io::Cursor;
///
/// let recording = |system, time| {
///     let mut file = Writer::new(Vec::new())?;
///     let (clock, written_by) = (ClockBase::Monotonic, "an example");
///     file.put(&Record::Session { system, clock, written_by })?;
///     file.put(&Record::End { time })?;
///     file.finish().map(Cursor::new)
/// };
/// let mut both = [recording("left", 7)?, recording("right", 9)?];
/// let merged = luna_scope::merge(&mut both, Vec::new())?;
/// let mut reader = Reader::new(&merged[..])?;
/// let mut last = None;
/// while let Some(record) = reader.next()? {
///     last = Some(format!("{record:?}"));
/// }
/// assert_eq!(last.as_deref(), Some("End { time: 9 }"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
///
/// [`MergeError`]. After [`Read`](MergeError::Read) the output has all that could be read; `to` is
/// then complete, but is not returned: pass a reference.
pub fn merge<R: Read + Seek, W: Write>(recordings: &mut [R], to: W) -> Result<W, MergeError> {
    let mut writer = Writer::new(to).map_err(MergeError::Write)?;
    let mut written = Ok(());
    let mut put = |record: &Record<'_>| {
        if written.is_ok() {
            written = writer.put(record);
        }
    };
    let mut sources = Vec::new();
    for (number, recording) in recordings.iter_mut().enumerate() {
        sources.push(open(number, recording)?);
    }
    let mut merge = Merge {
        day: sources.iter().find_map(|source| source.day),
        ..Merge::default()
    };
    for source in &mut sources {
        if let (Some(day), Some(common)) = (source.day, merge.day) {
            source.last = source.last.saturating_add_signed(shift(day, common));
        }
    }
    let mut damaged = None;
    // The one that is the furthest behind goes on.
    while let Some(at) = (0..sources.len()).min_by_key(|at| sources[*at].last) {
        let source = &mut sources[at];
        let ended = match source.reader.next() {
            Ok(Some(record)) => {
                if let (None, Record::Session { system, clock, .. }) = (source.place, &record) {
                    let place = merge.begin(system, *clock, Duration::MAX, &mut put);
                    source.place = Some(place.ok_or(MergeError::TooMany)?);
                }
                if let Some(place) = source.place {
                    merge.take(place, &record, &mut put);
                    source.last = merge.programs[place.number].last.max(source.last);
                }
                false
            }
            Ok(None) => true,
            Err(error) => {
                damaged = damaged.or(Some(MergeError::Read(source.number, error)));
                true
            }
        };
        if ended && let Some(place) = sources.swap_remove(at).place {
            merge.end(place);
        }
        let until = sources.iter().map(|source| source.last).min();
        merge.release(until.unwrap_or(u64::MAX), &mut put);
    }
    merge.finish(&mut put);
    written.map_err(MergeError::Write)?;
    let to = writer.finish().map_err(MergeError::Write)?;
    damaged.map_or(Ok(to), Err)
}

/// Reads to the first time, and begins again.
fn open<R: Read + Seek>(number: usize, recording: &mut R) -> Result<Source<&mut R>, MergeError> {
    let mut reader = begin(number, &mut *recording)?;
    let (mut first, mut its_day) = (None, None);
    // Damage is reported when it is read again.
    while let (None, Ok(Some(record))) = (first, reader.next()) {
        first = time(&record);
        if let Record::Epoch { time, unix } = record {
            its_day = Some(day(time, unix));
        }
    }
    Ok(Source {
        number,
        reader: begin(number, recording)?,
        place: None,
        last: first.unwrap_or(0),
        day: its_day,
    })
}

fn begin<R: Read + Seek>(number: usize, recording: &mut R) -> Result<Reader<&mut R>, MergeError> {
    recording
        .rewind()
        .map_err(|error| MergeError::Rewind(number, error))?;
    Reader::new(recording).map_err(|error| MergeError::Open(number, error))
}
