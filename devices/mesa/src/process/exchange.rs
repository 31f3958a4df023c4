//! A request, and the answer to just that one.

use crate::Health;
use crate::socket::Socket;
use hostmot2::lbp16::Packet;
use luna::Instant;
use luna::external::FileError;
use std::sync::Arc;

/// The limit of datagrams read in one cycle, so that a flood does not block the executor.
const MAX_AT_ONCE: u32 = 64;

/// The socket, with the number of the last request and a buffer for an answer.
#[derive(Debug)]
pub(super) struct Exchange {
    socket: Socket,
    number: u32,
    /// One byte more than an answer has, to recognize longer datagrams, which are cut.
    answer: Box<[u8]>,
    health: Arc<Health>,
}

/// What came of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// No answer came in time.
    Missed,
    /// The answer is in [`Exchange::answer`].
    Answered { asked: Instant, answered: Instant },
}

impl Exchange {
    pub(super) fn new(socket: Socket, answer_len: usize, number: u32, health: Arc<Health>) -> Self {
        Self {
            socket,
            number,
            answer: vec![0; answer_len + 1].into(),
            health,
        }
    }

    pub(super) fn next_number(&mut self) -> u32 {
        self.number = self.number.wrapping_add(1);
        self.number
    }

    pub(super) fn send(&self, packet: &Packet) {
        if self.socket.send(packet.bytes()).is_err() {
            self.health.refused.add();
        }
    }

    /// The received answer.
    pub(super) fn answer(&self) -> &[u8] {
        &self.answer[..self.answer.len() - 1]
    }

    /// Sends the request of the last number, and waits until `deadline` for the answer with this
    /// number.
    pub(super) async fn ask(
        &mut self,
        request: &Packet,
        deadline: Instant,
    ) -> Result<Outcome, FileError> {
        let asked = luna::now();
        self.send(request);
        let expected = self.answer.len() - 1;
        let mut looked_at = 0;
        while looked_at < MAX_AT_ONCE {
            match self.socket.receive(&mut self.answer) {
                Ok(Some(length))
                    if length == expected
                        && self.answer.starts_with(&self.number.to_le_bytes()) =>
                {
                    return Ok(Outcome::Answered {
                        asked,
                        answered: luna::now(),
                    });
                }
                // An earlier cycle's, a copy of one, or nonsense.
                Ok(Some(_)) => {
                    looked_at += 1;
                    self.health.dropped.add();
                }
                Ok(None) => {
                    if luna::now() >= deadline || !self.socket.readable(deadline).await? {
                        return Ok(Outcome::Missed);
                    }
                }
                // For example no program listens there: it may the next time.
                Err(_) => {
                    looked_at += 1;
                    self.health.refused.add();
                }
            }
        }
        Ok(Outcome::Missed)
    }
}
