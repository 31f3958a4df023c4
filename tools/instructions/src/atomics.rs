//! The atomic read-modify-writes among the executed instructions, and their places in the source.
//!
//! On x86-64 these are the instructions with a `lock` prefix, and `xchg` with memory, which needs
//! none (a sequentially consistent store is one). `mfence`, which costs as much, is counted with
//! them.

use crate::callgrind::Counted;
use crate::profile::CodeAddress;
use addr2line::Context;
use addr2line::gimli::{Dwarf, EndianSlice, LittleEndian, SectionId};
use iced_x86::{Decoder, DecoderOptions, Instruction, Mnemonic, OpKind};
use object::{Object, ObjectSection, ObjectSegment};
use std::collections::HashMap;
use std::convert::Infallible;
use std::fs;
use std::ops::Range;
use std::path::Path;

/// The longest instruction there is, in bytes.
const LONGEST: usize = 15;

/// An atomic instruction of an operation.
#[derive(Debug)]
pub(crate) struct Atomic {
    /// How often it is executed an operation.
    pub(crate) times: f64,
    /// What it is called in assembler.
    pub(crate) mnemonic: String,
    /// The functions around it, the innermost first, each with its file and line; without those of
    /// other crates.
    pub(crate) frames: Vec<String>,
}

/// The files that instructions are in, read once each.
#[derive(Default)]
pub(crate) struct Objects {
    known: HashMap<String, File>,
}

struct File {
    /// Its loaded segments, by the addresses in its own tables.
    segments: Vec<(Range<u64>, &'static [u8])>,
    /// Its debug information, if there is any.
    lines: Option<Context<EndianSlice<'static, LittleEndian>>>,
}

impl Objects {
    /// The atomic instructions among those that were counted, the most frequent first.
    ///
    /// # Errors
    ///
    /// A file cannot be read, or has no instruction at such an address.
    pub(crate) fn atomics(&mut self, counted: &Counted) -> Result<Vec<Atomic>, String> {
        let mut found: Vec<Atomic> = Vec::new();
        for (place, share) in &counted.places {
            let file = self.file(&place.object)?;
            let instruction = file.instruction(place).ok_or_else(|| {
                format!(
                    "no instruction of `{}` at {:#x} of {}",
                    share.function, place.address, place.object
                )
            })?;
            if !is_atomic(&instruction) {
                continue;
            }
            let mnemonic = name(&instruction);
            let frames = file.frames(place, &share.function);
            // Code that was laid out twice comes from one place.
            match found
                .iter_mut()
                .find(|known| known.mnemonic == mnemonic && known.frames == frames)
            {
                Some(known) => known.times += share.times,
                None => found.push(Atomic {
                    times: share.times,
                    mnemonic,
                    frames,
                }),
            }
        }
        found.sort_by(|a, b| b.times.total_cmp(&a.times));
        Ok(found)
    }

    fn file(&mut self, path: &str) -> Result<&File, String> {
        if !self.known.contains_key(path) {
            let file = File::read(path).map_err(|error| format!("{path}: {error}"))?;
            self.known.insert(path.to_owned(), file);
        }
        Ok(&self.known[path])
    }
}

impl File {
    fn read(path: &str) -> Result<File, String> {
        // For as long as the program runs, which is not long.
        let bytes: &'static [u8] = fs::read(path).map_err(|error| error.to_string())?.leak();
        let parsed = object::File::parse(bytes).map_err(|error| error.to_string())?;
        let mut segments = Vec::new();
        for segment in parsed.segments() {
            let data = segment.data().map_err(|error| error.to_string())?;
            let begin = segment.address();
            segments.push((begin..begin + data.len() as u64, data));
        }
        Ok(File {
            segments,
            lines: lines(&parsed),
        })
    }

    fn instruction(&self, place: &CodeAddress) -> Option<Instruction> {
        let (range, bytes) = self
            .segments
            .iter()
            .find(|(range, _)| range.contains(&place.address))?;
        let rest = &bytes[(place.address - range.start) as usize..];
        let instruction = decode(&rest[..rest.len().min(LONGEST)], place.address);
        (!instruction.is_invalid()).then_some(instruction)
    }

