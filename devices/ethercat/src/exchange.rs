//! Requests of the library, sent and answered by a port.

use crate::Health;
use crate::frame::MAX_FRAME;
use crate::port::Port;
use crate::timer;
use ethercrab::{PduRx, PduTx};
use luna::Instant;
use luna::external::FileError;
use std::future::Future;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

/// The limit of frames that are looked at in one cycle, so that a flood does not block the
/// executor.
const MAX_AT_ONCE: u32 = 64;

/// Carries the frames of the library.
pub(crate) struct Exchange {
    tx: PduTx<'static>,
    rx: PduRx<'static>,
    pub(crate) port: Port,
    buffer: Box<[u8; MAX_FRAME]>,
    pub(crate) health: Arc<Health>,
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
            health: Arc::default(),
        }
    }

    /// Blocks until `future` is ready: for set-up. The library's own timeouts end it.
    ///
    /// # Errors
    ///
    /// The system cannot wait for the port.
    pub(crate) fn block_on<F: Future + ?Sized>(
        &mut self,
        mut future: Pin<Box<F>>,
    ) -> io::Result<F::Output> {
        loop {
            let polled = timer::at(self.port.now(), || poll(future.as_mut()));
            if let Poll::Ready(output) = polled {
                return Ok(output);
            }
            self.send();
            if self.receive(MAX_AT_ONCE) == 0 {
                self.port.wait()?;
            }
        }
    }

    /// Awaits `future` until `deadline`; none if it is not ready then.
    ///
    /// # Errors
    ///
    /// The port cannot be waited for.
    pub(crate) async fn until<F: Future>(
        &mut self,
        deadline: Instant,
        mut future: Pin<&mut F>,
    ) -> Result<Option<F::Output>, FileError> {
        let mut left = MAX_AT_ONCE;
        loop {
            if let Poll::Ready(output) = poll(future.as_mut()) {
                return Ok(Some(output));
            }
            self.send();
            match self.receive(left) {
                0 if luna::now() >= deadline => return Ok(None),
                0 => self.port.readable(deadline).await?,
                received => left = left.saturating_sub(received),
            }
            if left == 0 {
                return Ok(None);
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

    /// Sends what waits to be sent.
    fn send(&mut self) {
        while let Some(frame) = self.tx.next_sendable_frame() {
            let port = &self.port;
            let send = |bytes: &[u8]| {
                port.send(bytes)
                    .map_err(|_| ethercrab::error::Error::SendFrame)
            };
            if frame.send_blocking(send).is_err() {
                self.health.refused.add();
                // It would be offered again at once.
                return;
            }
        }
    }

    /// Takes what has come, `most` frames at most. Returns their number.
    fn receive(&mut self, most: u32) -> u32 {
        for count in 0..most {
            let length = match self.port.receive(&mut self.buffer[..]) {
                Ok(Some(length)) => length,
                Ok(None) => return count,
                Err(_) => {
                    self.health.refused.add();
                    continue;
                }
            };
            // Frames on their way out come back on some interfaces, and are ignored.
            if self.rx.receive_frame(&self.buffer[..length]).is_err() {
                self.health.dropped.add();
            }
        }
        most
    }
}
