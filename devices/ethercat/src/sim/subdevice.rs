//! The description of a simulated subdevice.

use super::application::{Application, Nothing, Servo};
use super::dictionary::{Dictionary, Entry};
use std::time::Duration;

/// What a subdevice states about itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Identity {
    /// The vendor's number.
    pub vendor: u32,
    /// The product's number.
    pub product: u32,
    /// Its revision.
    pub revision: u32,
    /// Its serial number.
    pub serial: u32,
}

/// A subdevice that is to be simulated: see [`Network::add`](super::Network::add).
#[derive(Debug)]
pub struct SubDevice {
    pub(super) name: String,
    pub(super) identity: Identity,
    /// The PDOs of outputs, and of inputs, as its EEPROM has them.
    pub(super) pdos: [Vec<(u16, Vec<Entry>)>; 2],
    pub(super) dictionary: Option<Dictionary>,
    pub(super) application: Box<dyn Application>,
    /// Parts per million by which its clock is fast, if it has one.
    pub(super) drift: Option<f64>,
    /// In units of 100 µs.
    pub(super) watchdog: u16,
}

impl SubDevice {
    /// The vendor of those that this crate describes. No real vendor has it.
    pub const VENDOR: u32 = 0x4c55_4e41;
    /// The product of [`digital`](Self::digital).
    pub const DIGITAL: u32 = 0xd101;
    /// The product of [`servo`](Self::servo).
    pub const SERVO: u32 = 0x5e44;

    /// A subdevice with entries of process data of these lengths (bits, at most 255 each), in
    /// their order, and with `application` behind them.
    ///
    /// # Panics
    ///
    /// It does not fit into the memory of a subdevice: there are more than 2048 bytes or 255
    /// entries of outputs, or of inputs, or more than 255 bytes of the name.
    pub fn new(
        name: &str,
        identity: Identity,
        outputs: &[u8],
        inputs: &[u8],
        application: impl Application + 'static,
    ) -> Self {
        for bits in [outputs, inputs] {
            let length: usize = bits.iter().map(|bits| usize::from(*bits)).sum();
            let fits = bits.len() <= 255 && length <= 8 * 2048;
            assert!(fits, "a simulated subdevice has too much process data");
        }
        assert!(
            name.len() <= 255,
            "a simulated subdevice's name is too long"
        );
        let pdos =
            [(0x1600, 0x7000, outputs), (0x1a00, 0x6000, inputs)].map(|(pdo, index, bits)| {
                let entries = (1..=u8::MAX).zip(bits).map(|(sub, bits)| Entry {
                    index,
                    sub,
                    bits: *bits,
                });
                let entries: Vec<_> = entries.collect();
                if entries.is_empty() {
                    Vec::new()
                } else {
                    vec![(pdo, entries)]
                }
            });
        Self {
            name: name.to_owned(),
            identity,
            pdos,
            dictionary: None,
            application: Box::new(application),
            drift: None,
            watchdog: 1000,
        }
    }

    /// A subdevice with a mailbox and the objects of `dictionary`, which has its process data too,
    /// and with `application` behind them.
    ///
    /// The mailbox is that of sync managers 0 and 1. It answers at once: expedited SDOs, no
    /// complete access, no segments, no information about objects. Like many real ones, it keeps
    /// what was written as long as it is there, and not only while one bus is open.
    pub fn coe(
        name: &str,
        identity: Identity,
        dictionary: Dictionary,
        application: impl Application + 'static,
    ) -> Self {
        Self {
            pdos: [0, 1].map(|direction| dictionary.assigned(direction)),
            dictionary: Some(dictionary),
            ..Self::new(name, identity, &[], &[], application)
        }
    }

    /// A terminal with so many digital outputs and inputs, one bit each: bit 0 of byte 0 is the
    /// first.
    pub fn digital(outputs: u8, inputs: u8) -> Self {
        let bits = |count: u8| vec![1; count.into()];
        let identity = Self::identity(Self::DIGITAL);
        Self::new("DIGITAL", identity, &bits(outputs), &bits(inputs), Nothing)
    }

    /// A drive with a mailbox. Outputs: the control word (u16, byte 0), the target velocity (i32,
    /// byte 2, counts a second). Inputs: the status word (u16, byte 0), the position (i32, byte 2,
    /// counts), the velocity (i32, byte 6).
    ///
    /// Its mode of operation (0x6060, `i8`) is [`Servo::VELOCITY`] or [`Servo::POSITION`]. For the
    /// latter, PDO 0x1601 has the control word and the target position (0x607a, i32, counts). PDO
    /// 0x1a01 has the status word, the position and the mode (0x6061).
    pub fn servo() -> Self {
        let identity = Self::identity(Self::SERVO);
        let dictionary = Dictionary::new()
            .output(0x6040, 0, 16)
            .output(0x60ff, 0, 32)
            .output(0x607a, 0, 32)
            .input(0x6041, 0, 16)
            .input(0x6064, 0, 32)
            .input(0x606c, 0, 32)
            .input(0x6061, 0, 8)
            .pdo(0x1600, &[(0x6040, 0), (0x60ff, 0)])
            .pdo(0x1601, &[(0x6040, 0), (0x607a, 0)])
            .pdo(0x1a00, &[(0x6041, 0), (0x6064, 0), (0x606c, 0)])
            .pdo(0x1a01, &[(0x6041, 0), (0x6064, 0), (0x6061, 0)])
            .object(0x6060, 0, Servo::VELOCITY)
            .constant(0x1000, 0, 0x0002_0192_u32);
        Self::coe("SERVO", identity, dictionary, Servo::default())
    }

    fn identity(product: u32) -> Identity {
        Identity {
            vendor: Self::VENDOR,
            product,
            revision: 1,
            serial: 0,
        }
    }

    /// Gives it a distributed clock that is fast by `drift` parts per million. The first
    /// subdevice with a clock is the reference.
    #[must_use]
    pub fn with_clock(mut self, drift: f64) -> Self {
        self.drift = Some(drift);
        self
    }

    /// How long it stays operational without outputs: 100 ms if not stated, at most 6.5 s. Zero
    /// turns the watchdog off, for tests on the machine's clock: a busy computer is not to make it
    /// expire.
    #[must_use]
    pub fn with_watchdog(mut self, time: Duration) -> Self {
        self.watchdog = u16::try_from(time.as_micros() / 100).unwrap_or(u16::MAX);
        self
    }

    /// Another identity.
    #[must_use]
    pub fn with_identity(mut self, identity: Identity) -> Self {
        self.identity = identity;
        self
    }
}
