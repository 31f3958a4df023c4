//! The addresses of the selected units in a card's memory, and the packets of its set-up.

mod pins;

use crate::description::Description;
use crate::idrom::{Idrom, Module, Tag};
use crate::lbp16::{Packet, PacketError, Space, Width};
use crate::registers::{encoder, pwm, scratch, watchdog};
use crate::{LayoutError, Selection};
use pins::Pins;

/// The limit of write packets in transit: an echo of an older one is foreign.
const WRITES_UNDER_WAY: u32 = 1_000;

/// An encoder's control, with no latch.
const COUNTING: u16 = encoder::INDEX_HIGH | encoder::SLOW_FILTER;

/// The time stamps count at a megahertz, or as near as the clock allows.
const STAMPS_PER_SECOND: u32 = 1_000_000;

/// The packets for using a card with a [`Selection`].
///
/// In each cycle [`write_request`](Self::write_request) and [`read_request`](Self::read_request)
/// are sent, and [`decode`](Self::decode) reads the answer. Before the first, send the packets of
/// [`set_up`](Self::set_up), each of them confirmed, and [`start_request`](Self::start_request)
/// until an answer shows that it has arrived. [`neutral_request`](Self::neutral_request) ends it:
/// it disables the card's outputs in such a way that no write packet in transit enables them again.
///
/// Creating one allocates; the functions of a cycle do not.
///
/// ```
/// use hostmot2::lbp16::Packet;
/// use hostmot2::{EchoState, Layout, SequenceWindow};
///
/// /// One cycle: `send` sends packets, and `receive` receives the answer.
/// fn cycle(
///     layout: &Layout,
///     number: u32,
///     duty: f64,
///     send: fn(&[u8]),
///     receive: fn(&mut [u8]) -> usize,
/// ) -> Option<u16> {
///     let (mut packet, mut outputs) = (Packet::new(), layout.outputs_at_rest());
///     outputs.set_duty(0, duty);
///     outputs.set_enabled(0, true);
///     layout.write_request(number, &outputs, &mut packet).ok()?;
///     send(packet.bytes());
///     layout.read_request(number, &mut packet).ok()?;
///     send(packet.bytes());
///     let mut bytes = [0; 1472];
///     let length = receive(&mut bytes);
///     let answer = layout.decode(&bytes[..length]).ok()?;
///     let is_ours = answer.sequence == number && answer.is_driving() && !answer.has_bitten;
///     let written = answer.echo_state(SequenceWindow { first: 0, last: number });
///     (is_ours && written == EchoState::UpToDate).then_some(answer.encoder(0)?.count)
/// }
/// # let _ = cycle;
/// ```
#[derive(Debug, Clone)]
pub struct Layout {
    pub(crate) encoders: Vec<Registers>,
    pub(crate) latch_index: u64,
    pub(crate) stamp: Option<u16>,
    stamp_divider: Option<(u16, u32)>,
    frequency: f64,
    pub(crate) pwms: Vec<Registers>,
    pub(crate) pwm_enable: Option<u16>,
    pwm_rate: Option<(u16, u32)>,
    pub(crate) pins: Pins,
    pub(crate) watchdog: WatchdogRegisters,
    watchdog_time: u32,
}

/// The two registers of an encoder or of a PWM generator.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Registers {
    /// The count, or the value.
    pub(crate) value: u16,
    /// The control bits, or the mode.
    pub(crate) control: u16,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct WatchdogRegisters {
    pub(crate) time: u16,
    pub(crate) status: u16,
    pub(crate) cookie: u16,
}

/// Which numbers of write packets an echo may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SequenceWindow {
    /// The number before the first write packet's: what set-up leaves.
    pub first: u32,
    /// The last one's.
    pub last: u32,
}

impl SequenceWindow {
    /// Whether a packet of this number may still have its effect now.
    pub(crate) fn has(self, number: u32) -> bool {
        let sent = self.last.wrapping_sub(self.first);
        self.last.wrapping_sub(number) <= sent.min(WRITES_UNDER_WAY)
    }
}

impl Layout {
    /// Finds what `selection` needs on the card with this `description`. Allocates.
    ///
    /// # Errors
    ///
    /// A [`LayoutError`]: the card has too few units, or one is used twice.
    pub fn new(description: &Description, selection: &Selection) -> Result<Self, LayoutError> {
        let idrom = &description.idrom;
        let encoders = units(idrom, Tag::ENCODERS, selection.encoders)?;
        let pwms = units(idrom, Tag::PWM, selection.pwms)?;
        let dog = module(idrom, Tag::WATCHDOG, 1)?;
        let (mut stamp, mut stamp_divider, mut frequency) =
            (None, None, f64::from(STAMPS_PER_SECOND));
        if !encoders.is_empty() {
            let module = module(idrom, Tag::ENCODERS, selection.encoders)?;
            let divider = (module.clock / STAMPS_PER_SECOND).clamp(2, 0x7FFF);
            stamp = Some(register(module, encoder::STAMP, 0)?);
            stamp_divider = Some((register(module, encoder::STAMP_DIVIDER, 0)?, divider - 2));
            frequency = f64::from(module.clock) / f64::from(divider);
        }
        let (mut pwm_enable, mut pwm_rate) = (None, None);
        if !pwms.is_empty() {
            let module = module(idrom, Tag::PWM, selection.pwms)?;
            let rate = crate::pwm::rate(selection.pwm_frequency, idrom.clock_high);
            pwm_rate = Some((register(module, pwm::RATE, 0)?, rate));
            pwm_enable = Some(register(module, pwm::ENABLE, 0)?);
        }
        Ok(Self {
            encoders,
            latch_index: selection.latch_index,
            stamp,
            stamp_divider,
            frequency,
            pwms,
            pwm_enable,
            pwm_rate,
            pins: Pins::new(idrom, selection)?,
            watchdog: WatchdogRegisters {
                time: register(dog, watchdog::TIME, 0)?,
                status: register(dog, watchdog::STATUS, 0)?,
                cookie: register(dog, watchdog::COOKIE, 0)?,
            },
            watchdog_time: watchdog_time(selection.watchdog_ns, dog.clock)?,
        })
    }

