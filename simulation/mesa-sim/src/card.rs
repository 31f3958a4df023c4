//! The card: what its memory does.

mod configuration;
mod memory;
mod ports;
mod units;

pub use configuration::{ENCODERS, PINS, PWMS};

use configuration::{CLOCK_LOW, PWM_PINS};
use hostmot2::lbp16::{Command, MAX_PACKET, Operations, ParseError, Space, Width};
use hostmot2::registers::{port, watchdog};
use memory::Memory;
use ports::Ports;
use units::{Encoder, Stamps};

/// The simulated card.
///
/// Times are nanoseconds on any clock that never goes back.
#[derive(Debug, Clone)]
pub struct Card {
    memory: Memory,
    idrom: Box<[u32]>,
    is_idrom_writable: bool,
    leds: u32,
    watchdog: Watchdog,
    ports: Ports,
    encoders: [Encoder; ENCODERS],
    stamps: Stamps,
    filter: u32,
    pwm_values: [u32; PWMS],
    pwm_modes: [u32; PWMS],
    pwm_rates: [u32; 2],
    pwm_enables: u32,
}

/// The watchdog's state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Watchdog {
    time: u32,
    /// When it bites.
    deadline: Option<u64>,
    has_bitten: bool,
    /// When it expired, and when the simulation noticed.
    bitten: Option<[u64; 2]>,
    fed_at: Option<u64>,
}

impl Watchdog {
    /// Whether it has expired, and that was not cleared.
    pub fn has_bitten(&self) -> bool {
        self.has_bitten
    }

    /// When it expired (ns on the card's clock), if it has.
    pub fn bitten_at(&self) -> Option<u64> {
        self.bitten.map(|[due, _]| due)
    }

    /// When the simulation noticed that (ns): it checks at each packet, and about each half
    /// millisecond.
    pub fn seen_to_bite_at(&self) -> Option<u64> {
        self.bitten.map(|[_, seen]| seen)
    }

    /// When it was restarted or set last (ns).
    pub fn fed_at(&self) -> Option<u64> {
        self.fed_at
    }

    /// When it will expire (ns), if it is on.
    pub fn deadline(&self) -> Option<u64> {
        self.deadline
    }

    fn restart(&mut self, now: u64) {
        self.fed_at = Some(now);
        self.deadline = match self.time {
            watchdog::OFF.. => None,
            ticks => Some(now + (u64::from(ticks) + 1) * 1_000_000_000 / u64::from(CLOCK_LOW)),
        };
    }
}

impl Card {
    /// A card after power-up: no outputs, the watchdog off.
    pub fn new() -> Self {
        Self {
            memory: Memory::new(),
            idrom: configuration::idrom(),
            is_idrom_writable: false,
            leds: 0,
            watchdog: Watchdog {
                time: watchdog::OFF,
                deadline: None,
                has_bitten: false,
                bitten: None,
                fed_at: None,
            },
            ports: Ports::new(),
            encoders: [Encoder::default(); ENCODERS],
            stamps: Stamps::default(),
            filter: 0,
            pwm_values: [0; PWMS],
            pwm_modes: [0; PWMS],
            pwm_rates: [0; 2],
            pwm_enables: 0,
        }
    }

    /// Executes the packet `request` at `now`, and puts the data that it reads into `answer`, which
    /// stays empty if there is no answer to send.
    ///
    /// # Errors
    ///
    /// The packet is malformed from some point on; the commands before were executed, and there is
    /// no answer. The card counts it.
    pub fn handle(
        &mut self,
        request: &[u8],
        now: u64,
        answer: &mut Vec<u8>,
    ) -> Result<(), ParseError> {
        answer.clear();
        self.advance(now);
        self.memory.count_packet();
        let done = Operations::new(request).try_for_each(|operation| {
            let operation = operation?;
            self.transfer(&operation.command, operation.data, now, answer);
            Ok(())
        });
        if done.is_err() || answer.len() > MAX_PACKET {
            answer.clear();
            self.memory.count_parse_error();
        }
        done
    }

