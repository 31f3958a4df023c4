//! The objects of a simulated subdevice, and the process data that they make up.

use super::abort::{self, Abort};
use crate::SdoValue;
use std::ops::RangeInclusive;

/// The PDOs of outputs, and of inputs.
const PDOS: [RangeInclusive<u16>; 2] = [0x1600..=0x17ff, 0x1a00..=0x1bff];
/// What is assigned to the sync managers of outputs, and of inputs.
const ASSIGNED: [u16; 2] = [0x1c12, 0x1c13];
/// The most entries of a list.
const ENTRIES: usize = 16;
/// The most bits of outputs, or of inputs.
const MOST_BITS: usize = 8 * 2048;

/// The objects of a subdevice with a mailbox: see [`SubDevice::coe`](super::SubDevice::coe).
///
/// Objects that an [`Application`](super::Application) exchanges are named by
/// [`output`](Self::output) and [`input`](Self::input); [`pdo`](Self::pdo) has some of them. The
/// first PDO of each direction is assigned (0x1c12, 0x1c13). The bus may assign others and change
/// what they have, in PRE-OP, after it has set sub-index 0 to 0.
///
/// ```
/// use luna_ethercat::sim::{Dictionary, Identity, Network, Nothing, SubDevice};
///
/// let dictionary = Dictionary::new()
///     .output(0x7000, 1, 16)
///     .input(0x6000, 1, 16)
///     .input(0x6000, 2, 8)
///     .pdo(0x1600, &[(0x7000, 1)])
///     .pdo(0x1a00, &[(0x6000, 1)])
///     .pdo(0x1a01, &[(0x6000, 1), (0x6000, 2)])
///     .object(0x8000, 1, 100_u16)
///     .constant(0x1000, 0, 0x1389_u32);
/// let network = Network::new();
/// network.add(SubDevice::coe("SENSOR", Identity::default(), dictionary, Nothing));
/// assert_eq!(network.object(0, 0x8000, 1), Some(100_u16.into()));
/// assert_eq!(network.inputs(0).len(), 2);
/// ```
#[derive(Debug, Clone)]
pub struct Dictionary {
    objects: Vec<Object>,
    /// What the application has, in its order.
    signals: [Vec<Entry>; 2],
    lists: Vec<List>,
}

#[derive(Debug, Clone)]
struct Object {
    index: u16,
    sub: u8,
    value: SdoValue,
    is_writable: bool,
}

/// A part of process data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) index: u16,
    pub(super) sub: u8,
    pub(super) bits: u8,
}

impl Entry {
    fn number(self) -> u32 {
        u32::from(self.index) << 16 | u32::from(self.sub) << 8 | u32::from(self.bits)
    }

    fn of(number: u32) -> Self {
        let [bits, sub, low, high] = number.to_le_bytes();
        Self {
            index: u16::from_le_bytes([low, high]),
            sub,
            bits,
        }
    }

    /// It has no object: it only takes room.
    fn is_gap(self) -> bool {
        (self.index, self.sub) == (0, 0)
    }
}

/// What a PDO has, or which PDOs are assigned.
#[derive(Debug, Clone)]
struct List {
    index: u16,
    count: u8,
    entries: [u32; ENTRIES],
}

impl List {
    fn used(&self) -> &[u32] {
        &self.entries[..self.count.into()]
    }

    /// As which type an entry is read and written.
    fn typed(&self, entry: u32) -> SdoValue {
        match ASSIGNED.contains(&self.index) {
            true => SdoValue::U16(entry as u16),
            false => SdoValue::U32(entry),
        }
    }
}

/// Where a signal is among those of the application, and in process data (bits).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) signal: usize,
    pub(super) data: usize,
    pub(super) bits: usize,
}

impl Default for Dictionary {
    fn default() -> Self {
        Self {
            objects: Vec::new(),
            signals: [Vec::new(), Vec::new()],
            lists: ASSIGNED.map(|index| list(index, &[])).into(),
        }
    }
}

impl Dictionary {
    /// Without objects, but for the lists of PDOs that are assigned: none.
    pub fn new() -> Self {
        Self::default()
    }

    /// An object that can be read and written, with its value at first.
    #[must_use]
    pub fn object(self, index: u16, sub: u8, value: impl Into<SdoValue>) -> Self {
        self.with(index, sub, value.into(), true)
    }

    /// An object that can only be read.
    #[must_use]
    pub fn constant(self, index: u16, sub: u8, value: impl Into<SdoValue>) -> Self {
        self.with(index, sub, value.into(), false)
    }

