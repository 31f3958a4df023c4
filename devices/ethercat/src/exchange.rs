//! Requests of the library, sent and answered by a port.

use crate::frame::{self, MAX_FRAME, SENDER_TAG};
use crate::port::Port;
use crate::timer;
use crate::{Health, Neutral};
use ethercrab::{PduRx, PduTx, ReceiveAction};
use luna::Instant;
use luna::external::FileError;
use luna_platform::panics;
use std::future::Future;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

/// The limit of frames without a use that are looked at at a time, so that a flood does not block
/// the executor.
const MAX_AT_ONCE: u32 = 64;

/// Carries the frames of the library.
pub(crate) struct Exchange {
    tx: PduTx<'static>,
    rx: PduRx<'static>,
    pub(crate) port: Port,
    buffer: Box<[u8; MAX_FRAME]>,
    /// What the answer to the last frame is recognized by. Its numbers of datagrams come again
    /// after 256 of them, which may be a few cycles.
    tag: u32,
    has_answer: bool,
    refusal: Option<io::Error>,
    pub(crate) health: Arc<Health>,
}

/// Why a step of a set-up cannot go on.
pub(crate) enum Broken {
    System(io::Error),
    /// With these words.
    Panicked(String),
}

/// What came of a look for a frame.
enum Received {
    Nothing,
    /// One that answers nothing, or an error in place of one.
    Unused,
    Answer,
}

/// Polls without a waker: the caller knows when to poll again.
fn poll<F: Future + ?Sized>(future: Pin<&mut F>) -> Poll<F::Output> {
    future.poll(&mut Context::from_waker(Waker::noop()))
}

impl Exchange {
    pub(crate) fn new(tx: PduTx<'static>, rx: PduRx<'static>, port: Port) -> Self {
        Self {
            tx,
            rx,
            port,
            buffer: Box::new([0; MAX_FRAME]),
            tag: SENDER_TAG,
            has_answer: false,
            refusal: None,
            health: Arc::default(),
        }
    }

    /// Blocks until `future` is ready: for set-up. The library's own timeouts end it.
    ///
    /// # Errors
    ///
    /// The system cannot wait for the port, or the library panics, as it does on some answers of
    /// subdevices.
    pub(crate) fn block_on<F: Future + ?Sized>(
        &mut self,
        mut future: Pin<Box<F>>,
    ) -> Result<F::Output, Broken> {
        loop {
            let now = self.port.now();
            let polled = panics::catch(|| timer::at(now, || poll(future.as_mut())));
            let polled = polled.map_err(|payload| {
                let text = panics::text(&*payload).unwrap_or("without a text");
                Broken::Panicked(text.to_owned())
            })?;
            if let Poll::Ready(output) = polled {
                return Ok(output);
            }
            self.send(false);
            match self.receive() {
                Received::Nothing => self.port.wait().map_err(Broken::System)?,
                Received::Unused => {}
                Received::Answer => self.has_answer = true,
            }
        }
    }

    /// Whether any frame of a set-up has come back.
    pub(crate) fn has_answer(&self) -> bool {
        self.has_answer
    }

    /// Why the system has refused to send a frame, the last time.
    pub(crate) fn take_refusal(&mut self) -> Option<io::Error> {
        self.refusal.take()
    }

    /// Sends the first frame of `future` without waiting: [`until`](Self::until) awaits the rest.
    /// Returns its outcome if it needs no answer.
    pub(crate) fn begin<F: Future>(&mut self, future: Pin<&mut F>) -> Option<F::Output> {
        match poll(future) {
            Poll::Ready(output) => Some(output),
            Poll::Pending => {
                self.send(true);
                None
            }
        }
    }

