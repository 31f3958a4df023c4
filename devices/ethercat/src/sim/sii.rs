//! What a subdevice states about itself: the content of its EEPROM.

use super::subdevice::Identity;

/// Where outputs begin in the subdevice's memory.
pub(super) const OUTPUTS_AT: u16 = 0x1000;
/// Where inputs begin there.
pub(super) const INPUTS_AT: u16 = 0x1800;

const STRINGS: u16 = 10;
const GENERAL: u16 = 30;
const FMMUS: u16 = 40;
const SYNC_MANAGERS: u16 = 41;
const INPUT_PDOS: u16 = 50;
const OUTPUT_PDOS: u16 = 51;
const END: u16 = 0xffff;

/// Where the categories begin.
const CATEGORIES: usize = 0x80;

/// The content for a subdevice with process data of these lengths (bits of each entry).
pub(super) fn content(name: &str, identity: Identity, outputs: &[u8], inputs: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0; CATEGORIES];
    let mut put = |at: usize, value: u32| {
        bytes[2 * at..2 * at + 4].copy_from_slice(&value.to_le_bytes());
    };
    put(0x08, identity.vendor);
    put(0x0a, identity.product);
    put(0x0c, identity.revision);
    put(0x0e, identity.serial);
    // The size in kibit, less one; and the version.
    put(0x3e, 0x0001_000f);

    let mut strings = vec![1, name.len() as u8];
    strings.extend(name.as_bytes());
    category(&mut bytes, STRINGS, &strings);

    let mut general = [0; 32];
    // The name is the first string, as order number and as name.
    (general[2], general[3]) = (1, 1);
    category(&mut bytes, GENERAL, &general);

    let mut managers = Vec::new();
    let mut fmmus = Vec::new();
    let mut manager = |at: u16, bits: &[u8], control: u8, usage: u8, fmmu: u8| {
        if bits.is_empty() {
            return None;
        }
        managers.extend(at.to_le_bytes());
        managers.extend((length(bits) as u16).to_le_bytes());
        managers.extend([control, 0, 1, usage]);
        fmmus.push(fmmu);
        Some(fmmus.len() as u8 - 1)
    };
    let output_manager = manager(OUTPUTS_AT, outputs, 0x64, 3, 1);
    let input_manager = manager(INPUTS_AT, inputs, 0x20, 4, 2);
    category(&mut bytes, FMMUS, &fmmus);
    category(&mut bytes, SYNC_MANAGERS, &managers);
    for (kind, index, manager, bits) in [
        (INPUT_PDOS, 0x1a00, input_manager, inputs),
        (OUTPUT_PDOS, 0x1600, output_manager, outputs),
    ] {
        if let Some(manager) = manager {
            category(&mut bytes, kind, &pdo(index, manager, bits));
        }
    }
    bytes.extend(END.to_le_bytes());
    bytes.resize(bytes.len().max(2048), 0xff);
    bytes
}

/// The bytes that entries of these lengths (bits) take.
pub(super) fn length(bits: &[u8]) -> usize {
    bits.iter()
        .map(|bits| usize::from(*bits))
        .sum::<usize>()
        .div_ceil(8)
}

fn pdo(index: u16, manager: u8, bits: &[u8]) -> Vec<u8> {
    let mut bytes = index.to_le_bytes().to_vec();
    bytes.extend([bits.len() as u8, manager, 0, 0, 0, 0]);
    for (number, bits) in (1..=u8::MAX).zip(bits) {
        bytes.extend((0x6000_u16 + index % 0x1000).to_le_bytes());
        bytes.extend([number, 0, 0, *bits, 0, 0]);
    }
    bytes
}

fn category(to: &mut Vec<u8>, kind: u16, content: &[u8]) {
    let words = content.len().div_ceil(2);
    to.extend(kind.to_le_bytes());
    to.extend((words as u16).to_le_bytes());
    let end = to.len() + 2 * words;
    to.extend(content);
    to.resize(end, 0);
}
