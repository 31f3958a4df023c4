//! The object dictionary of a simulated node.

use crate::canopen::{AbortCode, NodeId, Object};
use std::collections::BTreeMap;

/// How an object can be accessed by SDO.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Access {
    /// It can only be read.
    ReadOnly,
    /// It can only be written.
    WriteOnly,
    /// Both.
    ReadWrite,
}

#[derive(Debug, Clone)]
struct Entry {
    bytes: Vec<u8>,
    access: Access,
    /// Whether it takes values of any length.
    is_variable: bool,
}

/// Objects by index and sub-index.
#[derive(Debug, Clone, Default)]
pub(super) struct Dictionary(BTreeMap<Object, Entry>);

/// The number of PDOs of each direction.
pub(super) const PDOS: u16 = 4;

/// In the identifier of a PDO: it is off.
const OFF: u32 = 1 << 31;

/// In the identifier of a PDO that the node transmits: it is not to be asked for by remote frames,
/// which this node does not answer.
const NO_REMOTE: u32 = 1 << 30;

/// A PDO as the dictionary has it.
pub(super) struct Pdo {
    pub(super) id: u16,
    pub(super) transmission: u8,
    pub(super) objects: Vec<(Object, usize)>,
}

impl Dictionary {
    /// What each node has.
    pub(super) fn new(node: NodeId) -> Self {
        let mut own = Self::default();
        own.put(
            Object::new(0x1000, 0),
            &0_u32.to_le_bytes(),
            Access::ReadOnly,
        );
        own.put(Object::new(0x1001, 0), &[0], Access::ReadOnly);
        own.put(Object::new(0x1017, 0), &[0, 0], Access::ReadWrite);
        for number in 0..PDOS {
            let counted = number as u8 + 1;
            for (base, id) in [(0x1400, node.rpdo(counted)), (0x1800, node.tpdo(counted))] {
                // Off until it is set up; a TPDO answers no remote frames.
                let flags = match base {
                    0x1800 => OFF | NO_REMOTE,
                    _ => OFF,
                };
                let id = flags | u32::from(id.unwrap_or_default());
                let communication = base + number;
                own.put(Object::new(communication, 0), &[2], Access::ReadOnly);
                own.put(
                    Object::new(communication, 1),
                    &id.to_le_bytes(),
                    Access::ReadWrite,
                );
                own.put(Object::new(communication, 2), &[255], Access::ReadWrite);
                let mapping = communication + 0x200;
                own.put(Object::new(mapping, 0), &[0], Access::ReadWrite);
                for sub in 1..=8 {
                    own.put(Object::new(mapping, sub), &[0; 4], Access::ReadWrite);
                }
            }
        }
        own
    }

    pub(super) fn put(&mut self, object: Object, bytes: &[u8], access: Access) {
        let entry = Entry {
            bytes: bytes.to_vec(),
            access,
            is_variable: false,
        };
        self.0.insert(object, entry);
    }

    pub(super) fn put_variable(&mut self, object: Object, bytes: &[u8], access: Access) {
        self.put(object, bytes, access);
        if let Some(entry) = self.0.get_mut(&object) {
            entry.is_variable = true;
        }
    }

    /// Sets the objects of the communication profile, 1000h to 1FFFh, to what they begin with.
    pub(super) fn reset_communication(&mut self, initial: &Dictionary) {
        let own = Object::new(0x1000, 0)..Object::new(0x2000, 0);
        for (object, entry) in initial.0.range(own) {
            self.0.insert(*object, entry.clone());
        }
    }

    fn missing(&self, object: Object) -> AbortCode {
        match self.0.keys().any(|other| other.index == object.index) {
            true => AbortCode::NO_SUBINDEX,
            false => AbortCode::NO_OBJECT,
        }
    }

    /// As an SDO client reads it.
    pub(super) fn upload(&self, object: Object) -> Result<&[u8], AbortCode> {
        match self.0.get(&object) {
            Some(entry) if entry.access == Access::WriteOnly => Err(AbortCode::WRITE_ONLY),
            Some(entry) => Ok(&entry.bytes),
            None => Err(self.missing(object)),
        }
    }

