//! The controller of a simulated subdevice: its memory, and what reads and writes of it do.

mod mailbox;

use super::clock::{self, Clock};
use super::coe::Coe;
use super::sii::{self, INPUTS_AT, OUTPUTS_AT, REQUESTS_AT};
use super::subdevice::SubDevice;
use crate::State;
use crate::frame::word;
use std::time::Duration;

use super::application::Application;

const FMMU_COUNT: usize = 0x0004;
const SUPPORT: usize = 0x0008;
const STATION: usize = 0x0010;
const LINKS: usize = 0x0110;
const AL_CONTROL: u16 = 0x0120;
const AL_STATUS: usize = 0x0130;
const AL_CODE: usize = 0x0134;
const WATCHDOG_DIVIDER: usize = 0x0400;
const WATCHDOG_TIME: usize = 0x0420;
const SII_CONTROL: u16 = 0x0502;
const SII_DATA: usize = 0x0508;
const FMMUS: usize = 0x0600;
const MANAGERS: usize = 0x0800;
/// How many FMMUs and sync managers it has.
const UNITS: usize = 8;
const MEMORY: usize = 0x2100;

/// Codes of [`AL_CODE`].
const INVALID_CHANGE: u16 = 0x0011;
const INVALID_MAILBOX: u16 = 0x0016;
const INVALID_OUTPUTS: u16 = 0x001d;
const INVALID_INPUTS: u16 = 0x001e;
const WATCHDOG: u16 = 0x001b;

/// What became of a read or a write.
pub(super) type Done = bool;

#[derive(Debug)]
pub(super) struct Esc {
    memory: Box<[u8]>,
    eeprom: Vec<u8>,
    outputs: usize,
    inputs: usize,
    application: Box<dyn Application>,
    pub(super) coe: Option<Coe>,
    pub(super) clock: Option<Clock>,
    state: State,
    has_failed: bool,
    /// What the machine gets.
    applied: Vec<u8>,
    /// The time of the last outputs, and up to which the machine has run (ns).
    fed: u64,
    stepped: u64,
}

impl Esc {
    pub(super) fn new(description: SubDevice, number: u64, now: u64) -> Self {
        let SubDevice {
            name,
            identity,
            pdos,
            dictionary,
            application,
            drift,
            watchdog,
        } = description;
        let mut memory = vec![0; MEMORY].into_boxed_slice();
        memory[0] = 0x11;
        memory[FMMU_COUNT..FMMU_COUNT + 2].fill(UNITS as u8);
        // A clock of 64 bits with SYNC units.
        let support = if drift.is_some() { 0x010c_u16 } else { 0 };
        memory[SUPPORT..SUPPORT + 2].copy_from_slice(&support.to_le_bytes());
        // The watchdog counts steps of 100 µs, in units of 40 ns.
        memory[WATCHDOG_DIVIDER..WATCHDOG_DIVIDER + 2].copy_from_slice(&2498_u16.to_le_bytes());
        memory[WATCHDOG_TIME..WATCHDOG_TIME + 2].copy_from_slice(&watchdog.to_le_bytes());
        let [length, inputs] = [0, 1].map(|direction| sii::length(&pdos[direction]));
        let mut esc = Self {
            eeprom: sii::content(&name, identity, &pdos, dictionary.is_some()),
            outputs: length,
            inputs,
            application,
            coe: dictionary.map(Coe::new),
            // Clocks that were switched on at different times.
            clock: drift.map(|drift| Clock::new(drift, (number + 1) * 1_234_567_891)),
            state: State::Init,
            has_failed: false,
            applied: vec![0; length],
            fed: now,
            stepped: now,
            memory,
        };
        esc.show_state(0);
        esc
    }

    pub(super) fn state(&self) -> State {
        self.state
    }

    pub(super) fn code(&self) -> u16 {
        word(&self.memory, AL_CODE)
    }

    pub(super) fn applied(&self) -> &[u8] {
        &self.applied
    }

    pub(super) fn written(&self) -> &[u8] {
        &self.memory[OUTPUTS_AT.into()..][..self.outputs]
    }

    pub(super) fn inputs(&mut self) -> &mut [u8] {
        &mut self.memory[INPUTS_AT.into()..][..self.inputs]
    }

    pub(super) fn station(&self) -> u16 {
        word(&self.memory, STATION)
    }

