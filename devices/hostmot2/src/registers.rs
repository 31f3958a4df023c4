//! HostMot2's registers and their bits, from Mesa's register map.
//!
//! The card's [description](crate::idrom) has the addresses of modules (encoders, PWM, ports, the
//! watchdog); these are the registers' numbers within a module.

/// Reads [`COOKIE`].
pub const CONFIG_COOKIE: u16 = 0x0100;
/// What the register at [`CONFIG_COOKIE`] reads.
pub const COOKIE: u32 = 0x55AA_CAFE;
/// Eight characters: `HOSTMOT2`.
pub const CONFIG_NAME: u16 = 0x0104;
/// Where the IDROM begins.
pub const IDROM_OFFSET: u16 = 0x010C;

/// The watchdog's registers, by their number in the module.
pub mod watchdog {
    /// The time: it expires after `(value + 1) / ClockLow`, and is off with the highest bit set.
    pub const TIME: u8 = 0;
    /// Bit 0: it has expired.
    pub const STATUS: u8 = 1;
    /// The register that restarts it.
    pub const COOKIE: u8 = 2;
    /// The value that restarts it: 0x5A in the highest byte.
    pub const RESTART: u32 = 0x5A00_0000;
    /// The time's bit that switches it off.
    pub const OFF: u32 = 1 << 31;
}

/// The ports' registers, by their number in the module; one instance for each port.
pub mod port {
    /// Writes the output latch, reads the pins.
    pub const DATA: u8 = 0;
    /// 1: the pin is an output. The watchdog clears it.
    pub const DIRECTION: u8 = 1;
    /// 1: the pin is driven by its module and not by the latch.
    pub const ALTERNATE: u8 = 2;
    /// 1: the pin is an open-drain output, whatever its direction. The watchdog clears it.
    pub const OPEN_DRAIN: u8 = 3;
    /// 1: the output is inverted.
    pub const INVERT: u8 = 4;
}

/// The encoders' registers, by their number in the module.
pub mod encoder {
    /// Bits 15-0 the count, 31-16 the time stamp of its last change. One each. A write clears the
    /// count.
    pub const COUNT: u8 = 0;
    /// Bits 31-16 the count at the index, 15-0 the control bits. One each.
    pub const CONTROL: u8 = 1;
    /// The time stamps' divider: they count at `ClockLow / (value + 2)`.
    pub const STAMP_DIVIDER: u8 = 2;
    /// The time stamps' counter, 16 bits.
    pub const STAMP: u8 = 3;
    /// The input filter's rate.
    pub const FILTER: u8 = 4;

    /// A and B have changed at once: counts were lost. Stays set until 0 is written.
    pub const QUADRATURE_ERROR: u16 = 1 << 15;
    /// The filter takes 15 clocks instead of 3.
    pub const SLOW_FILTER: u16 = 1 << 11;
    /// Clear and latch happen once.
    pub const JUST_ONCE: u16 = 1 << 6;
    /// Latch the count at the index. With [`JUST_ONCE`] the card then clears this bit.
    pub const LATCH_ON_INDEX: u16 = 1 << 4;
    /// The index is active high.
    pub const INDEX_HIGH: u16 = 1 << 3;
}

/// The PWM generators' registers, by their number in the module.
pub mod pwm {
    /// Bits 27-16 the value, bit 31 the direction. One each.
    pub const VALUE: u8 = 0;
    /// The mode. One each.
    pub const MODE: u8 = 1;
    /// The common rate: the generators' clock is `ClockHigh * value / 65536`.
    pub const RATE: u8 = 2;
    /// The rate of those in PDM mode.
    pub const PDM_RATE: u8 = 3;
    /// A bit for each generator: its enable output.
    pub const ENABLE: u8 = 4;

    /// In the mode: 12 bits.
    pub const BITS_12: u32 = 3;
    /// In the mode: symmetrical.
    pub const SYMMETRICAL: u32 = 1 << 2;
    /// In the mode: a new value waits for the begin of a PWM cycle.
    pub const DOUBLE_BUFFERED: u32 = 1 << 5;
    /// In the value: the direction output.
    pub const DIRECTION: u32 = 1 << 31;
}

/// The scratch registers, in the space [`Timers`](crate::lbp16::Space::Timers): eight of 16 bits,
/// for any use.
pub mod scratch {
    /// Each request leaves its number here (two words), and its answer contains it.
    pub const READ_SEQUENCE: u16 = 0x10;
    /// Here each write packet leaves its number (two words).
    pub const WRITE_SEQUENCE: u16 = 0x14;
    /// Only the start packet leaves its number here (two words): a restarted card has lost it.
    pub const SESSION: u16 = 0x18;
}

/// The contents of the space [`Board`](crate::lbp16::Space::Board).
pub mod board {
    /// Up to 16 characters.
    pub const NAME: u16 = 0x00;
    /// The protocol's version.
    pub const LBP16_VERSION: u16 = 0x10;
    /// The version of the firmware that speaks it.
    pub const FIRMWARE_VERSION: u16 = 0x12;
    /// How the jumpers are set.
    pub const JUMPERS: u16 = 0x14;
}
