//! The keys of a blackboard, and where their cells are. Written by the program that makes the
//! segment, under the set-up lock, and never changed: so all others read it as plain memory.

use super::cell::Layout;
use crate::error::{TYPE_NAME, TypeInfo};
use crate::memory::{Memory, OFFSET};

/// The longest key.
pub(super) const KEY: usize = 64;
/// The bytes before the entries: their count.
const HEAD: usize = 64;

/// An entry as it lies in memory: integers and bytes without padding.
#[repr(C)]
#[derive(Clone, Copy)]
struct Line {
    key: [u8; KEY],
    type_name: [u8; TYPE_NAME],
    key_length: u32,
    type_length: u32,
    size: u64,
    align: u64,
    offset: u64,
    version: u64,
}

#[derive(Debug, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) key: String,
    pub(super) info: TypeInfo,
    pub(super) offset: usize,
}

#[derive(Debug, PartialEq, Eq)]
pub(super) struct Directory {
    pub(super) entries: Vec<Entry>,
}

impl Directory {
    /// Gives each key a cell. Returns the length of the segment too; `None`: it is longer than
    /// addresses reach.
    pub(super) fn plan(keys: impl Iterator<Item = (String, TypeInfo)>) -> Option<(Self, usize)> {
        let keys: Vec<_> = keys.collect();
        let lines = keys.len().checked_mul(size_of::<Line>())?;
        let lines = OFFSET.checked_add(HEAD)?.checked_add(lines)?;
        let mut end = lines.checked_next_multiple_of(OFFSET)?;
        let mut entries = Vec::with_capacity(keys.len());
        for (key, info) in keys {
            let layout = Layout::of(info.size.try_into().ok()?, info.align.try_into().ok()?)?;
            let offset = end.checked_next_multiple_of(layout.align)?;
            end = offset.checked_add(layout.length)?;
            entries.push(Entry { key, info, offset });
        }
        let fits = isize::try_from(end).is_ok();
        fits.then_some((Self { entries }, end))
    }

    pub(super) fn entry(&self, key: &str) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.key == key)
    }

    /// Writes the keys into a segment that was just made.
    ///
    /// # Safety
    ///
    /// This program has just made the segment and holds the set-up lock, no opening to write is
    /// counted yet, so that nobody reads the directory, and the mapping may be written.
    pub(super) unsafe fn write(&self, memory: &Memory) {
        let count = self.entries.len();
        // No larger than the plan, which was found.
        let length = count.saturating_mul(size_of::<Line>()).saturating_add(HEAD);
        let base = memory.at(OFFSET, length);
        // SAFETY: the place is in the mapping, may be written, and is aligned to a page. No other
        // thread or program reads it yet, as is demanded here.
        unsafe { base.cast::<u64>().write(count as u64) };
        for (index, entry) in self.entries.iter().enumerate() {
            let bytes = |text: &str| {
                text.bytes()
                    .chain(std::iter::repeat(0))
                    .take(TYPE_NAME)
                    .collect::<Vec<u8>>()
            };
            let mut line = Line {
                key: [0; KEY],
                type_name: [0; TYPE_NAME],
                key_length: entry.key.len() as u32,
                type_length: entry.info.name.len() as u32,
                size: entry.info.size,
                align: entry.info.align,
                offset: entry.offset as u64,
                version: u64::from(entry.info.version),
            };
            line.key.copy_from_slice(&bytes(&entry.key)[..KEY]);
            line.type_name.copy_from_slice(&bytes(&entry.info.name));
            // SAFETY: the line is within `length`, behind a head of 64 bytes, so in the mapping. A
            // page, the head and a line are multiples of its alignment. No other thread or program
            // reads it yet.
            unsafe { base.add(HEAD).cast::<Line>().add(index).write(line) };
        }
    }

    /// A program has opened the blackboard to write, so it is whole. In memory that is too short for
    /// one there are no keys.
    pub(super) fn read(memory: &Memory) -> Self {
        let Some(room) = memory.size().checked_sub(const { OFFSET + HEAD }) else {
            let entries = Vec::new();
            return Self { entries };
        };
        let base = memory.at(OFFSET, HEAD);
        // SAFETY: the place is in the mapping, and aligned to a page.
        let count = unsafe { base.cast::<u64>().read() };
        let most = room.checked_div(size_of::<Line>()).unwrap_or(0);
        let count = usize::try_from(count).unwrap_or(most).min(most);
        let entries = (0..count).map(|index| {
            // SAFETY: there is room for so many lines. Any bits are valid in them.
            let line = unsafe { base.add(HEAD).cast::<Line>().add(index).read() };
            let text = |bytes: &[u8], length: u32| {
                let length = (length as usize).min(bytes.len());
                String::from_utf8_lossy(&bytes[..length]).into_owned()
            };
            Entry {
                key: text(&line.key, line.key_length),
                info: TypeInfo {
                    name: text(&line.type_name, line.type_length),
                    size: line.size,
                    align: line.align,
                    version: line.version as u32,
                },
                offset: line.offset as usize,
            }
        });
        Self {
            entries: entries.collect(),
        }
    }
}
