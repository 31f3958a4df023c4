//! The link of the side that begins: it sends, or calls.

use crate::IpcError;
use crate::codec::Place;
use crate::link::{Bound, Link, Near, Stop};
use crate::session::Session;
use crate::wait::{First, Seen, Waits};
use luna::Receiver;
use luna::channel::{ChannelEnd, Extended, RecvError};
use std::pin::pin;
use std::sync::atomic::Ordering::SeqCst;

/// The link of the sending side, made by [`sender`](crate::sender).
pub type SendLink<T> = Link<Outward<Values<T>>>;

/// What a link takes from its local channel.
pub(crate) trait Source: Send {
    /// A value that was taken while its sender waits.
    type Taken<'a>
    where
        Self: 'a;

    async fn take(&self) -> Result<Self::Taken<'_>, RecvError>;

    async fn ended(&self) -> ChannelEnd;

    async fn poisoned(&self) -> ChannelEnd;

    /// Whether a value is to be delivered after the last local end is gone.
    fn has_more(&self) -> bool;

    fn poison(&self);

    /// Whether the other program's link runs, as far as that matters.
    fn is_ready(session: &Session) -> bool;

    /// # Safety
    ///
    /// No value is under way in the session, and this is its sender.
    unsafe fn write(
        &self,
        bound: &Bound<'_, '_>,
        taken: &mut Self::Taken<'_>,
    ) -> Result<(), IpcError>;

    /// Lets the value's sender go on.
    ///
    /// # Safety
    ///
    /// This is the sender, and its value is the last one, and taken.
    unsafe fn acknowledge(&self, session: &Session, taken: Self::Taken<'_>)
    -> Result<(), IpcError>;

    fn refuse(&self, taken: Self::Taken<'_>, end: ChannelEnd);
}

/// From a channel.
#[expect(missing_debug_implementations, reason = "only links hold it")]
pub struct Values<T> {
    receiver: Receiver<T>,
    place: Place<T>,
}

impl<T: Send> Values<T> {
    pub(crate) fn new(receiver: Receiver<T>, place: Place<T>) -> Self {
        let receiver = receiver.external();
        Self { receiver, place }
    }
}

impl<T: Send> Source for Values<T> {
    type Taken<'a>
        = Extended<'a, T>
    where
        T: 'a;

    async fn take(&self) -> Result<Extended<'_, T>, RecvError> {
        self.receiver.recv_extended().await
    }

    async fn ended(&self) -> ChannelEnd {
        self.receiver.ended().await
    }

    async fn poisoned(&self) -> ChannelEnd {
        self.receiver.poisoned().await
    }

    fn has_more(&self) -> bool {
        self.receiver.buffered() > 0
    }

    fn poison(&self) {
        self.receiver.poison();
    }

    fn is_ready(_: &Session) -> bool {
        true
    }

    unsafe fn write(
        &self,
        bound: &Bound<'_, '_>,
        taken: &mut Extended<'_, T>,
    ) -> Result<(), IpcError> {
        // SAFETY: the caller promises that this is the sender, and that no value is under way: so
        // the receiver accesses nothing at the place, and no other sender is there.
        unsafe { self.place.write(bound.session, taken) }
    }

    unsafe fn acknowledge(&self, _: &Session, taken: Extended<'_, T>) -> Result<(), IpcError> {
        drop(taken);
        Ok(())
    }

    fn refuse(&self, mut taken: Extended<'_, T>, end: ChannelEnd) {
        self.place.take_back(&mut taken);
        taken.refuse(end);
    }
}

/// A link that begins: the near side of it.
#[expect(missing_debug_implementations, reason = "only links hold it")]
pub struct Outward<S>(pub(crate) S);

/// Refuses a value that was not acknowledged, also if the link is dropped.
struct Offered<'a, S: Source>(&'a S, Option<S::Taken<'a>>);

impl<'a, S: Source + 'a> Offered<'a, S> {
    fn refuse(&mut self, end: ChannelEnd) {
        if let Some(taken) = self.1.take() {
            self.0.refuse(taken, end);
        }
    }
}