    fn with(mut self, index: u16, sub: u8, value: SdoValue, is_writable: bool) -> Self {
        self.objects.push(Object {
            index,
            sub,
            value,
            is_writable,
        });
        self
    }

    /// The next output of the application: an object of `bits` bits, which a PDO may have.
    #[must_use]
    pub fn output(mut self, index: u16, sub: u8, bits: u8) -> Self {
        self.signals[0].push(Entry { index, sub, bits });
        self
    }

    /// The next input of the application.
    #[must_use]
    pub fn input(mut self, index: u16, sub: u8, bits: u8) -> Self {
        self.signals[1].push(Entry { index, sub, bits });
        self
    }

    /// A PDO with these objects (index and sub-index): of outputs if `index` is 0x1600 to 0x17ff,
    /// of inputs if it is 0x1a00 to 0x1bff. The first one of each is assigned.
    ///
    /// # Panics
    ///
    /// `index` is not that of a PDO; an object is none of [`output`](Self::output) or
    /// [`input`](Self::input) before; it has more than 16 objects.
    #[must_use]
    #[track_caller]
    pub fn pdo(mut self, index: u16, objects: &[(u16, u8)]) -> Self {
        let direction = direction(index).expect("the index of a PDO");
        let signals = &self.signals[direction];
        let entries = objects.iter().map(|object| {
            let is_it = |it: &&Entry| (it.index, it.sub) == *object;
            let signal = signals.iter().find(is_it);
            signal.expect("an object of this direction").number()
        });
        let pdo = list(index, &entries.collect::<Vec<_>>());
        self.lists.push(pdo);
        if let [outputs, inputs, ..] = &mut self.lists[..] {
            let assigned = if direction == 0 { outputs } else { inputs };
            if assigned.count == 0 {
                *assigned = list(ASSIGNED[direction], &[index.into()]);
            }
        }
        self
    }

    /// The PDOs that are assigned, with their entries.
    pub(super) fn assigned(&self, direction: usize) -> Vec<(u16, Vec<Entry>)> {
        let assigned = self.list(ASSIGNED[direction]);
        let pdos = assigned.map_or(&[][..], List::used).iter();
        pdos.filter_map(|index| self.list(*index as u16))
            .map(|pdo| {
                let entries = pdo.used().iter().map(|entry| Entry::of(*entry));
                (pdo.index, entries.collect())
            })
            .collect()
    }

    /// Where the signals are in process data, and its length (bits).
    pub(super) fn layout(&self, direction: usize) -> (Vec<Place>, usize) {
        let mut places = Vec::new();
        let mut data = 0;
        for entry in self.assigned(direction).into_iter().flat_map(|pdo| pdo.1) {
            let bits = usize::from(entry.bits);
            if let Some(signal) = self.signal(direction, entry.index, entry.sub) {
                let signal = signal.0;
                places.push(Place { signal, data, bits });
            }
            data += bits;
        }
        (places, data)
    }

    /// How many bits the application has.
    pub(super) fn signal_bits(&self, direction: usize) -> usize {
        let bits = self.signals[direction].iter().map(|it| it.bits);
        bits.map(usize::from).sum()
    }

    /// A signal's first bit, and its number of bits.
    pub(super) fn signal(&self, direction: usize, index: u16, sub: u8) -> Option<(usize, usize)> {
        let mut from = 0;
        for signal in &self.signals[direction] {
            if (signal.index, signal.sub) == (index, sub) {
                return Some((from, signal.bits.into()));
            }
            from += usize::from(signal.bits);
        }
        None
    }

    fn list(&self, index: u16) -> Option<&List> {
        self.lists.iter().find(|list| list.index == index)
    }

    /// What is there, but for signals.
    pub(super) fn read(&self, index: u16, sub: u8) -> Result<SdoValue, Abort> {
        if let Some(list) = self.list(index) {
            return match (sub, list.used().get(usize::from(sub).wrapping_sub(1))) {
                (0, _) => Ok(SdoValue::U8(list.count)),
                (_, Some(entry)) => Ok(list.typed(*entry)),
                _ => Err(abort::NO_SUB_INDEX),
            };
        }
        let object = self
            .objects
            .iter()
            .find(|it| (it.index, it.sub) == (index, sub));
        object.map(|it| it.value).ok_or_else(|| self.unknown(index))
    }

