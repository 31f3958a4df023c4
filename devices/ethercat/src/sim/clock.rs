//! The distributed clock of a simulated subdevice.

use crate::frame::word;

/// Where its registers begin.
const BASE: usize = 0x0900;
pub(super) const RECEIVE_TIMES: u16 = 0x0900;
pub(super) const SYSTEM_TIME: u16 = 0x0910;
const RECEIVED: usize = 0x0918;
const OFFSET: usize = 0x0920;
const DELAY: usize = 0x0928;
const DIFFERENCE: usize = 0x092c;
const ACTIVATION: usize = 0x0981;
const START: usize = 0x0990;
const CYCLE: usize = 0x09a0;

/// An oscillator, and what was written to adjust it.
#[derive(Debug, Clone)]
pub(super) struct Clock {
    /// Parts per million by which it is fast.
    drift: f64,
    /// Its time when the simulation began (ns).
    begin: u64,
    /// By how much the system's time was moved since it was last set.
    adjusted: i64,
    /// Whether SYNC0 comes: its start was not over when it was activated.
    has_start: bool,
    /// When the last process data came, after SYNC0 (ns).
    pub(super) phase: Option<u64>,
}

impl Clock {
    pub(super) fn new(drift: f64, begin: u64) -> Self {
        Self {
            drift,
            begin,
            adjusted: 0,
            has_start: false,
            phase: None,
        }
    }

    /// Its own time.
    fn local(&self, now: u64) -> u64 {
        let gained = now as f64 * self.drift * 1e-6;
        self.begin
            .wrapping_add(now)
            .wrapping_add_signed(gained as i64)
    }

    /// The time that all clocks of a network are to have.
    pub(super) fn system_time(&self, memory: &[u8], now: u64) -> u64 {
        let offset = u64::from_le_bytes(array(memory, OFFSET));
        let local = self.local(now).wrapping_add(offset);
        local.wrapping_add_signed(self.adjusted)
    }

    /// Remembers when the frame came, and came back.
    pub(super) fn latch(&self, memory: &mut [u8], now: u64, back: u64) {
        let times = [self.local(now), self.local(now.saturating_add(back))].map(|time| time as u32);
        memory[BASE..BASE + 4].copy_from_slice(&times[0].to_le_bytes());
        memory[BASE + 4..BASE + 8].copy_from_slice(&times[1].to_le_bytes());
        memory[RECEIVED..RECEIVED + 8].copy_from_slice(&self.local(now).to_le_bytes());
    }

    /// Takes the time of the reference clock: a part of the difference is taken away.
    pub(super) fn follow(&mut self, memory: &mut [u8], now: u64, reference: u64) {
        let delay = u64::from(u32::from_le_bytes(array(memory, DELAY)));
        let own = self.system_time(memory, now);
        let difference = own.wrapping_sub(reference.wrapping_add(delay)) as i64;
        self.adjusted -= difference / 2;
        let magnitude = u32::try_from(difference.unsigned_abs()).unwrap_or(u32::MAX >> 1);
        let sign = u32::from(difference < 0) << 31;
        let stated = magnitude & (u32::MAX >> 1) | sign;
        memory[DIFFERENCE..DIFFERENCE + 4].copy_from_slice(&stated.to_le_bytes());
    }

    /// The offset was set: it counts from now on.
    pub(super) fn set(&mut self) {
        self.adjusted = 0;
    }

    /// SYNC0 was activated, or stopped. A start that is over never comes.
    pub(super) fn activate(&mut self, memory: &[u8], now: u64) {
        let start = u64::from_le_bytes(array(memory, START));
        self.has_start = start > self.system_time(memory, now);
    }

    /// The period of SYNC0, if it is active (ns).
    fn sync_period(&self, memory: &[u8]) -> Option<u64> {
        let is_active = memory[ACTIVATION] & 0b11 == 0b11;
        let period = u64::from(word(memory, CYCLE)) | u64::from(word(memory, CYCLE + 2)) << 16;
        (is_active && self.has_start && period > 0).then_some(period)
    }

    /// Process data has come.
    pub(super) fn note_process_data(&mut self, memory: &[u8], now: u64) {
        // SYNC0 begins at a multiple of its period.
        let period = self.sync_period(memory);
        self.phase = period.map(|period| self.system_time(memory, now) % period);
    }
}

fn array<const N: usize>(memory: &[u8], at: usize) -> [u8; N] {
    std::array::from_fn(|index| memory[at + index])
}

pub(super) fn is_offset(register: u16, length: usize) -> bool {
    let (from, to) = (usize::from(register), usize::from(register) + length);
    from < DELAY && to > OFFSET
}

pub(super) fn is_activation(register: u16, length: usize) -> bool {
    let from = usize::from(register);
    (from..from + length).contains(&ACTIVATION)
}
