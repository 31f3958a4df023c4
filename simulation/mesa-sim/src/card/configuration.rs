//! The card's modules and pins, as its IDROM describes them.

use hostmot2::registers;

/// How many encoders it has.
pub const ENCODERS: usize = 4;
/// How many PWM generators.
pub const PWMS: usize = 4;
/// How many pins.
pub const PINS: usize = 34;

pub(super) const PORTS: usize = 2;
pub(super) const PORT_WIDTH: usize = 17;
pub(super) const CLOCK_LOW: u32 = 100_000_000;
const CLOCK_HIGH: u32 = 200_000_000;

const IDROM_AT: u32 = 0x0400;
const MODULES_AT: u32 = 64;
const PINS_AT: u32 = 448;

/// The pins of each PWM generator: output, direction, enable.
pub(super) const PWM_PINS: [[usize; 3]; PWMS] =
    [[3, 4, 5], [9, 10, 11], [20, 21, 22], [26, 27, 28]];
/// The pins of each encoder: A, B, index.
const ENCODER_PINS: [[usize; 3]; ENCODERS] = [[0, 1, 2], [6, 7, 8], [17, 18, 19], [23, 24, 25]];

const LOW: u32 = 1;
const HIGH: u32 = 2;

/// Tag, version, clock, units, address, registers, and which of them each unit has.
const MODULES: [[u32; 7]; 5] = [
    [0x80, 0, LOW, 1, 0x0200, 1, 0],
    [0x02, 0, LOW, 1, 0x0C00, 3, 0],
    [0x03, 0, LOW, PORTS as u32, 0x1000, 5, 0x1F],
    [0x04, 2, LOW, ENCODERS as u32, 0x3000, 5, 0x03],
    [0x06, 0, HIGH, PWMS as u32, 0x4000, 5, 0x03],
];

/// The registers at 0x0100: the card's identity.
pub(super) fn identity(at: u16) -> u32 {
    match at {
        registers::CONFIG_COOKIE => registers::COOKIE,
        0x0104 => u32::from_le_bytes(*b"HOST"),
        0x0108 => u32::from_le_bytes(*b"MOT2"),
        registers::IDROM_OFFSET => IDROM_AT,
        _ => 0,
    }
}

pub(super) fn idrom() -> Box<[u32]> {
    let mut words = vec![0; 256];
    let head = [
        3, // its type
        MODULES_AT,
        PINS_AT,
        u32::from_le_bytes(*b"MESA"),
        u32::from_le_bytes(*b"7I92"),
        9,   // thousands of cells
        144, // the FPGA's pins
        PORTS as u32,
        PINS as u32,
        PORT_WIDTH as u32,
        CLOCK_LOW,
        CLOCK_HIGH,
        4, // from unit to unit
        64,
        256, // from register to register
        256,
    ];
    words[..head.len()].copy_from_slice(&head);
    for (number, module) in MODULES.into_iter().enumerate() {
        let [tag, version, clock, units, place, registers, multiple] = module;
        let at = MODULES_AT as usize / 4 + 3 * number;
        words[at] = tag | version << 8 | clock << 16 | units << 24;
        words[at + 1] = place | registers << 16;
        words[at + 2] = multiple;
    }
    let pins = &mut words[PINS_AT as usize / 4..][..PINS];
    // All can be general-purpose ones.
    pins.fill(0x03 << 24);
    for (unit, own) in ENCODER_PINS.into_iter().enumerate() {
        for (role, pin) in own.into_iter().enumerate() {
            pins[pin] |= (role as u32 + 1) | 0x04 << 8 | (unit as u32) << 16;
        }
    }
    for (unit, own) in PWM_PINS.into_iter().enumerate() {
        for (role, pin) in own.into_iter().enumerate() {
            pins[pin] |= (role as u32 + 0x81) | 0x06 << 8 | (unit as u32) << 16;
        }
    }
    words.into()
}