    fn unknown(&self, index: u16) -> Abort {
        let signals = self.signals.iter().flatten().map(|it| it.index);
        let all = self.objects.iter().map(|it| it.index).chain(signals);
        match all.into_iter().any(|it| it == index) {
            true => abort::NO_SUB_INDEX,
            false => abort::NO_OBJECT,
        }
    }

    /// The value that `bytes` are, for an object that can be written.
    pub(super) fn parse(&self, index: u16, sub: u8, bytes: &[u8]) -> Result<SdoValue, Abort> {
        let kind = match self.list(index) {
            Some(_) if usize::from(sub) > ENTRIES => return Err(abort::NO_SUB_INDEX),
            Some(_) if sub == 0 => SdoValue::U8(0),
            Some(list) => list.typed(0),
            None => {
                let is_it = |it: &&Object| (it.index, it.sub) == (index, sub);
                let object = self.objects.iter().find(is_it);
                let object = object.ok_or_else(|| self.unknown(index))?;
                if !object.is_writable {
                    return Err(abort::READ_ONLY);
                }
                object.value
            }
        };
        match bytes.len() {
            length if length > kind.size() => Err(abort::TOO_LONG),
            length if length < kind.size() => Err(abort::TOO_SHORT),
            _ => {
                let mut all = [0; 4];
                all[..bytes.len()].copy_from_slice(bytes);
                Ok(kind.with(all))
            }
        }
    }

    /// Writes what [`parse`](Self::parse) has returned. Returns whether process data may have
    /// another layout.
    pub(super) fn write(&mut self, index: u16, sub: u8, value: SdoValue) -> Result<bool, Abort> {
        let Some(at) = self.lists.iter().position(|list| list.index == index) else {
            let is_it = |it: &&mut Object| (it.index, it.sub) == (index, sub);
            if let Some(object) = self.objects.iter_mut().find(is_it) {
                object.value = value;
            }
            return Ok(false);
        };
        let number = u32::from_le_bytes(value.bytes());
        let Some(entry) = usize::from(sub).checked_sub(1) else {
            return self.set_count(at, number);
        };
        // A list in use is not changed.
        if self.lists[at].count > 0 {
            return Err(abort::NOT_EMPTIED);
        }
        self.check(index, number)?;
        self.lists[at].entries[entry] = number;
        Ok(false)
    }

    fn set_count(&mut self, at: usize, count: u32) -> Result<bool, Abort> {
        let before = self.lists[at].count;
        if count as usize > ENTRIES {
            return Err(abort::VALUE);
        }
        self.lists[at].count = count as u8;
        let index = self.lists[at].index;
        let mut used = self.lists[at].used().iter();
        let valid = used.try_for_each(|entry| self.check(index, *entry));
        let is_long = (0..2).any(|direction| self.layout(direction).1 > MOST_BITS);
        let outcome = match valid {
            Ok(()) if is_long => Err(abort::TOO_MUCH_DATA),
            other => other,
        };
        match outcome {
            Ok(()) => Ok(true),
            Err(abort) => {
                self.lists[at].count = before;
                Err(abort)
            }
        }
    }

    /// Whether a list may have this entry.
    fn check(&self, index: u16, number: u32) -> Result<(), Abort> {
        if let Some(assigned) = ASSIGNED.iter().position(|it| *it == index) {
            let pdo = number as u16;
            let is_one = direction(pdo) == Some(assigned) && self.list(pdo).is_some();
            return if is_one { Ok(()) } else { Err(abort::VALUE) };
        }
        let entry = Entry::of(number);
        let is_signal = |direction: usize| self.signals[direction].contains(&entry);
        match direction(index).is_some_and(is_signal) || entry.is_gap() {
            true => Ok(()),
            false => Err(abort::NOT_MAPPABLE),
        }
    }
}

/// Whether it is a PDO of outputs (0) or inputs (1).
fn direction(index: u16) -> Option<usize> {
    PDOS.iter().position(|pdos| pdos.contains(&index))
}

#[track_caller]
fn list(index: u16, values: &[u32]) -> List {
    assert!(values.len() <= ENTRIES, "a list has at most 16 entries");
    let mut entries = [0; ENTRIES];
    entries[..values.len()].copy_from_slice(values);
    List {
        index,
        count: values.len() as u8,
        entries,
    }
}

/// Whether the object decides about the layout of process data.
pub(super) fn is_mapping(index: u16) -> bool {
    direction(index).is_some() || ASSIGNED.contains(&index)
}
