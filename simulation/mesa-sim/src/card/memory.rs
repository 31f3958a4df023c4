//! The memory spaces other than HostMot2's, their info areas, and the address pointers.

use hostmot2::lbp16::{Command, Space};
use hostmot2::registers::board;

const EEPROM_SIZE: usize = 128;
const SCRATCH_SIZE: usize = 32;
const STATUS_SIZE: usize = 32;
/// 16 Mbit.
const FLASH_SIZE: usize = 2 << 20;
const FLASH_ID: u32 = 0x14;
const SECTOR: usize = 64 << 10;

/// The registers of the space with the flash memory.
mod flash {
    pub(super) const ADDRESS: u16 = 0x00;
    pub(super) const DATA: u16 = 0x04;
    pub(super) const ID: u16 = 0x08;
    pub(super) const ERASE: u16 = 0x0C;
}

/// The counters of the space with the status.
mod status {
    pub(super) const PARSE_ERRORS: usize = 0x02;
    pub(super) const MEMORY_ERRORS: usize = 0x04;
    pub(super) const PACKETS: usize = 0x0A;
}

#[derive(Debug, Clone)]
pub(super) struct Memory {
    pointers: [u16; 8],
    eeprom: [u8; EEPROM_SIZE],
    scratch: [u8; SCRATCH_SIZE],
    status: [u8; STATUS_SIZE],
    board: [u8; 32],
    /// Made when it is written to: all ones until then.
    flash: Vec<u8>,
    flash_address: u32,
}

impl Memory {
    pub(super) fn new() -> Self {
        let mut eeprom = [0; EEPROM_SIZE];
        // Lowest word first: a MAC address of Mesa's range, the name, the IP address.
        eeprom[0x02..0x08].copy_from_slice(&[0x01, 0x00, 0x1B, 0x12, 0x60, 0x00]);
        eeprom[0x10..0x14].copy_from_slice(b"7I92");
        eeprom[0x20..0x24].copy_from_slice(&[1, 0, 0, 127]);
        eeprom[0x24..0x28].copy_from_slice(&[0, 0, 0, 255]);
        let mut about = [0; 32];
        about[..4].copy_from_slice(b"7I92");
        let version = usize::from(board::LBP16_VERSION);
        about[version] = 3;
        about[usize::from(board::FIRMWARE_VERSION)] = 15;
        Self {
            pointers: [0; 8],
            eeprom,
            scratch: [0; SCRATCH_SIZE],
            status: [0; STATUS_SIZE],
            board: about,
            flash: Vec::new(),
            flash_address: 0,
        }
    }

    /// Where the command begins.
    pub(super) fn pointer(&self, command: &Command) -> u16 {
        command
            .address
            .unwrap_or(self.pointers[command.space as usize])
    }

    pub(super) fn set_pointer(&mut self, command: &Command, at: u16) {
        if !command.info {
            self.pointers[command.space as usize] = at;
        }
    }

    pub(super) fn count_packet(&mut self) {
        self.count(status::PACKETS);
    }

    pub(super) fn count_parse_error(&mut self) {
        self.count(status::PARSE_ERRORS);
    }

    pub(super) fn count_memory_error(&mut self) {
        self.count(status::MEMORY_ERRORS);
    }

    fn count(&mut self, at: usize) {
        let count = u16::from_le_bytes([self.status[at], self.status[at + 1]]);
        self.status[at..at + 2].copy_from_slice(&count.wrapping_add(1).to_le_bytes());
    }

    pub(super) fn read(&self, command: &Command, at: u16, to: &mut [u8], now: u64) {
        if command.info {
            return copy(&self.info(command.space), at, to);
        }
        match command.space {
            Space::Eeprom => copy(&self.eeprom, at, to),
            Space::Timers => {
                let mut timers = self.scratch;
                // Microseconds.
                timers[..2].copy_from_slice(&((now / 1_000) as u16).to_le_bytes());
                copy(&timers, at, to);
            }
            Space::Status => copy(&self.status, at, to),
            Space::Board => copy(&self.board, at, to),
            Space::Flash => {
                let register = match at & !3 {
                    flash::ADDRESS => self.flash_address,
                    flash::DATA => self.flash_word(),
                    flash::ID => FLASH_ID,
                    _ => 0,
                };
                copy(&register.to_le_bytes(), at & 3, to);
            }
            Space::HostMot2 | Space::Chip | Space::Reserved => to.fill(0),
        }
    }

