//! What a bus is to have, and what it has.

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
