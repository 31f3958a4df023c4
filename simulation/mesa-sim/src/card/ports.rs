//! The general-purpose pins.

use super::configuration::{PINS, PORT_WIDTH, PORTS};
use hostmot2::registers::port;

const REGISTERS: usize = 5;

/// The ports' registers, and the levels from the machine.
#[derive(Debug, Clone)]
pub(super) struct Ports {
    registers: [[u32; PORTS]; REGISTERS],
    /// The levels from the machine.
    external: [u32; PORTS],
}

impl Ports {
    pub(super) fn new() -> Self {
        Self {
            registers: [[0; PORTS]; REGISTERS],
            // Pull-ups.
            external: [mask(); PORTS],
        }
    }

    pub(super) fn read(&self, register: u8, port: usize) -> u32 {
        let registers = self.registers.get(usize::from(register));
        registers.and_then(|of| of.get(port)).copied().unwrap_or(0)
    }

    pub(super) fn write(&mut self, register: u8, port: usize, value: u32) {
        let registers = self.registers.get_mut(usize::from(register));
        if let Some(place) = registers.and_then(|of| of.get_mut(port)) {
            *place = value & mask();
        }
    }

    /// The levels of a port's pins. Pins driven by a module read low: their wave form is not
    /// simulated.
    pub(super) fn levels(&self, at: usize) -> u32 {
        let Some(external) = self.external.get(at) else {
            return 0;
        };
        let driven = self.read(port::DIRECTION, at);
        let latch = self.read(port::DATA, at) & !self.read(port::ALTERNATE, at);
        let out = latch ^ self.read(port::INVERT, at);
        (out & driven) | (external & !driven)
    }

    pub(super) fn set_external(&mut self, pin: usize, level: bool) {
        if pin < PINS {
            let (port, bit) = (pin / PORT_WIDTH, 1 << (pin % PORT_WIDTH));
            self.external[port] = match level {
                true => self.external[port] | bit,
                false => self.external[port] & !bit,
            };
        }
    }

    /// Whether a module drives the pin.
    pub(super) fn is_module_driven(&self, pin: usize) -> bool {
        self.has(port::DIRECTION, pin) && self.has(port::ALTERNATE, pin)
    }

    /// What the pin is driven to from the latch.
    pub(super) fn driven_level(&self, pin: usize) -> Option<bool> {
        let is_driven = self.has(port::DIRECTION, pin) && !self.has(port::ALTERNATE, pin);
        is_driven.then(|| self.has(port::DATA, pin) != self.has(port::INVERT, pin))
    }

    /// What the watchdog does: all pins become inputs.
    pub(super) fn let_go(&mut self) {
        for register in [port::DIRECTION, port::OPEN_DRAIN] {
            self.registers[usize::from(register)] = [0; PORTS];
        }
    }

    fn has(&self, register: u8, pin: usize) -> bool {
        self.read(register, pin / PORT_WIDTH) >> (pin % PORT_WIDTH) & 1 != 0
    }
}

const fn mask() -> u32 {
    (1 << PORT_WIDTH) - 1
}