    /// Awaits `future` until `deadline`; none if it is not ready then.
    ///
    /// Each of its frames goes out once, and none at the deadline or later. With `neutral`, none
    /// goes out when the bus was made safe, and one that went out meanwhile is followed by those
    /// that make it safe.
    ///
    /// # Errors
    ///
    /// The port cannot be waited for.
    pub(crate) async fn until<F: Future>(
        &mut self,
        deadline: Instant,
        neutral: Option<&Neutral>,
        mut future: Pin<&mut F>,
    ) -> Result<Option<F::Output>, FileError> {
        let is_engaged = || neutral.is_some_and(Neutral::is_engaged);
        let mut left = MAX_AT_ONCE;
        loop {
            // Polled at the begin and with an answer alone: the library would offer a frame again
            // after its own timeout, and refuse the answer to the first one.
            if let Poll::Ready(output) = poll(future.as_mut()) {
                return Ok(Some(output));
            }
            if luna::now() >= deadline || is_engaged() {
                return Ok(None);
            }
            self.send(true);
            if is_engaged() {
                // If the system refuses, the watchdogs remain.
                let _ = neutral.map(Neutral::try_engage);
                return Ok(None);
            }
            loop {
                match self.receive() {
                    Received::Answer => break,
                    Received::Unused if left > 0 => left -= 1,
                    Received::Unused => return Ok(None),
                    Received::Nothing if luna::now() >= deadline => return Ok(None),
                    Received::Nothing => self.port.readable(deadline).await?,
                }
            }
        }
    }

    /// Drops what has come too late for its cycle.
    pub(crate) fn drain(&mut self) {
        for _ in 0..MAX_AT_ONCE {
            match self.port.receive(&mut self.buffer[..]) {
                Ok(Some(_)) => self.health.dropped.add(),
                Ok(None) => return,
                Err(_) => self.health.refused.add(),
            }
        }
    }

    /// Sends what waits to be sent. If `is_tagged`, under the next tag: only its answer counts.
    fn send(&mut self, is_tagged: bool) {
        while let Some(frame) = self.tx.next_sendable_frame() {
            if is_tagged {
                self.tag = self.tag.wrapping_add(1);
            }
            let (port, buffer, tag) = (&self.port, &mut self.buffer, self.tag);
            let refusal = &mut self.refusal;
            let send = |bytes: &[u8]| {
                let to = buffer.get_mut(..bytes.len());
                let to = to.ok_or(ethercrab::error::Error::SendFrame)?;
                to.copy_from_slice(bytes);
                frame::tag(to, tag);
                port.send(to).map_err(|error| {
                    *refusal = Some(error);
                    ethercrab::error::Error::SendFrame
                })
            };
            if frame.send_blocking(send).is_err() {
                self.health.refused.add();
                // It would be offered again at once.
                return;
            }
        }
    }

    /// Takes a frame, if one has come.
    fn receive(&mut self) -> Received {
        let length = match self.port.receive(&mut self.buffer[..]) {
            Ok(Some(length)) => length,
            Ok(None) => return Received::Nothing,
            Err(_) => {
                self.health.refused.add();
                return Received::Unused;
            }
        };
        let frame = &mut self.buffer[..length];
        let is_request = frame::is_request(frame);
        if frame::take_tag(frame) != Some(self.tag) {
            // Frames on their way out come back on some interfaces.
            if !is_request {
                self.health.dropped.add();
            }
            return Received::Unused;
        }
        match self.rx.receive_frame(frame) {
            Ok(ReceiveAction::Processed) => Received::Answer,
            Ok(ReceiveAction::Ignored) => Received::Unused,
            Err(_) => {
                self.health.dropped.add();
                Received::Unused
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Wire;
    use crate::sim::Network;
    use ethercrab::PduStorage;

    #[test]
    fn a_panic_of_the_library_is_an_error() {
        let storage: &PduStorage<1, { PduStorage::element_size(64) }> =
            Box::leak(Box::new(PduStorage::new()));
        let (tx, rx, _pdus) = storage.try_split().ok().unwrap();
        let port = Wire::simulated(&Network::new()).open().unwrap();
        let mut exchange = Exchange::new(tx, rx, port);
        let outcome = exchange.block_on(Box::pin(async { panic!("on purpose") }));
        let Err::<(), _>(Broken::Panicked(text)) = outcome else {
            panic!("no panic");
        };
        assert_eq!(text, "on purpose");
    }
}
