//! The far ends of the channels.

use crate::value::Field;
use crate::{Fault, Found, LinkError, Place, Sample};
use luna::devices::SetPoints;
use luna::{Instant, Receiver, Sender};
use std::time::Duration;

/// An input: a value that goes from the bus to a channel.
pub(crate) trait Input: Send {
    fn place(&self) -> Place;
    /// Takes the value from the subdevice's inputs.
    fn read(&mut self, from: &[u8]);
    /// Sends the last value. Returns whether somebody reads it.
    fn send(&self, stale: u32, exchanged: [Instant; 2]) -> bool;
    fn poison(&self);
}

/// An output: a value that goes from a channel to the bus.
pub(crate) trait Output: Send {
    fn place(&self) -> Place;
    fn set_greatest_age(&mut self, cycles: Option<u32>);
    /// Takes the newest set-point. Returns whether its writers have gone.
    fn take(&mut self, is_driving: bool) -> bool;
    fn overdue(&self) -> Option<u32>;
    /// Writes the newest set-point to the subdevice's outputs, or the safe value if there is none.
    fn write(&self, to: &mut [u8]);
    fn write_safe(&self, to: &mut [u8]);
    fn poison(&self);
}

struct InputEnd<T> {
    place: Place,
    last: Option<T>,
    channel: Sender<Sample<T>>,
}

impl<T: Field> Input for InputEnd<T> {
    fn place(&self) -> Place {
        self.place
    }

    fn read(&mut self, from: &[u8]) {
        self.last = Some(T::read(from, self.place.bit));
    }

    fn send(&self, stale: u32, [sent, received]: [Instant; 2]) -> bool {
        let Some(value) = self.last else {
            return true;
        };
        let outcome = self.channel.try_send(Sample {
            value,
            stale,
            sent,
            received,
        });
        // A full channel, or the end of some readers, does not concern the bus.
        !outcome.is_err_and(|error| error.is_closed() || error.is_poisoned())
    }

    fn poison(&self) {
        self.channel.poison();
    }
}

struct OutputEnd<T> {
    place: Place,
    safe: T,
    points: SetPoints<T>,
}

impl<T: Field> Output for OutputEnd<T> {
    fn place(&self) -> Place {
        self.place
    }

    fn set_greatest_age(&mut self, cycles: Option<u32>) {
        self.points.greatest_age(cycles);
    }

    fn take(&mut self, is_driving: bool) -> bool {
        self.points.take(is_driving);
        self.points.has_ended()
    }

    fn overdue(&self) -> Option<u32> {
        self.points.overdue()
    }

    fn write(&self, to: &mut [u8]) {
        self.points
            .newest()
            .unwrap_or(self.safe)
            .write(to, self.place.bit);
    }

    fn write_safe(&self, to: &mut [u8]) {
        self.safe.write(to, self.place.bit);
    }

    fn poison(&self) {
        self.points.poison();
    }
}

fn place<T: Field>(position: usize, is_output: bool, bit: usize) -> Place {
    Place {
        position,
        is_output,
        bit,
        bits: T::BITS,
    }
}

/// All values that are connected.
#[derive(Default)]
pub(crate) struct Ends {
    pub(crate) inputs: Vec<Box<dyn Input>>,
    pub(crate) outputs: Vec<Box<dyn Output>>,
}

impl Ends {
    pub(crate) fn add_input<T: Field>(
        &mut self,
        position: usize,
        bit: usize,
        channel: Sender<Sample<T>>,
    ) {
        self.inputs.push(Box::new(InputEnd {
            place: place::<T>(position, false, bit),
            last: None,
            channel,
        }));
    }

    pub(crate) fn add_output<T: Field>(
        &mut self,
        position: usize,
        bit: usize,
        safe: T,
        channel: Receiver<T>,
    ) {
        self.outputs.push(Box::new(OutputEnd {
            place: place::<T>(position, true, bit),
            safe,
            points: SetPoints::new(channel),
        }));
    }

    /// # Errors
    ///
    /// A value lies where the bus has none, or two outputs have the same bits.
    pub(crate) fn check(&self, found: &[Found]) -> Result<(), LinkError> {
        let inputs = self.inputs.iter().map(|end| end.place());
        let outputs = self.outputs.iter().map(|end| end.place());
        for place in inputs.chain(outputs.clone()) {
            let Some(subdevice) = found.get(place.position) else {
                return Err(LinkError::NoSubDevice {
                    position: place.position,
                    count: found.len(),
                });
            };
            let bytes = match place.is_output {
                true => subdevice.outputs,
                false => subdevice.inputs,
            };
            if place.bit.saturating_add(place.bits) > 8 * bytes {
                return Err(LinkError::Outside {
                    place,
                    bytes,
                    found: subdevice.clone(),
                });
            }
        }
        for (number, place) in outputs.clone().enumerate() {
            let meets = |other: Place| {
                let is_same = other.position == place.position;
                is_same && other.bit < place.bit + place.bits && place.bit < other.bit + other.bits
            };
            if outputs.clone().take(number).any(meets) {
                return Err(LinkError::Twice { place });
            }
        }
        Ok(())
    }

    /// Sets how old set-points may be, in whole periods.
    pub(super) fn set_greatest_ages(&mut self, ages: &[Option<Duration>], period: Duration) {
        let period = period.as_nanos().max(1);
        let cycles = |age: Duration| u32::try_from(age.as_nanos() / period).unwrap_or(u32::MAX);
        for (end, age) in self.outputs.iter_mut().zip(ages) {
            end.set_greatest_age(age.map(cycles));
        }
    }

    /// The safe values of all outputs of a bus, subdevice after subdevice.
    pub(crate) fn safe_outputs(&self, found: &[Found]) -> Vec<u8> {
        let mut all = Vec::new();
        for (position, subdevice) in found.iter().enumerate() {
            let begin = all.len();
            all.resize(begin + subdevice.outputs, 0);
            for end in &self.outputs {
                if end.place().position == position {
                    end.write_safe(&mut all[begin..]);
                }
            }
        }
        all
    }

    /// Takes the newest set-points. Returns whether all writers have gone.
    ///
    /// # Errors
    ///
    /// A writer exists but sends nothing any more while the link `is_driving`.
    pub(super) fn take(&mut self, is_driving: bool) -> Result<bool, Fault> {
        let mut have_ended = !self.outputs.is_empty();
        for end in &mut self.outputs {
            have_ended &= end.take(is_driving);
        }
        let overdue = self.outputs.iter().find_map(|end| {
            let cycles = end.overdue()?;
            Some(Fault::Overdue {
                place: end.place(),
                cycles,
            })
        });
        match overdue {
            Some(fault) if !have_ended => Err(fault),
            _ => Ok(have_ended),
        }
    }

    /// Sends the last value of each input. Returns whether anybody reads one.
    pub(super) fn send(&self, stale: u32, exchanged: [Instant; 2]) -> bool {
        let mut is_read = false;
        for end in &self.inputs {
            is_read |= end.send(stale, exchanged);
        }
        is_read
    }

    /// No process receives an old value after this.
    pub(super) fn poison(&self) {
        self.inputs.iter().for_each(|end| end.poison());
        self.outputs.iter().for_each(|end| end.poison());
    }
}
