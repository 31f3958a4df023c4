//! Records to whatever takes bytes.

use super::encoder::Encoder;
use super::record::Record;
use std::io::{self, Write};

/// Writes a recording, block by block. Not for the real-time path: a running system is recorded by
/// the [recorder](crate::Recorder).
///
/// ```
/// use luna_logger::format::{Reader, Record, SignalInfo, Type, Values, Writer};
///
/// let mut writer = Writer::new(Vec::new())?;
/// writer.put(&Record::Signal(SignalInfo {
///     number: 0,
///     element_type: Type::F64,
///     elements: 1,
///     name: "arm/angle",
///     unit: "rad",
///     description: "",
/// }))?;
/// let angle = 0.5f64.to_le_bytes();
/// writer.put(&Record::Sample {
///     signal: 0,
///     time: 1_000,
///     values: Values::from_bytes(Type::F64, &angle),
/// })?;
/// let file = writer.finish()?;
///
/// let mut reader = Reader::new(&file[..])?;
/// assert!(matches!(reader.next()?, Some(Record::Signal(info)) if info.unit == "rad"));
/// let Some(Record::Sample { time: 1_000, values, .. }) = reader.next()? else { panic!() };
/// assert_eq!(values.iter().next().unwrap().as_f64(), 0.5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Writer<W> {
    output: W,
    encoder: Encoder,
}

impl<W: Write> Writer<W> {
    /// Writes the head.
    ///
    /// # Errors
    ///
    /// The output's own.
    pub fn new(mut output: W) -> io::Result<Self> {
        output.write_all(&Encoder::head())?;
        Ok(Self {
            output,
            encoder: Encoder::new(),
        })
    }

    /// Adds a record; its block is written when it is full.
    ///
    /// # Errors
    ///
    /// The output's own.
    pub fn put(&mut self, record: &Record<'_>) -> io::Result<()> {
        self.encoder.put(record);
        if self.encoder.is_full() {
            self.end_block()?;
        }
        Ok(())
    }

    /// Writes the current block, if it has records. Afterwards they are in the recording even if
    /// the program is killed.
    ///
    /// # Errors
    ///
    /// The output's own.
    pub fn end_block(&mut self) -> io::Result<()> {
        if !self.encoder.is_empty() {
            self.output.write_all(self.encoder.block())?;
            self.encoder.next();
        }
        Ok(())
    }

    /// Writes the rest, and returns the output.
    ///
    /// # Errors
    ///
    /// The output's own.
    pub fn finish(mut self) -> io::Result<W> {
        self.end_block()?;
        self.output.flush()?;
        Ok(self.output)
    }
}
