//! What a bus is to have, and what it has.

use crate::sdo::{Sdo, SdoValue};
use std::fmt;

/// A subdevice that a bus is to have, in the order of its line.
///
/// ```
/// use luna_ethercat::Expected;
///
/// let terminals = [
///     Expected::new("coupler", 2, 0x044c_2c52),
///     Expected::new("drive", 0x6a, 0x0070_0000).revision(3).sync0(),
/// ];
/// # let _ = terminals;
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Expected {
    pub(crate) name: String,
    pub(crate) vendor: u32,
    pub(crate) product: u32,
    pub(crate) revision: Option<u32>,
    pub(crate) has_sync0: bool,
    pub(crate) sdos: Vec<Sdo>,
}

impl Expected {
    /// One of this vendor and product, which errors call `name`.
    pub fn new(name: &str, vendor: u32, product: u32) -> Self {
        Self {
            name: name.to_owned(),
            vendor,
            product,
            revision: None,
            has_sync0: false,
            sdos: Vec::new(),
        }
    }

    /// Of this revision too; any if not stated.
    #[must_use]
    pub fn revision(mut self, revision: u32) -> Self {
        self.revision = Some(revision);
        self
    }

    /// It is to make SYNC0 pulses by its distributed clock, once a period of a link that
    /// [follows the clock](crate::Link::follow_clock).
    #[must_use]
    pub fn sync0(mut self) -> Self {
        self.has_sync0 = true;
        self
    }

    /// Writes an object over its mailbox (CoE) while the bus is opened: in PRE-OP, before process
    /// data is mapped, in the order of the calls. A real drive gets its mode of operation so.
    ///
    /// `value` is a number of the object's type (`9_i8`): `u8`, `u16`, `u32`, `i8`, `i16`, `i32`.
    /// The subdevice has to take each within a second; what it refuses is an
    /// [`OpenError::Sdo`](crate::OpenError::Sdo). Many subdevices keep what was written until their
    /// power is off, so list all that the machine relies on.
    ///
    /// ```
    /// use luna_ethercat::sim::{Network, SubDevice};
    /// use luna_ethercat::{Bus, Expected, Wire};
    ///
    /// let network = Network::new();
    /// network.add(SubDevice::servo());
    /// let drive = Expected::new("drive", SubDevice::VENDOR, SubDevice::SERVO)
    ///     .sdo(0x6060, 0, 8_i8) // cyclic synchronous position
    ///     .expect_sdo(0x6061, 0, 8_i8) // and it has taken it
    ///     .sdo_list(0x1c12, &[0x1601_u16]); // control word and target position
    /// let bus = Bus::open(&Wire::simulated(&network), &[drive]).unwrap();
    /// assert_eq!(bus.subdevices()[0].outputs, 2 + 4);
    /// ```
    #[must_use]
    pub fn sdo(self, index: u16, sub: u8, value: impl Into<SdoValue>) -> Self {
        self.with(index, sub, value.into(), false)
    }

    /// Compares an object with `value`, in the same order as [`sdo`](Self::sdo) writes.
    #[must_use]
    pub fn expect_sdo(self, index: u16, sub: u8, value: impl Into<SdoValue>) -> Self {
        self.with(index, sub, value.into(), true)
    }

    /// Writes a list, as subdevices want it: sub-index 0 is set to 0, then the values are written
    /// to the sub-indices from 1 on, and then their number to sub-index 0.
    ///
    /// The PDOs of the outputs are `0x1c12` and those of the inputs `0x1c13`, both of `u16`. What a
    /// PDO has is `0x1600` and so on for outputs, `0x1a00` and so on for inputs, of `u32`: index,
    /// sub-index and number of bits (`0x6040_0010`). At most 255 values; the rest is not written.
    #[must_use]
    pub fn sdo_list<T: Into<SdoValue> + Copy>(self, index: u16, values: &[T]) -> Self {
        let mut this = self.sdo(index, 0, 0_u8);
        let mut count = 0;
        for (sub, value) in (1..=u8::MAX).zip(values) {
            this = this.sdo(index, sub, *value);
            count = sub;
        }
        this.sdo(index, 0, count)
    }

    fn with(mut self, index: u16, sub: u8, value: SdoValue, is_check: bool) -> Self {
        self.sdos.push(Sdo {
            index,
            sub,
            value,
            is_check,
        });
        self
    }

    pub(crate) fn is(&self, found: &Found) -> bool {
        let is_same = (self.vendor, self.product) == (found.vendor, found.product);
        is_same && self.revision.is_none_or(|it| it == found.revision)
    }
}

impl fmt::Display for Expected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            name,
            vendor,
            product,
            ..
        } = self;
        write!(f, "`{name}` (vendor {vendor:#x}, product {product:#x}")?;
        if let Some(revision) = self.revision {
            write!(f, ", revision {revision:#x}")?;
        }
        f.write_str(")")
    }
}

/// A subdevice that was found.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct Found {
    /// The name that its EEPROM has.
    pub name: String,
    /// The vendor's number.
    pub vendor: u32,
    /// The product's number.
    pub product: u32,
    /// Its revision.
    pub revision: u32,
    /// Its serial number; 0 if it has none.
    pub serial: u32,
    /// Whether it has a distributed clock.
    pub has_clock: bool,
    /// The bytes of its outputs, once process data is mapped.
    pub outputs: usize,
    /// The bytes of its inputs.
    pub inputs: usize,
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            name,
            vendor,
            product,
            revision,
            ..
        } = self;
        write!(
            f,
            "`{name}` (vendor {vendor:#x}, product {product:#x}, revision {revision:#x})"
        )
    }
}