    pub(super) fn write(&mut self, command: &Command, at: u16, from: &[u8]) {
        if command.info {
            return self.count_memory_error();
        }
        let to: &mut [u8] = match command.space {
            Space::Eeprom => &mut self.eeprom,
            // The timers below count by themselves.
            Space::Timers if at >= 0x10 => &mut self.scratch,
            Space::Status => &mut self.status,
            Space::Flash => return self.write_flash(at, from),
            _ => return self.count_memory_error(),
        };
        let to = to.get_mut(usize::from(at)..).unwrap_or_default();
        for (to, from) in to.iter_mut().zip(from) {
            *to = *from;
        }
    }

    fn flash_word(&self) -> u32 {
        let at = self.flash_address as usize % FLASH_SIZE;
        let mut word = [0xFF; 4];
        for (number, byte) in word.iter_mut().enumerate() {
            *byte = self.flash.get(at + number).copied().unwrap_or(0xFF);
        }
        u32::from_le_bytes(word)
    }

    fn write_flash(&mut self, at: u16, from: &[u8]) {
        let Some(value) = from.first_chunk::<4>() else {
            return self.count_memory_error();
        };
        match at {
            flash::ADDRESS => self.flash_address = u32::from_le_bytes(*value),
            flash::DATA => {
                let start = (self.flash_address as usize % FLASH_SIZE) & !3;
                for (to, from) in self.flash()[start..].iter_mut().zip(value) {
                    // Ones become zeroes only.
                    *to &= from;
                }
                self.flash_address = self.flash_address.wrapping_add(4);
            }
            flash::ERASE => {
                let start = self.flash_address as usize % FLASH_SIZE / SECTOR * SECTOR;
                self.flash()[start..start + SECTOR].fill(0xFF);
            }
            _ => self.count_memory_error(),
        }
    }

    fn flash(&mut self) -> &mut [u8] {
        if self.flash.is_empty() {
            self.flash = vec![0xFF; FLASH_SIZE];
        }
        &mut self.flash
    }

    /// A space's description of itself: a cookie, its sizes and ranges, its pointer, its name.
    fn info(&self, space: Space) -> [u8; 16] {
        // Whether it can be written, its width (8, 16, 32 bits), its length as a power of two.
        let (is_writable, width, length, name): (u16, u16, u16, &[u8; 8]) = match space {
            Space::HostMot2 => (1, 4, 16, b"HostMot2"),
            Space::Chip => (1, 2, 8, b"KSZ8851M"),
            Space::Eeprom => (1, 2, 7, b"EtherEEP"),
            Space::Flash => (1, 4, 5, b"FPGAFlsh"),
            Space::Timers => (1, 2, 5, b"Timers\0\0"),
            Space::Reserved => (0, 0, 0, b"\0\0\0\0\0\0\0\0"),
            Space::Status => (1, 2, 5, b"LBP16RW\0"),
            Space::Board => (0, 2, 5, b"LBP16RO\0"),
        };
        let mut info = [0; 16];
        if space != Space::Reserved {
            let words = [
                0x5A00 | space as u16,
                is_writable << 15 | width,
                length,
                self.pointers[space as usize],
            ];
            for (place, word) in info.chunks_exact_mut(2).zip(words) {
                place.copy_from_slice(&word.to_le_bytes());
            }
            info[8..].copy_from_slice(name);
        }
        info
    }
}

/// The bytes at `at`; zeroes where nothing is.
fn copy(from: &[u8], at: u16, to: &mut [u8]) {
    to.fill(0);
    let from = from.get(usize::from(at)..).unwrap_or_default();
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
}