    /// The functions of this workspace around an instruction; only `function` if there are none.
    fn frames(&self, place: &CodeAddress, function: &str) -> Vec<String> {
        let mut said = Vec::new();
        if let Some(lines) = &self.lines
            && let Ok(mut frames) = lines.find_frames(place.address).skip_all_loads()
        {
            while let Ok(Some(frame)) = frames.next() {
                let Some(location) = frame.location else {
                    continue;
                };
                let file = location.file.unwrap_or("");
                let Some(file) = in_workspace(file) else {
                    continue;
                };
                let name = frame
                    .function
                    .as_ref()
                    .and_then(|name| name.demangle().ok().map(|name| name.into_owned()))
                    .unwrap_or_else(|| function.to_owned());
                let line = location.line.unwrap_or(0);
                said.push(format!("{name} ({file}:{line})"));
            }
        }
        if said.is_empty() {
            let library = Path::new(&place.object).file_name().unwrap_or_default();
            said.push(format!("{function} ({})", library.display()));
        }
        said
    }
}

fn lines(file: &object::File<'static>) -> Option<Context<EndianSlice<'static, LittleEndian>>> {
    let section = |id: SectionId| -> Result<_, Infallible> {
        // Compressed sections are skipped, such as those of distributions' libraries.
        let data = file
            .section_by_name(id.name())
            .and_then(|section| section.data().ok());
        Ok(EndianSlice::new(data.unwrap_or_default(), LittleEndian))
    };
    let Ok(dwarf) = Dwarf::load(section);
    Context::from_dwarf(dwarf).ok()
}

/// A source file's path below the workspace's folder, if it is there.
fn in_workspace(file: &str) -> Option<&str> {
    let of_this_crate = Path::new(env!("CARGO_MANIFEST_DIR"));
    let workspace = of_this_crate.parent()?.parent()?.to_str()?;
    Some(file.strip_prefix(workspace)?.trim_start_matches('/'))
}

fn decode(bytes: &[u8], address: u64) -> Instruction {
    Decoder::with_ip(64, bytes, address, DecoderOptions::NONE).decode()
}

fn is_atomic(instruction: &Instruction) -> bool {
    let is_exchange = instruction.mnemonic() == Mnemonic::Xchg
        && (instruction.op0_kind() == OpKind::Memory || instruction.op1_kind() == OpKind::Memory);
    instruction.has_lock_prefix() || is_exchange || instruction.mnemonic() == Mnemonic::Mfence
}

fn name(instruction: &Instruction) -> String {
    let prefix = if instruction.has_lock_prefix() {
        "lock "
    } else {
        ""
    };
    format!("{prefix}{:?}", instruction.mnemonic()).to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn locked_instructions_exchanges_with_memory_and_fences_are_atomic() {
        let cases: [(&[u8], Option<&str>); 8] = [
            (&[0xf0, 0x0f, 0xb1, 0x0f], Some("lock cmpxchg")), // lock cmpxchg [rdi], ecx
            (&[0xf0, 0x48, 0xff, 0x07], Some("lock inc")),     // lock inc qword [rdi]
            (&[0xf0, 0x83, 0x4c, 0x24, 0xc0, 0x00], Some("lock or")), // lock or dword [rsp-64], 0
            (&[0x87, 0x07], Some("xchg")),                     // xchg [rdi], eax
            (&[0x0f, 0xae, 0xf0], Some("mfence")),
            (&[0x48, 0x87, 0xdb], None), // xchg rbx, rbx
            (&[0x0f, 0xb1, 0x0f], None), // cmpxchg [rdi], ecx, not locked
            (&[0x48, 0xff, 0x07], None), // inc qword [rdi]
        ];
        for (bytes, expected) in cases {
            let instruction = decode(bytes, 0x1000);
            assert_eq!(instruction.len(), bytes.len(), "{bytes:x?}");
            let found = is_atomic(&instruction).then(|| name(&instruction));
            assert_eq!(found.as_deref(), expected, "{bytes:x?}");
        }
    }
}
