//! The card's last values, for the readers.

use super::{Parts, Sensors};
use crate::{Fault, Reading, Sample};
use hostmot2::encoder::{Stamps, Tracker};
use hostmot2::{Answer, Layout};
use luna::{Instant, Sender};

#[derive(Debug)]
pub(super) struct Readings {
    stamps: Stamps,
    trackers: Vec<Tracker>,
    /// In the order of the sensors.
    encoders: Vec<Option<Reading>>,
    inputs: Vec<Option<bool>>,
    port_width: u32,
    /// Between which moments it was measured, once something was.
    measured: Option<[Instant; 2]>,
    stale: u32,
}

impl Readings {
    pub(super) fn new(parts: &Parts, layout: &Layout, port_width: u32) -> Self {
        let tracker = |fastest| match parts.checks_quadrature {
            true => Tracker::new(fastest),
            false => Tracker::new(fastest).ignoring_quadrature_errors(),
        };
        let encoders = &parts.sensors.encoders;
        Self {
            stamps: Stamps::new(layout.stamps_per_second()),
            trackers: encoders.iter().map(|end| tracker(end.fastest)).collect(),
            encoders: vec![None; encoders.len()],
            inputs: vec![None; parts.sensors.inputs.len()],
            port_width,
            measured: None,
            stale: 0,
        }
    }

    /// Takes all values of an answer, before any is sent. The times are of the first start packet,
    /// of the request, and of the answer.
    pub(super) fn update(
        &mut self,
        answer: &Answer<'_>,
        sensors: &Sensors,
        [begun, asked, answered]: [Instant; 3],
    ) -> Result<(), Fault> {
        // The longest possible time between this reading and the one before, or the start.
        let elapsed = self
            .measured
            .map_or(answered - begun, |[last, _]| answered - last);
        self.stamps.update(answer.stamp, elapsed);
        for (index, end) in sensors.encoders.iter().enumerate() {
            let raw = answer.encoder(end.number).ok_or(Fault::Foreign)?;
            let read = self.trackers[index].update(raw, &self.stamps, elapsed);
            let read = read.map_err(|why| Fault::Encoder {
                encoder: end.number,
                why,
            })?;
            self.encoders[index] = Some(read);
        }
        for (index, end) in sensors.inputs.iter().enumerate() {
            self.inputs[index] = Some(answer.pin(end.pin, self.port_width).ok_or(Fault::Foreign)?);
        }
        self.measured = Some([asked, answered]);
        self.stale = 0;
        Ok(())
    }

    /// Sends all values; nothing before the first answer. Returns whether there are readers.
    pub(super) fn send_all(&self, sensors: &Sensors) -> bool {
        let Some(measured) = self.measured else {
            return true;
        };
        let mut is_read = false;
        for (end, value) in sensors.encoders.iter().zip(&self.encoders) {
            is_read |= self.send(&end.channel, *value, measured);
        }
        for (end, value) in sensors.inputs.iter().zip(&self.inputs) {
            is_read |= self.send(&end.channel, *value, measured);
        }
        is_read
    }

    fn send<T: Copy>(
        &self,
        channel: &Sender<Sample<T>>,
        value: Option<T>,
        [asked, answered]: [Instant; 2],
    ) -> bool {
        let Some(value) = value else {
            return true;
        };
        let sent = channel.try_send(Sample {
            value,
            stale: self.stale,
            asked,
            answered,
        });
        // A full channel, or the end of some readers, does not concern the card.
        !sent.is_err_and(|error| error.is_closed() || error.is_poisoned())
    }

    /// Sends the last values again, a cycle older.
    pub(super) fn send_stale(&mut self, sensors: &Sensors) -> bool {
        self.stale = self.stale.saturating_add(1);
        self.send_all(sensors)
    }
}