    /// Advances time to `now`: the watchdog may expire.
    pub fn advance(&mut self, now: u64) {
        if let Some(due) = self.watchdog.deadline
            && due <= now
        {
            self.expire(due, now);
        }
    }

    /// The watchdog.
    pub fn watchdog(&self) -> Watchdog {
        self.watchdog
    }

    /// The output duty of a PWM generator: 0 if it is disabled, its pins are not outputs, or it
    /// does not exist.
    pub fn duty(&self, pwm: usize) -> f64 {
        let Some(value) = self.pwm_values.get(pwm) else {
            return 0.0;
        };
        let pins = PWM_PINS[pwm];
        let is_driven = pins.into_iter().all(|pin| self.ports.is_module_driven(pin));
        match is_driven && self.pwm_enables >> pwm & 1 != 0 {
            true => hostmot2::pwm::duty(*value),
            false => 0.0,
        }
    }

    /// The level that the card drives a general-purpose pin to, if it does.
    pub fn driven_level(&self, pin: usize) -> Option<bool> {
        self.ports.driven_level(pin)
    }

    /// Whether nothing comes out of the card: no duty, no pin that is driven.
    pub fn is_neutral(&self) -> bool {
        (0..PWMS).all(|pwm| self.duty(pwm) == 0.0)
            && (0..PINS).all(|pin| self.driven_level(pin).is_none())
    }

    /// Sets the level of a pin from the machine. The default is high.
    pub fn set_level(&mut self, pin: usize, level: bool) {
        self.ports.set_external(pin, level);
    }

    /// Turns an encoder to `count`, at `now`. Its counter keeps the low 16 bits.
    pub fn turn_encoder(&mut self, encoder: usize, count: i64, now: u64) {
        let stamp = self.stamps.at(now);
        if let Some(encoder) = self.encoders.get_mut(encoder) {
            encoder.turn(count, stamp);
        }
    }

    /// Sets an encoder's index, which occurs each `counts`.
    pub fn set_index(&mut self, encoder: usize, counts: u32) {
        if let Some(encoder) = self.encoders.get_mut(encoder) {
            encoder.set_index(counts);
        }
    }

    /// Makes both of an encoder's lines change at once.
    pub fn disturb_encoder(&mut self, encoder: usize) {
        if let Some(encoder) = self.encoders.get_mut(encoder) {
            encoder.disturb();
        }
    }

    fn expire(&mut self, due: u64, now: u64) {
        self.watchdog.deadline = None;
        self.watchdog.has_bitten = true;
        self.watchdog.bitten = Some([due, now]);
        self.ports.let_go();
    }

    fn transfer(&mut self, command: &Command, data: &[u8], now: u64, answer: &mut Vec<u8>) {
        let width = command.width.bytes();
        let mut at = self.memory.pointer(command);
        for number in 0..usize::from(command.count) {
            if command.write {
                let element = &data[number * width..][..width];
                self.write(command, at, element, now);
            } else {
                let mut element = [0; 8];
                self.read(command, at, &mut element[..width], now);
                answer.extend_from_slice(&element[..width]);
            }
            if command.increment {
                at = at.wrapping_add(width as u16);
            }
        }
        self.memory.set_pointer(command, at);
    }

    fn read(&self, command: &Command, at: u16, to: &mut [u8], now: u64) {
        if command.space == Space::HostMot2 && !command.info {
            if let (Ok(whole), 0) = (<&mut [u8; 4]>::try_from(&mut *to), at & 3) {
                *whole = self.read_register(at, now).to_le_bytes();
                return;
            }
            // Registers have 32 bits: narrower ones are parts of them.
            for (number, byte) in to.iter_mut().enumerate() {
                let at = at.wrapping_add(number as u16);
                let register = self.read_register(at & !3, now).to_le_bytes();
                *byte = register[usize::from(at & 3)];
            }
        } else {
            self.memory.read(command, at, to, now);
        }
    }

