//! The card's description of itself: the IDROM with its module and pin descriptors.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use crate::lbp16::Reader;
use std::fmt;

/// How many bytes the IDROM has, with all descriptors.
pub const SIZE: usize = 1024;
/// The most modules that it describes.
pub const MAX_MODULES: usize = 32;
/// The most pins.
pub const MAX_PINS: usize = 144;
/// The most ports.
pub const MAX_PORTS: usize = 8;

/// What a module is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Tag(pub u8);

impl Tag {
    /// The watchdog.
    pub const WATCHDOG: Tag = Tag(0x02);
    /// The ports of general-purpose pins.
    pub const PORTS: Tag = Tag(0x03);
    /// Encoder counters.
    pub const ENCODERS: Tag = Tag(0x04);
    /// Step generators.
    pub const STEP_GENERATORS: Tag = Tag(0x05);
    /// PWM generators.
    pub const PWM: Tag = Tag(0x06);
    /// Multiplexed encoder counters.
    pub const MUXED_ENCODERS: Tag = Tag(0x0C);
    /// The lamps.
    pub const LEDS: Tag = Tag(0x80);
}

impl fmt::Display for Tag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Tag::WATCHDOG => f.write_str("watchdog"),
            Tag::PORTS => f.write_str("ports"),
            Tag::ENCODERS => f.write_str("encoders"),
            Tag::STEP_GENERATORS => f.write_str("step generators"),
            Tag::PWM => f.write_str("PWM generators"),
            Tag::MUXED_ENCODERS => f.write_str("multiplexed encoders"),
            Tag::LEDS => f.write_str("lamps"),
            Tag(other) => write!(f, "module {other:#04x}"),
        }
    }
}

/// A kind of function units that the card's configuration has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Module {
    /// What it is.
    pub tag: Tag,
    /// Its version.
    pub version: u8,
    /// Its clock (Hz).
    pub clock: u32,
    /// How many units there are.
    pub instances: u8,
    /// The address of its first register.
    pub base: u16,
    /// How many different registers it has.
    pub registers: u8,
    /// From one register to the next, in bytes.
    pub register_stride: u32,
    /// From one unit to the next, in bytes.
    pub instance_stride: u32,
    /// A bit for each register that every unit has one of.
    pub multiple: u32,
}

impl Module {
    /// The address of register `number` of unit `instance`; none if there is no such register.
    pub fn address(&self, number: u8, instance: u8) -> Option<u16> {
        if number >= self.registers || instance >= self.instances {
            return None;
        }
        let register = self.register_stride.checked_mul(number.into())?;
        let unit = self.instance_stride.checked_mul(instance.into())?;
        let offset = register.checked_add(unit)?;
        u16::try_from(offset.checked_add(self.base.into())?).ok()
    }
}

/// What else than a general-purpose one a pin is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pin {
    /// The module that it belongs to, if any.
    pub tag: Option<Tag>,
    /// Which unit of it.
    pub unit: u8,
    /// Which pin of the unit; the highest bit is set for outputs.
    pub role: u8,
}

impl Pin {
    /// Whether a module drives it.
    pub fn is_module_output(&self) -> bool {
        self.tag.is_some() && self.role & 0x80 != 0
    }
}

/// The IDROM.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Idrom {
    /// Its type: 2 or 3.
    pub kind: u32,
    /// The card's name in eight characters: `MESA7I92`.
    pub board: String,
    /// The FPGA's size, in thousands of gates or cells.
    pub fpga_size: u32,
    /// The number of the FPGA's pins.
    pub fpga_pins: u32,
    /// How many ports there are.
    pub ports: u32,
    /// How many pins all ports have.
    pub width: u32,
    /// How many pins a port has.
    pub port_width: u32,
    /// The low clock (Hz).
    pub clock_low: u32,
    /// The high clock (Hz).
    pub clock_high: u32,
    /// The modules, as listed.
    pub modules: Vec<Module>,
    /// The pins, by number.
    pub pins: Vec<Pin>,
}

