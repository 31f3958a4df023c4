//! The packets of a control cycle, and the contents of the answer.

use crate::lbp16::{Packet, PacketError, Reader, Space, Width};
use crate::registers::{encoder, scratch, watchdog};
use crate::{Layout, SequenceWindow};

/// The contents of a cycle's write packet. Made by [`Layout::outputs_at_rest`].
#[derive(Debug, Clone, PartialEq)]
pub struct Outputs {
    duties: Vec<f64>,
    enabled: u32,
    ports: Vec<u32>,
}

impl Outputs {
    /// Sets the duty of a PWM generator, −1 to 1; values outside saturate, and NaN counts as 0.
    /// Ignored without such a generator.
    pub fn set_duty(&mut self, pwm: usize, duty: f64) {
        if let Some(place) = self.duties.get_mut(pwm) {
            *place = duty;
        }
    }

    /// Switches a PWM generator's enable output, if there is such a generator. The duty of a
    /// disabled generator is 0.
    pub fn set_enabled(&mut self, pwm: usize, enabled: bool) {
        if pwm < self.duties.len().min(32) {
            let bit = 1 << pwm;
            self.enabled = match enabled {
                true => self.enabled | bit,
                false => self.enabled & !bit,
            };
        }
    }

    fn is_enabled(&self, pwm: usize) -> bool {
        pwm < 32 && self.enabled >> pwm & 1 != 0
    }
}

/// The registers of an encoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RawEncoder {
    /// The count, which wraps.
    pub count: u16,
    /// The time stamp of its last change.
    pub stamp: u16,
    /// The count at the index, once it was latched.
    pub index: Option<u16>,
    /// Whether A and B have changed at once.
    pub quadrature_error: bool,
}

/// The contents of the answer to a read packet.
#[derive(Debug, Clone, Copy)]
pub struct Answer<'a> {
    layout: &'a Layout,
    /// The number of the read packet that it answers.
    pub sequence: u32,
    /// The number of the write packet that the card has seen last.
    pub echo: u32,
    /// The number of the last start packet that the card has received. A restarted card has lost
    /// it, also if it receives write packets.
    pub session: u32,
    /// Whether the watchdog has expired: the card's outputs are off.
    pub has_bitten: bool,
    /// The time stamps' counter, if there are encoders.
    pub stamp: u16,
    encoders: &'a [u8],
    ports: &'a [u8],
}

/// Why bytes are no answer of this layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("an answer has {expected} bytes, this one {length}")]
pub struct AnswerError {
    /// How many bytes there are.
    pub length: usize,
    /// How many an answer has.
    pub expected: usize,
}

/// The meaning of the write packet's number in an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EchoState {
    /// It was the last one sent.
    UpToDate,
    /// It was an earlier one: a write packet was lost or overtaken, and its outputs are not in
    /// effect.
    Behind,
    /// It is a foreign one: the card was restarted, or has another master.
    Foreign,
}

impl Layout {
    /// Harmless outputs: duties of 0, nothing enabled, pins at their neutral levels. Allocates.
    pub fn outputs_at_rest(&self) -> Outputs {
        Outputs {
            duties: vec![0.0; self.pwms.len()],
            enabled: 0,
            ports: self.pins.ports.iter().map(|port| port.neutral).collect(),
        }
    }

    /// Sets the level of the output that is `number`th in the selection, if there is one.
    pub fn set_output(&self, outputs: &mut Outputs, number: usize, level: bool) {
        if let Some(place) = self.pins.outputs.get(number)
            && let Some(port) = outputs.ports.get_mut(place.port)
        {
            *port = match level {
                true => *port | place.mask,
                false => *port & !place.mask,
            };
        }
    }

    /// Makes the read packet of number `sequence`. O(encoders + ports), allocates nothing.
    ///
    /// # Errors
    ///
    /// [`PacketError`]: it would be too long. This does not depend on the number.
    pub fn read_request(&self, sequence: u32, packet: &mut Packet) -> Result<(), PacketError> {
        packet.clear();
        let (timers, wide) = (Space::Timers, Width::Bits16);
        packet.write(
            timers,
            wide,
            scratch::READ_SEQUENCE,
            &sequence.to_le_bytes(),
        )?;
        // All three numbers, which are adjacent.
        packet.read(timers, wide, scratch::READ_SEQUENCE, 6)?;
        let mut read = |address| {
            packet
                .read(Space::HostMot2, Width::Bits32, address, 1)
                .map(drop)
        };
        read(self.watchdog.status)?;
        for at in &self.encoders {
            read(at.value)?;
            read(at.control)?;
        }
        // After the counters: so none of their stamps is later.
        if let Some(stamp) = self.stamp {
            read(stamp)?;
        }
        for at in &self.pins.ports {
            read(at.data)?;
            read(at.direction)?;
        }
        Ok(())
    }

    /// How many bytes an answer to the read packet has.
    pub fn answer_len(&self) -> usize {
        16 + 8 * self.encoders.len()
            + 4 * usize::from(self.stamp.is_some())
            + 8 * self.pins.ports.len()
    }

