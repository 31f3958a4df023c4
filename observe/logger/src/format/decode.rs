//! Records out of a block.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use super::record::{Event, Record, RunsOn, SignalInfo, Subject};
use super::types::{ClockBase, Level, Losing, Type, Values};
use super::{MAX_ELEMENTS, MAX_SIGNALS, kind};

/// The text of a record's error.
type Wrong = &'static str;

/// Pieces of a record's body, first to last.
#[derive(Clone, Copy)]
pub(super) struct Body<'a> {
    rest: &'a [u8],
}

impl<'a> Body<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    pub(super) fn rest(self) -> &'a [u8] {
        self.rest
    }

    fn take(&mut self, length: usize) -> Result<&'a [u8], Wrong> {
        let (taken, rest) = self
            .rest
            .split_at_checked(length)
            .ok_or("it ends too early")?;
        self.rest = rest;
        Ok(taken)
    }

    pub(super) fn byte(&mut self) -> Result<u8, Wrong> {
        Ok(self.take(1)?[0])
    }

    pub(super) fn number(&mut self) -> Result<u64, Wrong> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            let bits = u64::from(byte & 0x7F);
            if bits << shift >> shift != bits {
                break;
            }
            value |= bits << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err("a number has more than 64 bits")
    }

    fn small(&mut self) -> Result<u32, Wrong> {
        u32::try_from(self.number()?).map_err(|_| "a number has more than 32 bits")
    }

    fn time(&mut self, last: &mut u64) -> Result<u64, Wrong> {
        let number = self.number()?;
        let distance = (number >> 1) as i64 ^ ((number & 1) as i64).wrapping_neg();
        *last = last.wrapping_add(distance as u64);
        Ok(*last)
    }

    fn text(&mut self) -> Result<&'a str, Wrong> {
        let length = usize::try_from(self.number()?).map_err(|_| "a text is too long")?;
        std::str::from_utf8(self.take(length)?).map_err(|_| "a text is not UTF-8")
    }
}

/// The declared types of the signals; at most as many as a recording may have.
#[derive(Debug, Default)]
pub(super) struct Types(Vec<Declared>);

#[derive(Debug, Clone, Copy, PartialEq)]
enum Declared {
    Not,
    /// Of a type of a later version.
    Unknown,
    As(Type, u8),
}

impl Types {
    fn get(&self, signal: u32) -> Declared {
        self.0
            .get(signal as usize)
            .copied()
            .unwrap_or(Declared::Not)
    }

    fn set(&mut self, signal: u32, declared: Declared) -> Result<(), Wrong> {
        let index = signal as usize;
        if index >= MAX_SIGNALS {
            return Err("the number of a signal is too high");
        }
        if self.0.len() <= index {
            self.0.resize(index.saturating_add(1), Declared::Not);
        }
        self.0[index] = declared;
        Ok(())
    }
}

/// Whether this version knows the record's kind; others are skipped. A declaration is noted.
pub(super) fn is_known(of: u8, body: Body<'_>, types: &mut Types) -> Result<bool, Wrong> {
    let mut body = body;
    Ok(match of {
        kind::SIGNAL => {
            let signal = body.small()?;
            let (element_type, elements) = (body.byte()?, body.byte()?);
            if elements == 0 || usize::from(elements) > MAX_ELEMENTS {
                return Err("a signal has no elements, or too many");
            }
            let declared = Type::from_byte(element_type)
                .map_or(Declared::Unknown, |known| Declared::As(known, elements));
            types.set(signal, declared)?;
            declared != Declared::Unknown
        }
        // A sample before its declaration counts as known, so that its time is checked.
        kind::SAMPLE => types.get(body.small()?) != Declared::Unknown,
        kind::NAME => Subject::from_byte(body.byte()?).is_some(),
        kind::LOSSES => (1..=4).contains(&body.byte()?),
        kind::SESSION | kind::THREAD | kind::MESSAGE | kind::EVENT | kind::EPOCH | kind::END => {
            true
        }
        _ => false,
    })
}

/// The record of kind `of`, which is known.
pub(super) fn record<'a>(
    of: u8,
    mut body: Body<'a>,
    last: &mut u64,
    types: &Types,
) -> Result<Record<'a>, Wrong> {
    Ok(match of {
        kind::SESSION => Record::Session {
            clock: ClockBase::from_byte(body.byte()?).ok_or("it has a clock of no known kind")?,
            system: body.text()?,
            written_by: body.text()?,
        },
        kind::THREAD => Record::Thread {
            number: body.small()?,
            name: body.text()?,
        },
        kind::SIGNAL => Record::Signal(SignalInfo {
            number: body.small()?,
            element_type: Type::from_byte(body.byte()?).ok_or("a signal has no known type")?,
            elements: body.byte()?,
            name: body.text()?,
            unit: body.text()?,
            description: body.text()?,
        }),
        kind::SAMPLE => {
            let signal = body.small()?;
            let Declared::As(element_type, elements) = types.get(signal) else {
                return Err("a sample is of a signal that was not declared");
            };
            Record::Sample {
                signal,
                time: body.time(last)?,
                values: Values::new(
                    element_type,
                    body.take(element_type.size().saturating_mul(elements.into()))?,
                ),
            }
        }
        kind::MESSAGE => {
            let (thread, time) = (body.small()?, body.time(last)?);
            let level = Level::from_byte(body.byte()?).ok_or("a message has no known level")?;
            Record::Message {
                thread,
                time,
                level,
                truncated: body.byte()? & 1 != 0,
                process: body.small()?,
                target: body.text()?,
                text: body.text()?,
            }
        }
        kind::EVENT => Record::Event(Event {
            thread: body.small()?,
            time: body.time(last)?,
            code: u16::try_from(body.number()?).map_err(|_| "an event's code is too high")?,
            subject: body.small()?,
            arguments: [body.number()?, body.number()?],
        }),
        kind::NAME => {
            let subject = Subject::from_byte(body.byte()?).ok_or("a name is of nothing known")?;
            Record::Name {
                subject,
                number: body.small()?,
                parent: body.small()?,
                name: body.text()?,
                // The first version of the format did not have this field.
                runs_on: match subject != Subject::Process || body.rest.is_empty() {
                    true => None,
                    false => Some(RunsOn {
                        executor: body.small()?,
                        level: u8::try_from(body.small()?).map_err(|_| "a level is too high")?,
                    }),
                },
            }
        }
        kind::LOSSES => {
            let (what, number) = (body.byte()?, body.small()?);
            Record::Losses {
                of: match what {
                    1 => Losing::Signal(number),
                    2 => Losing::Messages(number),
                    4 => Losing::Blocks,
                    _ => Losing::Events(number),
                },
                lost: body.number()?,
            }
        }
        kind::EPOCH => {
            let time = body.time(last)?;
            let bytes = body.take(8)?.try_into().unwrap_or_default();
            Record::Epoch {
                time,
                unix: i64::from_le_bytes(bytes),
            }
        }
        kind::END => Record::End {
            time: body.time(last)?,
        },
        _ => return Err("it is of no known kind"),
    })
}