    /// How many encoders are read.
    pub fn encoders(&self) -> usize {
        self.encoders.len()
    }

    /// How many PWM generators are written.
    pub fn pwms(&self) -> usize {
        self.pwms.len()
    }

    /// How many general-purpose pins are outputs.
    pub fn outputs(&self) -> usize {
        self.pins.outputs.len()
    }

    /// The number of time stamps a second, for [`Stamps`](crate::encoder::Stamps).
    pub fn stamps_per_second(&self) -> f64 {
        self.frequency
    }

    /// The packets of the set-up, in order: each has to be [confirmed](crate::Client::confirmed)
    /// before the next. Afterwards all is as selected, the watchdog is off, and no pin is an
    /// output: [`start_request`](Self::start_request) enables those. Allocates.
    ///
    /// # Errors
    ///
    /// [`PacketError`]: they would be too long.
    pub fn set_up(&self) -> Result<[Packet; 2], PacketError> {
        let mut off = Packet::new();
        for at in &self.pins.ports {
            off.write_register(at.direction, 0)?;
            off.write_register(at.open_drain, 0)?;
        }
        off.write_register(self.watchdog.time, watchdog::OFF)?;
        let mut units = Packet::new();
        if let Some((address, divider)) = self.stamp_divider {
            units.write_register(address, divider)?;
        }
        for at in &self.encoders {
            // This also clears a quadrature error, which occurs whenever an encoder is powered.
            units.write_register(at.control, COUNTING.into())?;
        }
        if let Some((address, rate)) = self.pwm_rate {
            units.write_register(address, rate)?;
        }
        for at in &self.pwms {
            units.write_register(at.control, crate::pwm::MODE)?;
            units.write_register(at.value, 0)?;
        }
        if let Some(enable) = self.pwm_enable {
            units.write_register(enable, 0)?;
        }
        Ok([off, units])
    }

    /// Makes the packet that enables the outputs: neutral ones, with the watchdog waiting for the
    /// first write packet, which has to come within its time. It also arms the latches of the
    /// index. `first` is the number before that of the first write packet, and not 0, which a
    /// restarted card has: each answer contains it from now on. It may be sent several times, until
    /// an answer [shows](crate::Answer::is_driving) that it has arrived. O(encoders + ports),
    /// allocates nothing.
    ///
    /// # Errors
    ///
    /// [`PacketError`]: it would be too long.
    pub fn start_request(&self, first: u32, packet: &mut Packet) -> Result<(), PacketError> {
        packet.clear();
        // First the watchdog, which guards the outputs from here on.
        packet.write_register(self.watchdog.time, self.watchdog_time)?;
        packet.write_register(self.watchdog.status, 0)?;
        for at in &self.pins.ports {
            packet.write_register(at.data, at.neutral)?;
            packet.write_register(at.alternate, at.modules)?;
            packet.write_register(at.direction, at.driven())?;
        }
        for (number, at) in self.encoders.iter().enumerate() {
            // Not earlier: an index latched long before the first answer may be turns of the
            // counter away.
            if self.latches_index(number) {
                let latching = COUNTING | encoder::LATCH_ON_INDEX | encoder::JUST_ONCE;
                packet.write_register(at.control, latching.into())?;
            }
        }
        // The numbers last: an answer that contains them shows that all before was executed.
        let (timers, wide, number) = (Space::Timers, Width::Bits16, first.to_le_bytes());
        packet.write(timers, wide, scratch::WRITE_SEQUENCE, &number)?;
        packet.write(timers, wide, scratch::SESSION, &number)?;
        Ok(())
    }

    pub(crate) fn latches_index(&self, encoder: usize) -> bool {
        encoder < 64 && self.latch_index >> encoder & 1 != 0
    }
}

fn module(idrom: &Idrom, tag: Tag, asked: u8) -> Result<&Module, LayoutError> {
    let module = idrom.module(tag);
    let there = module.map_or(0, |module| module.instances);
    match module {
        Some(module) if there >= asked => Ok(module),
        _ => Err(LayoutError::TooFew { tag, asked, there }),
    }
}

fn register(module: &Module, number: u8, instance: u8) -> Result<u16, LayoutError> {
    let address = module.address(number, instance);
    address.ok_or(LayoutError::NoRegister { tag: module.tag })
}

/// The registers of the first encoders or PWM generators: both have their value first and their
/// control next.
fn units(idrom: &Idrom, tag: Tag, asked: u8) -> Result<Vec<Registers>, LayoutError> {
    const { assert!(encoder::COUNT == pwm::VALUE && encoder::CONTROL == pwm::MODE) };
    if asked == 0 {
        return Ok(Vec::new());
    }
    let module = module(idrom, tag, asked)?;
    let unit = |instance| {
        Ok(Registers {
            value: register(module, encoder::COUNT, instance)?,
            control: register(module, encoder::CONTROL, instance)?,
        })
    };
    (0..asked).map(unit).collect()
}

fn watchdog_time(asked: u64, clock: u32) -> Result<u32, LayoutError> {
    let ticks = u128::from(asked) * u128::from(clock) / 1_000_000_000;
    let time = u32::try_from(ticks).unwrap_or(u32::MAX);
    match time {
        0..100 | watchdog::OFF.. => Err(LayoutError::WatchdogTime { asked }),
        _ => Ok(time - 1),
    }
}