    fn write(&mut self, command: &Command, at: u16, from: &[u8], now: u64) {
        if command.space != Space::HostMot2 || command.info {
            self.memory.write(command, at, from);
            return;
        }
        if command.width < Width::Bits32 || at & 3 != 0 {
            self.memory.count_memory_error();
            return;
        }
        for (number, part) in from.chunks_exact(4).enumerate() {
            let value = u32::from_le_bytes([part[0], part[1], part[2], part[3]]);
            self.write_register(at.wrapping_add(4 * number as u16), value, now);
        }
    }

    fn read_register(&self, at: u16, now: u64) -> u32 {
        let unit = usize::from(at & 0xFF) / 4;
        match at >> 8 {
            0x01 => configuration::identity(at),
            0x02 => self.leds,
            0x04..0x08 => self.idrom[usize::from(at - 0x0400) / 4],
            0x08 => self.is_idrom_writable.into(),
            0x0C => self.watchdog_left(now),
            0x0D => self.watchdog.has_bitten.into(),
            page @ 0x10..0x15 => self.read_port((page - 0x10) as u8, unit),
            0x30 => self.encoders.get(unit).map_or(0, Encoder::count_register),
            0x31 => self.encoders.get(unit).map_or(0, Encoder::control_register),
            0x32 => self.stamps.divider(),
            0x33 => self.stamps.at(now).into(),
            0x34 => self.filter,
            0x40 => self.pwm_values.get(unit).copied().unwrap_or(0),
            0x41 => self.pwm_modes.get(unit).copied().unwrap_or(0),
            page @ 0x42..0x44 => self.pwm_rates[usize::from(page - 0x42)],
            0x44 => self.pwm_enables,
            _ => 0,
        }
    }

    fn write_register(&mut self, at: u16, value: u32, now: u64) {
        let unit = usize::from(at & 0xFF) / 4;
        match at >> 8 {
            0x02 => self.leds = value,
            0x04..0x08 if self.is_idrom_writable => {
                self.idrom[usize::from(at - 0x0400) / 4] = value;
            }
            0x08 => self.is_idrom_writable = value & 1 != 0,
            0x0C => {
                self.watchdog.time = value;
                self.restart_watchdog(now);
            }
            0x0D => self.watchdog.has_bitten = value & 1 != 0,
            0x0E if value >> 24 == watchdog::RESTART >> 24 => self.restart_watchdog(now),
            page @ 0x10..0x15 => self.ports.write((page - 0x10) as u8, unit, value),
            0x30 => {
                if let Some(encoder) = self.encoders.get_mut(unit) {
                    encoder.clear();
                }
            }
            0x31 => {
                if let Some(encoder) = self.encoders.get_mut(unit) {
                    encoder.set_control(value as u16);
                }
            }
            0x32 => self.stamps.set_divider(value),
            0x34 => self.filter = value,
            0x40 => {
                if let Some(place) = self.pwm_values.get_mut(unit) {
                    *place = value;
                }
            }
            0x41 => {
                if let Some(place) = self.pwm_modes.get_mut(unit) {
                    *place = value & 0x3F;
                }
            }
            page @ 0x42..0x44 => self.pwm_rates[usize::from(page - 0x42)] = value & 0xFFFF,
            0x44 => self.pwm_enables = value & ((1 << PWMS) - 1),
            _ => self.memory.count_memory_error(),
        }
    }

    fn restart_watchdog(&mut self, now: u64) {
        self.watchdog.restart(now);
        // Less than a packet takes to come.
        if let Some(due) = self.watchdog.deadline
            && due < now + 1_000
        {
            self.expire(due, now);
        }
    }

    fn watchdog_left(&self, now: u64) -> u32 {
        match self.watchdog.deadline {
            None => self.watchdog.time | watchdog::OFF,
            Some(due) => {
                let ticks =
                    u128::from(due.saturating_sub(now)) * u128::from(CLOCK_LOW) / 1_000_000_000;
                u32::try_from(ticks).unwrap_or(u32::MAX)
            }
        }
    }

    fn read_port(&self, register: u8, unit: usize) -> u32 {
        match register {
            port::DATA => self.ports.levels(unit),
            _ => self.ports.read(register, unit),
        }
    }
}

impl Default for Card {
    fn default() -> Self {
        Self::new()
    }
}
