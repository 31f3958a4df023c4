//! A joystick's recording: CSV with the columns `time` (s), `pan` and `tilt` (−1 to 1), played back
//! as often as needed.

mod playback;

pub use playback::Playback;

use std::path::Path;

/// The recording inside the program, so that the demo runs from any folder. `data/README.md`
/// describes its origin.
const BUILT_IN: &str = include_str!("../data/joystick.csv");

const COLUMNS: [&str; 3] = ["time", "pan", "tilt"];

/// How far the joystick is deflected, −1 to 1 on either axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Deflection {
    /// Of the lower axis.
    pub pan: f64,
    /// Of the upper axis.
    pub tilt: f64,
}

/// The ends of the process called `joystick`, for one that [stands in](luna::System::stand_in) for
/// it: it sends the deflections of pan and tilt, −1 to 1.
#[derive(Debug)]
pub struct Sticks(
    /// Of pan, and of tilt.
    pub [luna::Sender<f64>; 2],
);

#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    time: f64,
    deflection: Deflection,
}

/// What was recorded, at least one sample, in order of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    samples: Vec<Sample>,
}

impl Recording {
    /// The one inside the program.
    pub fn built_in() -> Self {
        Self::parse(BUILT_IN.as_bytes()).expect("it is tested")
    }

    /// Reads the file at `path`.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = std::fs::read(path).map_err(Error::File)?;
        Self::parse(&text)
    }

    /// Parses a recording. Columns are found by their names; other columns and empty lines are
    /// ignored.
    pub fn parse(text: &[u8]) -> Result<Self, Error> {
        let text = String::from_utf8_lossy(text);
        let lines = text.trim_start_matches('\u{feff}').lines().zip(1..);
        let mut lines = lines.filter(|(line, _)| !line.trim().is_empty());
        let (header, number) = lines.next().ok_or(Error::NoSamples)?;
        let mut places = [0; 3];
        for (place, column) in places.iter_mut().zip(COLUMNS) {
            let found = fields(header).position(|name| name == column);
            *place = found.ok_or(Error::at(number, Fault::MissingColumn(column)))?;
        }

        let mut samples: Vec<Sample> = Vec::new();
        for (line, number) in lines {
            let value = |index: usize| {
                let column = COLUMNS[index];
                let field = fields(line).nth(places[index]);
                let field = field.ok_or(Fault::MissingColumn(column))?;
                match field.parse::<f64>() {
                    Err(_) => Err(Fault::NotANumber {
                        column,
                        field: field.into(),
                    }),
                    Ok(value) if !value.is_finite() => Err(Fault::NotFinite { column }),
                    Ok(value) if index > 0 && value.abs() > 1.0 => {
                        Err(Fault::OutOfRange { column, value })
                    }
                    Ok(value) => Ok(value),
                }
            };
            let sample = || -> Result<Sample, Fault> {
                let sample = Sample {
                    time: value(0)?,
                    deflection: Deflection {
                        pan: value(1)?,
                        tilt: value(2)?,
                    },
                };
                match samples.last() {
                    Some(before) if sample.time <= before.time => Err(Fault::NotIncreasing {
                        time: sample.time,
                        before: before.time,
                    }),
                    _ => Ok(sample),
                }
            };
            samples.push(sample().map_err(|fault| Error::at(number, fault))?);
        }
        match samples.is_empty() {
            true => Err(Error::NoSamples),
            false => Ok(Self { samples }),
        }
    }

    /// Seconds from the first sample to the last.
    pub fn length(&self) -> f64 {
        self.samples[self.samples.len() - 1].time - self.samples[0].time
    }

    /// Plays it from its start.
    pub fn play(self) -> Playback {
        Playback::new(self)
    }
}

/// Why a recording cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file itself.
    #[error("{0}")]
    File(std::io::Error),
    /// Nothing but, at most, a header.
    #[error(
        "it holds no samples; it needs the columns `time`, `pan`, `tilt` and a line for each sample"
    )]
    NoSamples,
    /// A line is malformed.
    #[error("line {line}: {fault}")]
    Line {
        /// Counted from 1, as editors do.
        line: u64,
        /// The fault.
        fault: Fault,
    },
}

impl Error {
    fn at(line: u64, fault: Fault) -> Self {
        Self::Line { line, fault }
    }
}

/// A fault of a line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Fault {
    /// The header, or this line, ends before it.
    #[error("column `{0}` is missing")]
    MissingColumn(&'static str),
    /// Text where a number belongs.
    #[error("{field:?} in column `{column}` is not a number")]
    NotANumber {
        /// Where.
        column: &'static str,
        /// The field's text.
        field: String,
    },
    /// A NaN or an infinity.
    #[error("column `{column}` is not finite")]
    NotFinite {
        /// Where.
        column: &'static str,
    },
    /// A deflection beyond 1.
    #[error("{value} in column `{column}` is not within -1 and 1")]
    OutOfRange {
        /// Where.
        column: &'static str,
        /// The value.
        value: f64,
    },
    /// Not later than the line before.
    #[error("time {time} is not after the {before} of the line before")]
    NotIncreasing {
        /// Of this line.
        time: f64,
        /// Of the line before.
        before: f64,
    },
}

/// What stands between the commas of a line, without spaces and quotation marks around it.
fn fields(line: &str) -> impl Iterator<Item = &str> {
    let fields = line.split(',');
    fields.map(|field| field.trim().trim_matches('"'))
}

#[cfg(test)]
mod tests;