    /// Whether an SDO client may write it.
    pub(super) fn may_download(&self, object: Object) -> Result<(), AbortCode> {
        match self.0.get(&object) {
            Some(entry) if entry.access == Access::ReadOnly => Err(AbortCode::READ_ONLY),
            Some(_) => Ok(()),
            None => Err(self.missing(object)),
        }
    }

    /// As an SDO client writes it.
    pub(super) fn download(&mut self, object: Object, bytes: &[u8]) -> Result<(), AbortCode> {
        self.may_download(object)?;
        match (object.index, object.sub, bytes) {
            (0x1800..0x1804, 1, [.., flags]) if u32::from(*flags) << 24 & NO_REMOTE == 0 => {
                return Err(AbortCode::INVALID_VALUE);
            }
            // A mapping is changed while its PDO is off.
            (0x1600..0x1604 | 0x1A00..0x1A04, ..) if self.is_on(object.index - 0x200) => {
                return Err(AbortCode::UNSUPPORTED_ACCESS);
            }
            (0x1600..0x1604 | 0x1A00..0x1A04, 0, [count]) => {
                self.check_mapping(object.index, *count)?;
            }
            _ => {}
        }
        if self.set(object, bytes) {
            return Ok(());
        }
        Err(AbortCode::WRONG_LENGTH)
    }

    /// How many bytes an object has, if it has the same number always.
    pub(super) fn fixed_len(&self, object: Object) -> Option<usize> {
        let entry = self.0.get(&object)?;
        (!entry.is_variable).then_some(entry.bytes.len())
    }

    /// The bytes of an object, whatever its access.
    pub(super) fn get(&self, object: Object) -> Option<&[u8]> {
        self.0.get(&object).map(|entry| &*entry.bytes)
    }

    /// Sets the bytes of an object, whatever its access; false if it has another length, or is
    /// none.
    pub(super) fn set(&mut self, object: Object, bytes: &[u8]) -> bool {
        match self.0.get_mut(&object) {
            Some(entry) if entry.is_variable || entry.bytes.len() == bytes.len() => {
                entry.bytes = bytes.to_vec();
                true
            }
            _ => false,
        }
    }

    pub(super) fn number(&self, object: Object) -> u32 {
        let bytes = self.get(object).unwrap_or_default();
        bytes
            .iter()
            .rev()
            .fold(0, |all, byte| all << 8 | u32::from(*byte))
    }

    fn mapped(&self, mapping: u16, count: u8) -> Vec<(Object, usize)> {
        let entries = (1..=count).map(|sub| self.number(Object::new(mapping, sub)));
        entries
            .map(|entry| {
                let object = Object::new((entry >> 16) as u16, (entry >> 8) as u8);
                (object, (entry & 0xFF) as usize / 8)
            })
            .collect()
    }

    fn check_mapping(&self, mapping: u16, count: u8) -> Result<(), AbortCode> {
        if count > 8 {
            return Err(AbortCode::PDO_TOO_LONG);
        }
        let objects = self.mapped(mapping, count);
        if objects.iter().map(|(_, len)| len).sum::<usize>() > 8 {
            return Err(AbortCode::PDO_TOO_LONG);
        }
        let fits = |(object, len): &(Object, usize)| {
            self.get(*object).is_some_and(|bytes| bytes.len() == *len)
        };
        match objects.iter().all(fits) {
            true => Ok(()),
            false => Err(AbortCode::NOT_MAPPABLE),
        }
    }

    fn is_on(&self, communication: u16) -> bool {
        self.number(Object::new(communication, 1)) & OFF == 0
    }

    /// The PDO with this number, counted from 0, if it is on.
    pub(super) fn pdo(&self, base: u16, number: u16) -> Option<Pdo> {
        let id = self.number(Object::new(base + number, 1));
        let mapping = base + 0x200 + number;
        let count = self.number(Object::new(mapping, 0)) as u8;
        self.is_on(base + number).then(|| Pdo {
            id: (id & 0x7FF) as u16,
            transmission: self.number(Object::new(base + number, 2)) as u8,
            objects: self.mapped(mapping, count.min(8)),
        })
    }
}
