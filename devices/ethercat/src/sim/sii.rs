//! What a subdevice states about itself: the content of its EEPROM.

use super::dictionary::Entry;
use super::subdevice::Identity;

/// Where outputs begin in the subdevice's memory.
pub(super) const OUTPUTS_AT: u16 = 0x1000;
/// Where inputs begin there.
pub(super) const INPUTS_AT: u16 = 0x1800;

/// Where the mailbox of requests begins, and that of answers.
pub(super) const REQUESTS_AT: u16 = 0x2000;
pub(super) const ANSWERS_AT: u16 = 0x2080;
/// The bytes of each.
pub(super) const MAILBOX_LENGTH: u16 = 128;
/// The protocol of the mailbox.
const COE: u32 = 1 << 2;
/// SDOs, PDOs can be assigned and configured.
const COE_DETAILS: u8 = 0b1101;

const STRINGS: u16 = 10;
const GENERAL: u16 = 30;
const FMMUS: u16 = 40;
const SYNC_MANAGERS: u16 = 41;
const INPUT_PDOS: u16 = 50;
const OUTPUT_PDOS: u16 = 51;
const END: u16 = 0xffff;

/// Where the categories begin.
const CATEGORIES: usize = 0x80;

/// A PDO's index, and what it has.
type Pdo = (u16, Vec<Entry>);

/// The content for a subdevice with these PDOs of outputs and inputs.
pub(super) fn content(
    name: &str,
    identity: Identity,
    [outputs, inputs]: &[Vec<Pdo>; 2],
    has_mailbox: bool,
) -> Vec<u8> {
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
    let room = u32::from(MAILBOX_LENGTH) << 16;
    if has_mailbox {
        put(0x18, room | u32::from(REQUESTS_AT));
        put(0x1a, room | u32::from(ANSWERS_AT));
        put(0x1c, COE);
    }

    let mut strings = vec![1, name.len() as u8];
    strings.extend(name.as_bytes());
    category(&mut bytes, STRINGS, &strings);

    let mut general = [0; 32];
    // The name is the first string, as order number and as name.
    (general[2], general[3]) = (1, 1);
    if has_mailbox {
        general[5] = COE_DETAILS;
    }
    category(&mut bytes, GENERAL, &general);

    let mut managers = Vec::new();
    let mut count = 0;
    let mut manager = |at: u16, length: u16, control: u8, usage: u8| {
        managers.extend(at.to_le_bytes());
        managers.extend(length.to_le_bytes());
        managers.extend([control, 0, 1, usage]);
        count += 1;
        count - 1
    };
    if has_mailbox {
        manager(REQUESTS_AT, MAILBOX_LENGTH, 0x26, 1);
        manager(ANSWERS_AT, MAILBOX_LENGTH, 0x22, 2);
    }
    let mut fmmus = Vec::new();
    let mut pdos = Vec::new();
    for (at, of, control, usage, fmmu, kind) in [
        (OUTPUTS_AT, outputs, 0x64, 3, 1, OUTPUT_PDOS),
        (INPUTS_AT, inputs, 0x20, 4, 2, INPUT_PDOS),
    ] {
        // With a mailbox the numbers of the sync managers are fixed.
        if of.is_empty() && !has_mailbox {
            continue;
        }
        let manager = manager(at, length(of) as u16, control, usage);
        fmmus.push(fmmu);
        pdos.push((kind, of.iter().flat_map(|it| pdo(it, manager)).collect()));
    }
    category(&mut bytes, FMMUS, &fmmus);
    category(&mut bytes, SYNC_MANAGERS, &managers);
    for (kind, content) in pdos {
        let content: Vec<u8> = content;
        category(&mut bytes, kind, &content);
    }
    bytes.extend(END.to_le_bytes());
    bytes.resize(bytes.len().max(2048), 0xff);
    bytes
}

/// The bytes that PDOs take.
pub(super) fn length(pdos: &[Pdo]) -> usize {
    let entries = pdos.iter().flat_map(|(_, entries)| entries);
    let bits = entries.map(|entry| usize::from(entry.bits));
    bits.sum::<usize>().div_ceil(8)
}

fn pdo((index, entries): &Pdo, manager: u8) -> Vec<u8> {
    let mut bytes = index.to_le_bytes().to_vec();
    bytes.extend([entries.len() as u8, manager, 0, 0, 0, 0]);
    for entry in entries {
        bytes.extend(entry.index.to_le_bytes());
        bytes.extend([entry.sub, 0, 0, entry.bits, 0, 0]);
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