/// Why an IDROM cannot be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum IdromError {
    /// It is shorter than it states.
    #[error("the card's IDROM ends too early")]
    Truncated,
    /// It is of a type that is not known.
    #[error("the card's IDROM is of type {kind}; types 2 and 3 are known")]
    Kind {
        /// Which.
        kind: u32,
    },
    /// A value is impossible.
    #[error("the card's IDROM has an impossible value for its {what}: {value}")]
    Impossible {
        /// Of what.
        what: &'static str,
        /// The value.
        value: u32,
    },
}

impl Idrom {
    /// Reads `bytes`, from the IDROM's first one on. Allocates.
    ///
    /// # Errors
    ///
    /// [`IdromError`].
    pub fn parse(bytes: &[u8]) -> Result<Self, IdromError> {
        let mut head = Reader::new(bytes);
        let mut next = || head.u32().ok_or(IdromError::Truncated);
        let kind = next()?;
        if !(2..=3).contains(&kind) {
            return Err(IdromError::Kind { kind });
        }
        let (modules_at, pins_at) = (next()?, next()?);
        let name = [next()?, next()?];
        let (fpga_size, fpga_pins) = (next()?, next()?);
        let ports = within("ports", next()?, 1, MAX_PORTS as u32)?;
        let width = within("pins", next()?, 1, MAX_PINS as u32)?;
        let port_width = within("port width", next()?, 1, 32)?;
        if ports.saturating_mul(port_width) < width {
            return Err(IdromError::Impossible {
                what: "pins",
                value: width,
            });
        }
        let clock_low = within("low clock", next()?, 1, u32::MAX)?;
        let clock_high = within("high clock", next()?, 1, u32::MAX)?;
        let instance_strides = [next()?, next()?];
        let register_strides = [next()?, next()?];

        let mut modules = Vec::new();
        let mut listed = Reader::new(from(bytes, modules_at)?);
        while modules.len() < MAX_MODULES {
            let [tag, version, clock, instances] = listed.take().ok_or(IdromError::Truncated)?;
            if tag == 0 {
                break;
            }
            let [low, high, registers, strides] = listed.take().ok_or(IdromError::Truncated)?;
            let multiple = listed.u32().ok_or(IdromError::Truncated)?;
            modules.push(Module {
                tag: Tag(tag),
                version,
                clock: if clock == 1 { clock_low } else { clock_high },
                instances,
                base: u16::from_le_bytes([low, high]),
                registers,
                register_stride: register_strides[usize::from(strides & 0xF != 0)],
                instance_stride: instance_strides[usize::from(strides >> 4 != 0)],
                multiple,
            });
        }
        let mut pins = Vec::new();
        let mut listed = Reader::new(from(bytes, pins_at)?);
        for _ in 0..width {
            let [role, tag, unit, _] = listed.take().ok_or(IdromError::Truncated)?;
            pins.push(Pin {
                tag: (tag != 0).then_some(Tag(tag)),
                unit,
                role,
            });
        }
        Ok(Self {
            kind,
            board: text(name.map(u32::to_le_bytes).as_flattened()),
            fpga_size,
            fpga_pins,
            ports,
            width,
            port_width,
            clock_low,
            clock_high,
            modules,
            pins,
        })
    }

    /// The module of this tag, if the card has one.
    pub fn module(&self, tag: Tag) -> Option<&Module> {
        self.modules.iter().find(|module| module.tag == tag)
    }
}

fn within(what: &'static str, value: u32, least: u32, most: u32) -> Result<u32, IdromError> {
    if (least..=most).contains(&value) {
        Ok(value)
    } else {
        Err(IdromError::Impossible { what, value })
    }
}

fn from(bytes: &[u8], offset: u32) -> Result<&[u8], IdromError> {
    let offset = usize::try_from(offset).map_err(|_| IdromError::Truncated)?;
    bytes.get(offset..).ok_or(IdromError::Truncated)
}

/// The characters up to the first that is not allowed in a name.
pub(crate) fn text(bytes: &[u8]) -> String {
    let named = bytes.iter().map(|&byte| char::from(byte));
    named
        .take_while(|char| char.is_ascii_graphic() || *char == ' ')
        .collect::<String>()
        .trim_end()
        .to_owned()
}
