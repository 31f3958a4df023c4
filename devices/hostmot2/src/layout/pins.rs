//! The general-purpose pins, port by port.

use super::{module, register};
use crate::idrom::{Idrom, Tag};
use crate::registers::port;
use crate::{LayoutError, Selection};

/// The ports, and which of their pins are what.
#[derive(Debug, Clone)]
pub(crate) struct Pins {
    pub(crate) ports: Vec<Port>,
    /// The outputs, in the order of the selection.
    pub(crate) outputs: Vec<PortBit>,
}

/// A port's registers, and masks of its pins.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Port {
    pub(crate) data: u16,
    pub(crate) direction: u16,
    pub(crate) alternate: u16,
    pub(crate) open_drain: u16,
    /// Driven by the modules that are used.
    pub(crate) modules: u32,
    /// General-purpose outputs.
    pub(crate) outputs: u32,
    /// The outputs' neutral levels.
    pub(crate) neutral: u32,
}

impl Port {
    /// The pins that the card drives.
    pub(crate) fn driven(&self) -> u32 {
        self.modules | self.outputs
    }
}

/// Where a pin is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PortBit {
    pub(crate) port: usize,
    pub(crate) mask: u32,
}

impl Pins {
    pub(super) fn new(idrom: &Idrom, selection: &Selection) -> Result<Self, LayoutError> {
        let count = idrom.ports as u8;
        let described = module(idrom, Tag::PORTS, count)?;
        let mut ports = Vec::new();
        for number in 0..count {
            ports.push(Port {
                data: register(described, port::DATA, number)?,
                direction: register(described, port::DIRECTION, number)?,
                alternate: register(described, port::ALTERNATE, number)?,
                open_drain: register(described, port::OPEN_DRAIN, number)?,
                modules: 0,
                outputs: 0,
                neutral: 0,
            });
        }
        let place = |pin: usize| PortBit {
            port: pin / idrom.port_width as usize,
            mask: 1 << (pin % idrom.port_width as usize),
        };
        let mut has_pin = vec![false; selection.pwms.into()];
        for (number, pin) in idrom.pins.iter().enumerate() {
            if pin.tag == Some(Tag::PWM)
                && pin.is_module_output()
                && let Some(has_pin) = has_pin.get_mut(usize::from(pin.unit))
            {
                let PortBit { port, mask } = place(number);
                ports[port].modules |= mask;
                *has_pin = true;
            }
        }
        if let Some(pwm) = has_pin.iter().position(|has_pin| !has_pin) {
            return Err(LayoutError::NoOutputPin { pwm: pwm as u8 });
        }
        let mut outputs = Vec::new();
        for output in &selection.outputs {
            let pin = output.pin;
            let described = idrom.pins.get(usize::from(pin));
            let described = described.ok_or(LayoutError::NoPin { pin })?;
            let PortBit { port, mask } = place(pin.into());
            let is_encoders =
                described.tag == Some(Tag::ENCODERS) && described.unit < selection.encoders;
            let taken = ports[port].modules | ports[port].outputs;
            if is_encoders || taken & mask != 0 {
                return Err(LayoutError::PinTaken { pin });
            }
            ports[port].outputs |= mask;
            if output.neutral {
                ports[port].neutral |= mask;
            }
            outputs.push(PortBit { port, mask });
        }
        Ok(Self { ports, outputs })
    }
}
