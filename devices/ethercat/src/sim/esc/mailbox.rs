//! The mailboxes of a simulated subdevice: when they are full, and what may be read and written.

use super::{Done, Esc, MANAGERS};
use crate::State;
use crate::sim::sii::{ANSWERS_AT, MAILBOX_LENGTH, REQUESTS_AT};

/// The status of their sync managers, in which a bit is set while a mailbox is full.
const STATUS: [usize; 2] = [MANAGERS + 5, MANAGERS + 8 + 5];
const FULL: u8 = 1 << 3;

impl Esc {
    /// Whether the sync managers of its mailboxes are set, if it has them.
    pub(super) fn has_mailboxes(&self) -> bool {
        let has = |at| self.manages(at, MAILBOX_LENGTH.into());
        self.coe.is_none() || has(REQUESTS_AT) && has(ANSWERS_AT)
    }

    /// Whether it is full.
    fn is_full(&self, mailbox: usize) -> bool {
        self.memory[STATUS[mailbox]] & FULL != 0
    }

    /// Answers the request that has come, if there is room for the answer.
    fn serve_mailbox(&mut self) {
        let [requests, answers] = [REQUESTS_AT, ANSWERS_AT].map(usize::from);
        let length = usize::from(MAILBOX_LENGTH);
        let is_due = self.is_full(0) && !self.is_full(1);
        let Some(coe) = self.coe.as_mut().filter(|_| is_due) else {
            return;
        };
        if let Some(message) = coe.report() {
            self.memory[answers..answers + length].copy_from_slice(&message);
            self.memory[STATUS[1]] |= FULL;
            return;
        }
        let request = &self.memory[requests..requests + length];
        let Some((answer, is_mapped)) = coe.answer(request, &mut *self.application, self.state)
        else {
            return;
        };
        let lengths = coe.lengths();
        self.memory[answers..answers + length].copy_from_slice(&answer);
        self.memory[STATUS[0]] &= !FULL;
        self.memory[STATUS[1]] |= FULL;
        if is_mapped {
            [self.outputs, self.inputs] = lengths;
            self.applied = vec![0; self.outputs];
        }
    }

    /// A mailbox is full when its last byte is written.
    pub(super) fn take_request(&mut self, at: usize, from: &[u8]) -> Done {
        let has_mailbox = self.coe.is_some() && self.has_mailboxes();
        let is_here = at + from.len() <= ANSWERS_AT.into();
        let is_up = !matches!(self.state, State::Init | State::Bootstrap);
        if !(has_mailbox && is_here && is_up) || self.is_full(0) {
            return false;
        }
        self.memory[at..at + from.len()].copy_from_slice(from);
        if at + from.len() == usize::from(ANSWERS_AT) {
            self.memory[STATUS[0]] |= FULL;
            self.serve_mailbox();
        }
        true
    }

    /// Whether these bytes may be read: of mailboxes only those of an answer that is there. Then
    /// also whether the answer is taken, by its last byte.
    pub(super) fn may_read(&self, from: usize, end: usize) -> Option<bool> {
        if self.coe.is_none() || end <= REQUESTS_AT.into() {
            return Some(false);
        }
        let is_there = from >= ANSWERS_AT.into() && self.is_full(1);
        is_there.then(|| end == usize::from(ANSWERS_AT + MAILBOX_LENGTH))
    }

    /// The answer is taken: there is room for the next.
    pub(super) fn empty_mailbox(&mut self) {
        self.memory[STATUS[1]] &= !FULL;
        self.serve_mailbox();
    }
}

#[cfg(test)]
mod tests {
    use super::super::{AL_CONTROL, INVALID_MAILBOX};
    use super::*;
    use crate::sim::SubDevice;

    const PRE_OP: [u8; 2] = [2, 0];
    const UPLOAD: [u8; 12] = [10, 0, 0, 0, 0, 0x13, 0, 0x20, 0x40, 0x61, 0x60, 0];

    fn write(esc: &mut Esc, at: u16, bytes: &[u8]) -> bool {
        esc.write(at, bytes, 0, 0)
    }

    fn status(esc: &mut Esc) -> [bool; 2] {
        STATUS.map(|status| {
            let mut byte = [0];
            assert!(esc.read(status as u16, &mut byte, 0));
            byte[0] & 8 != 0
        })
    }

    /// Sets its sync managers.
    fn managers(esc: &mut Esc) {
        for (unit, at, control) in [(0, REQUESTS_AT, 0x26), (1, ANSWERS_AT, 0x22)] {
            let [low, high] = at.to_le_bytes();
            let settings = [low, high, MAILBOX_LENGTH as u8, 0, control, 0, 1, 0];
            assert!(write(esc, MANAGERS as u16 + 8 * unit, &settings));
        }
    }

    #[test]
    fn a_mailbox_is_full_from_its_last_byte_until_it_is_taken() {
        let mut esc = Esc::new(SubDevice::servo(), 0, 0);
        let mut request = [0; MAILBOX_LENGTH as usize];
        request[..12].copy_from_slice(&UPLOAD);
        let mut answer = request;
        managers(&mut esc);
        assert!(!write(&mut esc, REQUESTS_AT, &request), "in INIT");
        assert!(write(&mut esc, AL_CONTROL, &PRE_OP));
        assert!(!esc.read(ANSWERS_AT, &mut answer, 0), "it is empty");
        assert!(write(&mut esc, REQUESTS_AT, &request[..12]));
        assert_eq!(status(&mut esc), [false, false]);
        assert!(write(&mut esc, REQUESTS_AT, &request));
        assert_eq!(status(&mut esc), [false, true]);
        // The next waits until this is taken, and a third has no room.
        assert!(write(&mut esc, REQUESTS_AT, &request));
        assert_eq!(status(&mut esc), [true, true]);
        assert!(!write(&mut esc, REQUESTS_AT, &request));
        for (counter, left) in [(1, [false, true]), (2, [false, false])] {
            answer.fill(0);
            assert!(esc.read(ANSWERS_AT, &mut answer[..20], 0), "a part of it");
            answer.fill(0);
            assert!(esc.read(ANSWERS_AT, &mut answer, 0));
            assert_eq!((answer[5] >> 4, answer[8]), (counter, 0x4f));
            assert_eq!(status(&mut esc), left);
        }
        assert!(!esc.read(ANSWERS_AT, &mut answer, 0));
        assert!(!esc.read(REQUESTS_AT, &mut answer, 0));
        assert!(!write(&mut esc, ANSWERS_AT, &request));
    }

    #[test]
    fn it_needs_its_sync_managers() {
        let mut esc = Esc::new(SubDevice::servo(), 0, 0);
        assert!(write(&mut esc, AL_CONTROL, &PRE_OP));
        assert_eq!((esc.state(), esc.code()), (State::Init, INVALID_MAILBOX));
        managers(&mut esc);
        assert!(write(&mut esc, AL_CONTROL, &[0x12, 0]));
        assert_eq!((esc.state(), esc.code()), (State::PreOp, 0));
        let mut terminal = Esc::new(SubDevice::digital(8, 0), 0, 0);
        assert!(write(&mut terminal, AL_CONTROL, &PRE_OP));
        assert_eq!(terminal.state(), State::PreOp);
        assert!(!write(&mut terminal, REQUESTS_AT, &[0; 128]), "it has none");
    }
}