    pub(super) fn system_time(&self, now: u64) -> Option<u64> {
        let clock = self.clock.as_ref()?;
        Some(clock.system_time(&self.memory, now))
    }

    /// Sets which of its ports have a neighbour.
    pub(super) fn link(&mut self, has_next: bool) {
        let links = 0x0010 | u16::from(has_next) << 5;
        self.memory[LINKS..LINKS + 2].copy_from_slice(&links.to_le_bytes());
    }

    /// Lets time pass: its machine moves, and its watchdog may expire.
    pub(super) fn advance(&mut self, now: u64) {
        let step = u64::from(word(&self.memory, WATCHDOG_DIVIDER)) + 2;
        let limit = step * 40 * u64::from(word(&self.memory, WATCHDOG_TIME));
        let is_late = limit > 0 && now.saturating_sub(self.fed) > limit;
        if is_late && self.outputs > 0 && self.state == State::Op {
            self.fall(WATCHDOG);
        }
        let elapsed = Duration::from_nanos(now.saturating_sub(self.stepped));
        self.stepped = now.max(self.stepped);
        let inputs = &mut self.memory[INPUTS_AT.into()..][..self.inputs];
        let application = &mut *self.application;
        match &mut self.coe {
            Some(coe) => coe.step(application, elapsed, &self.applied, inputs),
            None => application.step(elapsed, &self.applied, inputs),
        }
    }

    /// Leaves the operational state by itself.
    pub(super) fn fall(&mut self, code: u16) {
        self.state = State::SafeOp;
        self.has_failed = true;
        self.show_state(code);
    }

    fn show_state(&mut self, code: u16) {
        if self.state != State::Op {
            self.applied.fill(0);
        }
        let status = self.state.bits() | u8::from(self.has_failed) << 4;
        self.memory[AL_STATUS] = status;
        self.memory[AL_CODE..AL_CODE + 2].copy_from_slice(&code.to_le_bytes());
    }

    /// A request for another state.
    fn request(&mut self, control: u8, now: u64) {
        if control & 0x10 != 0 {
            self.has_failed = false;
        }
        let to = State::of(control & 0x0f);
        if self.has_failed && to.bits() > self.state.bits() {
            return;
        }
        let refusal = self.refusal(to);
        match refusal {
            None => {
                self.state = to;
                self.fed = now;
            }
            Some(_) => self.has_failed = true,
        }
        self.show_state(refusal.unwrap_or(0));
    }

    /// Why it cannot go to this state.
    fn refusal(&self, to: State) -> Option<u16> {
        match (self.state, to) {
            (_, State::Init) => None,
            (State::Init, State::PreOp) if !self.has_mailboxes() => Some(INVALID_MAILBOX),
            (State::Init | State::PreOp | State::SafeOp | State::Op, State::PreOp) => None,
            (State::PreOp, State::SafeOp) => {
                let has = |at: u16, length| length == 0 || self.manages(at, length);
                match (has(OUTPUTS_AT, self.outputs), has(INPUTS_AT, self.inputs)) {
                    (false, _) => Some(INVALID_OUTPUTS),
                    (_, false) => Some(INVALID_INPUTS),
                    _ => None,
                }
            }
            (State::SafeOp | State::Op, State::SafeOp | State::Op) => None,
            _ => Some(INVALID_CHANGE),
        }
    }

    /// Whether an enabled sync manager has exactly these bytes.
    fn manages(&self, at: u16, length: usize) -> bool {
        self.managers().any(|each| each == (at, length))
    }