    /// Reads an answer. O(1).
    ///
    /// # Errors
    ///
    /// It is not as long as one.
    pub fn decode<'a>(&'a self, bytes: &'a [u8]) -> Result<Answer<'a>, AnswerError> {
        let error = AnswerError {
            length: bytes.len(),
            expected: self.answer_len(),
        };
        if bytes.len() != error.expected {
            return Err(error);
        }
        let mut reader = Reader::new(bytes);
        let mut next = || reader.u32().ok_or(error);
        let (sequence, echo, session, status) = (next()?, next()?, next()?, next()?);
        let of_encoders = reader.rest().split_at_checked(8 * self.encoders.len());
        let (encoders, rest) = of_encoders.ok_or(error)?;
        let mut reader = Reader::new(rest);
        let stamp = match self.stamp {
            Some(_) => reader.u32().ok_or(error)? as u16,
            None => 0,
        };
        Ok(Answer {
            layout: self,
            sequence,
            echo,
            session,
            has_bitten: status & 1 != 0,
            stamp,
            encoders,
            ports: reader.rest(),
        })
    }

    /// Makes the write packet of number `sequence`: it restarts the watchdog, sets all outputs, and
    /// leaves its number. O(PWM generators + ports), allocates nothing.
    ///
    /// # Errors
    ///
    /// [`PacketError`]: it would be too long. This does not depend on the number.
    pub fn write_request(
        &self,
        sequence: u32,
        outputs: &Outputs,
        packet: &mut Packet,
    ) -> Result<(), PacketError> {
        packet.clear();
        packet.write_register(self.watchdog.cookie, watchdog::RESTART)?;
        self.write_outputs(outputs, packet)?;
        let number = sequence.to_le_bytes();
        packet.write(
            Space::Timers,
            Width::Bits16,
            scratch::WRITE_SEQUENCE,
            &number,
        )?;
        Ok(())
    }

    /// Makes the packet that ends the link: all outputs neutral, then a watchdog time of 0. The
    /// watchdog expires at once, and the card's pins become inputs, also if packets of a cycle are
    /// still in transit: none of those enables the outputs again. It may be sent several times.
    ///
    /// # Errors
    ///
    /// [`PacketError`]: it would be too long.
    pub fn neutral_request(&self, packet: &mut Packet) -> Result<(), PacketError> {
        packet.clear();
        self.write_outputs(&self.outputs_at_rest(), packet)?;
        packet.write_register(self.watchdog.time, 0)?;
        Ok(())
    }

    fn write_outputs(&self, outputs: &Outputs, packet: &mut Packet) -> Result<(), PacketError> {
        for (number, (at, duty)) in self.pwms.iter().zip(&outputs.duties).enumerate() {
            let duty = if outputs.is_enabled(number) {
                *duty
            } else {
                0.0
            };
            packet.write_register(at.value, crate::pwm::value(duty))?;
        }
        if let Some(enable) = self.pwm_enable {
            packet.write_register(enable, outputs.enabled)?;
        }
        for (at, levels) in self.pins.ports.iter().zip(&outputs.ports) {
            packet.write_register(at.data, *levels)?;
        }
        Ok(())
    }
}

impl Answer<'_> {
    /// The registers of an encoder; none if it is not read.
    pub fn encoder(&self, number: usize) -> Option<RawEncoder> {
        let at = number.checked_mul(8)?;
        let mut reader = Reader::new(self.encoders.get(at..)?);
        let (count, control) = (reader.u32()?, reader.u32()?);
        let is_latched =
            self.layout.latches_index(number) && control as u16 & encoder::LATCH_ON_INDEX == 0;
        Some(RawEncoder {
            count: count as u16,
            stamp: (count >> 16) as u16,
            index: is_latched.then_some((control >> 16) as u16),
            quadrature_error: control as u16 & encoder::QUADRATURE_ERROR != 0,
        })
    }

    /// The level of a pin; none if the card has no such one.
    pub fn pin(&self, pin: u8, port_width: u32) -> Option<bool> {
        let width = port_width.clamp(1, 32);
        let port = usize::try_from(u32::from(pin) / width).ok()?;
        let mut reader = Reader::new(self.ports.get(port.checked_mul(8)?..)?);
        Some(reader.u32()? >> (u32::from(pin) % width) & 1 != 0)
    }

    /// Whether the card drives exactly the selected outputs. It does not before its start, after
    /// its watchdog has expired, and after a restart.
    pub fn is_driving(&self) -> bool {
        let mut reader = Reader::new(self.ports);
        self.layout.pins.ports.iter().all(|port| {
            let _levels = reader.u32();
            reader.u32() == Some(port.driven())
        })
    }

    /// Whether the card has seen what was sent last.
    pub fn echo_state(&self, sent: SequenceWindow) -> EchoState {
        if self.session != sent.first {
            EchoState::Foreign
        } else if self.echo == sent.last {
            EchoState::UpToDate
        } else if sent.has(self.echo) {
            EchoState::Behind
        } else {
            EchoState::Foreign
        }
    }
}
