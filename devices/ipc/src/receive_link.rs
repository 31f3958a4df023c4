//! The link of the side that answers: it receives, or serves.

use crate::IpcError;
use crate::codec::Place;
use crate::link::{Bound, Link, Near, Stop};
use crate::send_link::end_of;
use crate::session::Session;
use crate::wait::{First, Seen, Waits};
use luna::Sender;
use luna::channel::ChannelEnd;
use std::pin::pin;
use std::sync::atomic::Ordering::SeqCst;

/// The link of the receiving side, made by [`receiver`](crate::receiver).
pub type ReceiveLink<T> = Link<Inward<Deliveries<T>>>;

/// What a link delivers to its local channel.
pub(crate) trait Drain: Send {
    type Value;
    /// What goes back when the value was taken.
    type Answer;

    async fn ended(&self) -> ChannelEnd;

    fn poison(&self);

    /// # Safety
    ///
    /// This is the receiver of the session, and a value is under way in it.
    unsafe fn read(&self, session: &Session) -> Result<Self::Value, IpcError>;

    async fn deliver(&self, value: Self::Value) -> Result<Self::Answer, ChannelEnd>;

    /// # Safety
    ///
    /// As for `read`: this is the receiver of the session, and a value is under way in it, the
    /// sender of which waits.
    unsafe fn answer(&self, session: &Session, answer: Self::Answer) -> Result<(), IpcError>;

    /// The link has joined: its thread is this one until the result is dropped.
    fn joined(&self, session: &Session) -> impl Sized;

    /// The sender was woken.
    fn answered(&self, session: &Session);
}

/// To a channel.
#[expect(missing_debug_implementations, reason = "only links hold it")]
pub struct Deliveries<T> {
    sender: Sender<T>,
    place: Place<T>,
}

impl<T: Send> Deliveries<T> {
    pub(crate) fn new(sender: Sender<T>, place: Place<T>) -> Self {
        let sender = sender.external();
        Self { sender, place }
    }
}

impl<T: Send> Drain for Deliveries<T> {
    type Value = T;
    type Answer = ();

    async fn ended(&self) -> ChannelEnd {
        self.sender.ended().await
    }

    fn poison(&self) {
        self.sender.poison();
    }

    unsafe fn read(&self, session: &Session) -> Result<T, IpcError> {
        // SAFETY: the caller promises that this is the receiver, and that a value is under way: the
        // sender has written it whole, with the codec of the type that both state, and does not
        // write again before it is taken.
        unsafe { self.place.read(session) }
    }

    async fn deliver(&self, value: T) -> Result<(), ChannelEnd> {
        let sent = self.sender.send(value).await;
        sent.map_err(|error| end_of(error.is_closed()))
    }

    unsafe fn answer(&self, _: &Session, (): ()) -> Result<(), IpcError> {
        Ok(())
    }

    fn joined(&self, _: &Session) -> impl Sized {}

    fn answered(&self, _: &Session) {}
}

/// A link that answers: the near side of it.
#[expect(missing_debug_implementations, reason = "only links hold it")]
pub struct Inward<D>(pub(crate) D);

/// What the words of a sender show.
enum Next {
    Value(u64),
    End(ChannelEnd),
}

impl<D: Drain> Near for Inward<D> {
    async fn alone(&self, waits: &mut Waits<'_, '_>) -> Result<First<ChannelEnd, ()>, IpcError> {
        waits.partner(pin!(self.0.ended())).await
    }

    async fn carry(&self, bound: &mut Bound<'_, '_>) -> Result<Stop, IpcError> {
        let _joined = self.0.joined(bound.session);
        // A client's link may wait for that.
        bound.session.ring(bound.partner);
        let mut number = bound.partner.start;
        let mut ended = pin!(self.0.ended());
        loop {
            let next = |session: &Session| match session.words().published() {
                published if published != number => Some(Next::Value(published)),
                _ => session.partners_end().map(|end| Next::End(end.into())),
            };
            let published = match bound.waits.first(ended.as_mut(), next).await? {
                First::Own(end) => return Ok(bound.end(end)),
                First::Other(Seen::Word(Next::Value(published))) => published,
                First::Other(Seen::Word(Next::End(end))) => return Ok(Stop::Ended(end)),
                First::Other(Seen::Death) => return Ok(bound.died()),
            };
            if published != number.wrapping_add(1) {
                return Err(bound.broken(published, number));
            }
            // SAFETY: this is the receiver of the bound session, in which the number was published,
            // and `taken` is stored below.
            let value = match unsafe { self.0.read(bound.session) } {
                Ok(value) => value,
                Err(error) => {
                    bound.end(ChannelEnd::Poisoned);
                    return Err(error);
                }
            };
            bound.report(published, true);
            let delivery = pin!(self.0.deliver(value));
            let answer = match bound.waits.first(delivery, Session::partners_end).await? {
                First::Own(Ok(answer)) => answer,
                First::Own(Err(end)) => return Ok(bound.end(end)),
                First::Other(Seen::Word(end)) => return Ok(Stop::Ended(end.into())),
                First::Other(Seen::Death) => return Ok(bound.died()),
            };
            // SAFETY: this is the receiver of the bound session, and the value that it has read is
            // under way until `taken` is stored below.
            if let Err(error) = unsafe { self.0.answer(bound.session, answer) } {
                bound.end(ChannelEnd::Poisoned);
                return Err(error);
            }
            number = published;
            bound.session.own().number.store(number, SeqCst);
            bound.session.ring(bound.partner);
            bound.status.acknowledge(number);
            self.0.answered(bound.session);
        }
    }

    fn poison(&self) {
        self.0.poison();
    }
}
