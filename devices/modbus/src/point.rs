//! What a server has: coils, discrete inputs, input and holding registers.

use sealed::Coded;
use std::fmt;
use std::marker::PhantomData;

/// The four tables of a Modbus server. Addresses count from 0 in each, as in the protocol; many
/// manuals count from 1, and put the number of the table before it (40001 is holding register 0).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Table {
    /// Bits that can be written.
    Coil,
    /// Bits that can only be read.
    Discrete,
    /// Registers of 16 bits that can only be read.
    Input,
    /// Registers of 16 bits that can be written.
    Holding,
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Table::Coil => "coil",
            Table::Discrete => "discrete input",
            Table::Input => "input register",
            Table::Holding => "holding register",
        })
    }
}

/// Which of two registers has the upper half of a value of 32 bits. Modbus does not say; the
/// device's manual does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum WordOrder {
    /// The register of the lower address: "big-endian", ABCD.
    #[default]
    HighFirst,
    /// The register of the higher address: "word-swapped", CDAB.
    LowFirst,
}

/// A value that a point can have: `bool` in coils and discrete inputs, and each [`Register`] type.
pub trait Value: Coded {}

/// A value in one or two registers: `u16`, `i16`, `u32`, `i32`, `f32`. Scales and units are the
/// program's.
pub trait Register: Value {}

pub(crate) mod sealed {
    use super::WordOrder;

    /// How values lie in registers; a bit is a register that is 0 or 1.
    pub trait Coded: Copy + Send + std::fmt::Debug + 'static {
        /// In registers, or bits.
        const WIDTH: u16;
        /// From `WIDTH` registers.
        fn decode(raw: &[u16], order: WordOrder) -> Self;
        /// To registers, of which the first `WIDTH` count.
        fn encode(self, order: WordOrder) -> [u16; 2];
        /// The same value; each is exact.
        fn number(self) -> f64;
    }
}

impl Value for bool {}
impl Coded for bool {
    const WIDTH: u16 = 1;

    fn decode(raw: &[u16], _: WordOrder) -> Self {
        raw[0] != 0
    }

    fn encode(self, _: WordOrder) -> [u16; 2] {
        [self.into(), 0]
    }

    fn number(self) -> f64 {
        f64::from(u8::from(self))
    }
}

macro_rules! one_register {
    ($type:ty) => {
        impl Value for $type {}
        impl Register for $type {}
        impl Coded for $type {
            const WIDTH: u16 = 1;

            fn decode(raw: &[u16], _: WordOrder) -> Self {
                <$type>::from_ne_bytes(raw[0].to_ne_bytes())
            }

            fn encode(self, _: WordOrder) -> [u16; 2] {
                [u16::from_ne_bytes(self.to_ne_bytes()), 0]
            }

            fn number(self) -> f64 {
                self.into()
            }
        }
    };
}

macro_rules! two_registers {
    ($type:ty) => {
        impl Value for $type {}
        impl Register for $type {}
        impl Coded for $type {
            const WIDTH: u16 = 2;

            fn decode(raw: &[u16], order: WordOrder) -> Self {
                let (high, low) = match order {
                    WordOrder::HighFirst => (raw[0], raw[1]),
                    WordOrder::LowFirst => (raw[1], raw[0]),
                };
                <$type>::from_ne_bytes((u32::from(high) << 16 | u32::from(low)).to_ne_bytes())
            }

            fn encode(self, order: WordOrder) -> [u16; 2] {
                let bits = u32::from_ne_bytes(self.to_ne_bytes());
                let (high, low) = ((bits >> 16) as u16, bits as u16);
                match order {
                    WordOrder::HighFirst => [high, low],
                    WordOrder::LowFirst => [low, high],
                }
            }

            fn number(self) -> f64 {
                self.into()
            }
        }
    };
}

one_register!(u16);
one_register!(i16);
two_registers!(u32);
two_registers!(i32);
two_registers!(f32);

/// Where a value lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Place {
    pub(crate) table: Table,
    pub(crate) address: u16,
    /// In registers or bits.
    pub(crate) width: u16,
}

/// A point to read: a [`discrete`] input, an [`input`] register, or a [`Target`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Source<T> {
    pub(crate) place: Place,
    pub(crate) order: WordOrder,
    value: PhantomData<T>,
}

/// A point to read or write: a [`coil`] or a [`holding`] register.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Target<T>(pub(crate) Source<T>);

impl<T: Value> Source<T> {
    fn new(table: Table, address: u16) -> Self {
        Self {
            place: Place {
                table,
                address,
                width: T::WIDTH,
            },
            order: WordOrder::default(),
            value: PhantomData,
        }
    }
}

impl<T: Register> Source<T> {
    /// Sets the order of two registers; of one it changes nothing.
    #[must_use]
    pub fn order(mut self, order: WordOrder) -> Self {
        self.order = order;
        self
    }
}

impl<T: Register> Target<T> {
    /// Sets the order of two registers; of one it changes nothing.
    #[must_use]
    pub fn order(self, order: WordOrder) -> Self {
        Self(self.0.order(order))
    }
}

impl<T> From<Target<T>> for Source<T> {
    fn from(target: Target<T>) -> Self {
        target.0
    }
}

/// The coil at an address.
pub fn coil(address: u16) -> Target<bool> {
    Target(Source::new(Table::Coil, address))
}

/// The discrete input at an address.
pub fn discrete(address: u16) -> Source<bool> {
    Source::new(Table::Discrete, address)
}

/// The input register at an address, with the next one for a value of 32 bits.
pub fn input<T: Register>(address: u16) -> Source<T> {
    Source::new(Table::Input, address)
}

/// The holding register at an address, with the next one for a value of 32 bits.
///
/// ```
/// use luna_modbus::{Target, WordOrder, holding};
///
/// let speed: Target<f32> = holding(100).order(WordOrder::LowFirst); // registers 100 and 101
/// # let _ = speed;
/// ```
pub fn holding<T: Register>(address: u16) -> Target<T> {
    Target(Source::new(Table::Holding, address))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_order_of_words_is_that_of_the_names() {
        assert_eq!(1.0_f32.encode(WordOrder::HighFirst), [0x3F80, 0]);
        assert_eq!(1.0_f32.encode(WordOrder::LowFirst), [0, 0x3F80]);
        assert_eq!((-2_i16).encode(WordOrder::LowFirst), [0xFFFE, 0]);
        assert_eq!(u32::decode(&[1, 2], WordOrder::HighFirst), 0x1_0002);
    }

    proptest! {
        #[test]
        fn values_come_back(bits: u32, is_low: bool) {
            let order = if is_low { WordOrder::LowFirst } else { WordOrder::HighFirst };
            let float = f32::from_bits(bits);
            prop_assert_eq!(f32::decode(&float.encode(order), order).to_bits(), bits);
            prop_assert_eq!(u32::decode(&bits.encode(order), order), bits);
            prop_assert_eq!(i32::decode(&(bits as i32).encode(order), order), bits as i32);
            prop_assert_eq!(i16::decode(&(bits as i16).encode(order), order), bits as i16);
            prop_assert_eq!(u16::decode(&(bits as u16).encode(order), order), bits as u16);
            prop_assert_eq!(bool::decode(&(bits & 1 == 1).encode(order), order), bits & 1 == 1);
            prop_assert_eq!((bits as i32).number() as i32, bits as i32);
        }
    }
}