    fn managers(&self) -> impl Iterator<Item = (u16, usize)> + '_ {
        let all = (0..UNITS).map(|unit| &self.memory[MANAGERS + 8 * unit..][..8]);
        all.filter(|unit| unit[6] & 1 != 0)
            .map(|unit| (word(unit, 0), usize::from(word(unit, 2))))
    }

    pub(super) fn read(&mut self, register: u16, to: &mut [u8], now: u64) -> Done {
        let from = usize::from(register);
        if from + to.len() > MEMORY {
            return false;
        }
        if let Some(clock) = self
            .clock
            .as_ref()
            .filter(|_| register == clock::SYSTEM_TIME)
        {
            let time = clock.system_time(&self.memory, now);
            let at = from;
            self.memory[at..at + 8].copy_from_slice(&time.to_le_bytes());
        }
        let Some(takes) = self.may_read(from, from + to.len()) else {
            return false;
        };
        // A broadcast unites what all have.
        for (to, from) in to.iter_mut().zip(&self.memory[from..]) {
            *to |= *from;
        }
        if takes {
            self.empty_mailbox();
        }
        true
    }

    /// `back` is how long the frame takes from here to the end and back (ns).
    pub(super) fn write(&mut self, register: u16, from: &[u8], now: u64, back: u64) -> Done {
        let at = usize::from(register);
        if at + from.len() > MEMORY || from.is_empty() {
            return false;
        }
        match register {
            AL_CONTROL => self.request(from[0], now),
            SII_CONTROL => self.read_eeprom(from),
            clock::RECEIVE_TIMES => match &self.clock {
                Some(clock) => clock.latch(&mut self.memory, now, back),
                None => return false,
            },
            clock::SYSTEM_TIME => return self.follow(from, now),
            REQUESTS_AT.. => return self.take_request(at, from),
            // Read only: what it is, and its state.
            0x0000..=0x000f | 0x0110..=0x0137 => return false,
            _ => {
                self.memory[at..at + from.len()].copy_from_slice(from);
                if clock::is_offset(register, from.len()) {
                    self.clock.iter_mut().for_each(Clock::set);
                }
                if clock::is_activation(register, from.len()) {
                    let clock = self.clock.iter_mut();
                    clock.for_each(|clock| clock.activate(&self.memory, now));
                }
            }
        }
        true
    }

    fn follow(&mut self, from: &[u8], now: u64) -> Done {
        let (Some(clock), Some(time)) = (&mut self.clock, from.first_chunk()) else {
            return false;
        };
        let time = u64::from_le_bytes(*time);
        // To be reset, it is written with zeros.
        if time > 0 {
            clock.follow(&mut self.memory, now, time);
        }
        true
    }

    fn read_eeprom(&mut self, request: &[u8]) {
        let at = usize::from(SII_CONTROL);
        self.memory[at..at + request.len()].copy_from_slice(request);
        if request.len() >= 4 && word(request, 0) & 0x0100 != 0 {
            let place = 2 * usize::from(word(request, 2));
            for (index, byte) in self.memory[SII_DATA..SII_DATA + 4].iter_mut().enumerate() {
                *byte = self.eeprom.get(place + index).copied().unwrap_or(0xff);
            }
        }
        // Done at once: neither busy nor a command under way, four bytes at a time.
        self.memory[at] = 0;
        self.memory[at + 1] = 0;
    }

    /// Exchanges process data by the FMMUs. Returns whether any was read, and written.
    pub(super) fn exchange(
        &mut self,
        start: u32,
        data: &mut [u8],
        may: [bool; 2],
        now: u64,
    ) -> [Done; 2] {
        let mut done = [false; 2];
        for unit in 0..UNITS {
            let fmmu: [u8; 16] = std::array::from_fn(|at| self.memory[FMMUS + 16 * unit + at]);
            if fmmu[12] & 1 == 0 {
                continue;
            }
            let logical = u32::from(word(&fmmu, 0)) | u32::from(word(&fmmu, 2)) << 16;
            let length = usize::from(word(&fmmu, 4));
            let physical = word(&fmmu, 8);
            if !self.manages(physical, length) {
                continue;
            }
            for offset in 0..length {
                let place = (logical as usize + offset).checked_sub(start as usize);
                let Some(byte) = place.and_then(|place| data.get_mut(place)) else {
                    continue;
                };
                let here = &mut self.memory[usize::from(physical) + offset];
                if may[0] && fmmu[11] & 1 != 0 {
                    *byte = *here;
                    done[0] = true;
                } else if may[1] && fmmu[11] & 2 != 0 {
                    *here = *byte;
                    done[1] = true;
                }
            }
        }
        if done[1] {
            self.fed = now;
            if self.state == State::Op {
                let written = &self.memory[OUTPUTS_AT.into()..][..self.outputs];
                self.applied.copy_from_slice(written);
            }
        }
        if let Some(clock) = self.clock.as_mut().filter(|_| done != [false; 2]) {
            clock.note_process_data(&self.memory, now);
        }
        done
    }
}
