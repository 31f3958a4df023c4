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