impl<'a, S: Source + 'a> Drop for Offered<'a, S> {
    fn drop(&mut self) {
        self.refuse(ChannelEnd::Closed);
    }
}

impl<S: Source> Near for Outward<S> {
    async fn alone(&self, waits: &mut Waits<'_, '_>) -> Result<First<ChannelEnd, ()>, IpcError> {
        match waits.partner(pin!(self.0.ended())).await? {
            // What is in the buffer is still to be delivered.
            First::Own(ChannelEnd::Closed) if self.0.has_more() => {
                waits.partner(pin!(self.0.poisoned())).await
            }
            joined => Ok(joined),
        }
    }

    async fn carry(&self, bound: &mut Bound<'_, '_>) -> Result<Stop, IpcError> {
        if !S::is_ready(bound.session) {
            let ready = |session: &Session| match S::is_ready(session) {
                true => Some(None),
                false => session.partners_end().map(Some),
            };
            match bound.waits.first(pin!(self.0.ended()), ready).await? {
                First::Own(end) => return Ok(bound.end(end)),
                First::Other(Seen::Word(None)) => {}
                First::Other(Seen::Word(Some(end))) => return Ok(Stop::Ended(end.into())),
                First::Other(Seen::Death) => return Ok(bound.died()),
            }
        }
        let mut number = bound.partner.start;
        let mut poisoned = pin!(self.0.poisoned());
        loop {
            let next = pin!(self.0.take());
            let taken = match bound.waits.first(next, Session::partners_end).await? {
                First::Own(Ok(taken)) => taken,
                First::Own(Err(error)) => return Ok(bound.end(end_of(error.is_closed()))),
                First::Other(Seen::Word(end)) => return Ok(Stop::Ended(end.into())),
                First::Other(Seen::Death) => return Ok(bound.died()),
            };
            let mut offered = Offered(&self.0, Some(taken));
            if let Some(taken) = &mut offered.1
                // SAFETY: this is the sender of the bound session, and the value before was taken.
                && let Err(error) = unsafe { self.0.write(bound, taken) }
            {
                offered.refuse(ChannelEnd::Poisoned);
                bound.end(ChannelEnd::Poisoned);
                return Err(error);
            }
            number = number.wrapping_add(1);
            // Before the other program can take it, so that times are in this order.
            bound.report(number, false);
            bound.session.own().number.store(number, SeqCst);
            bound.session.ring(bound.partner);
            let answered = |session: &Session| match session.words().taken() >= number {
                true => Some(None),
                false => session.partners_end().map(Some),
            };
            match bound.waits.first(poisoned.as_mut(), answered).await? {
                First::Other(Seen::Word(None)) => {
                    let taken = bound.session.words().taken();
                    if taken != number {
                        offered.refuse(ChannelEnd::Poisoned);
                        return Err(bound.broken(taken, number.wrapping_sub(1)));
                    }
                    bound.status.acknowledge(number);
                    if let Some(taken) = offered.1.take()
                        // SAFETY: the partner has taken this value, and waits for the next.
                        && let Err(error) = unsafe { self.0.acknowledge(bound.session, taken) }
                    {
                        bound.end(ChannelEnd::Poisoned);
                        return Err(error);
                    }
                }
                First::Other(Seen::Word(Some(end))) => {
                    offered.refuse(end.into());
                    return Ok(Stop::Ended(end.into()));
                }
                First::Other(Seen::Death) => {
                    offered.refuse(ChannelEnd::Poisoned);
                    return Ok(bound.died());
                }
                First::Own(end) => return Ok(bound.end(end)),
            }
        }
    }

    fn poison(&self) {
        self.0.poison();
    }
}

pub(crate) fn end_of(is_closed: bool) -> ChannelEnd {
    match is_closed {
        true => ChannelEnd::Closed,
        false => ChannelEnd::Poisoned,
    }
}
