//! One connection after the other, and the traffic over each.

use super::connector::{Retry, stream};
use super::{Origin, Reconnect};
use crate::Counts;
use crate::end::Stop;
use crate::pump::{Kind, OnBad, pump_in, pump_out};
use luna::external::{FromBytes, LinkError, Packer, Splitter, ToBytes, Wire};
use luna::{Receiver, Sender};
use std::future::{Future, poll_fn};
use std::net::{Shutdown, TcpStream};
use std::pin::pin;
use std::task::Poll;
use std::time::Duration;

/// What outlives a connection.
pub(super) struct Traffic<'a, O, I> {
    /// Until its senders are gone.
    pub(super) outgoing: Option<Receiver<O>>,
    /// Until its receivers are gone.
    pub(super) incoming: Option<Sender<I>>,
    pub(super) splitter: &'a mut Splitter,
    pub(super) packer: &'a mut Packer,
    pub(super) is_unsent: bool,
    pub(super) patience: Option<Duration>,
    /// Whether it ends as soon as `incoming` has no receiver.
    pub(super) until_unread: bool,
    pub(super) on_bad: OnBad,
    pub(super) sent: &'a Counts,
    pub(super) received: &'a Counts,
}

impl<O: ToBytes + Send, I: FromBytes + Send> Traffic<'_, O, I> {
    /// Makes one connection after the other, until both channels have ended, or no connection can
    /// be made.
    pub(super) async fn keep_up(&mut self, origin: &Origin, policy: Reconnect) -> Stop {
        let mut retry = Retry::new(policy);
        loop {
            let stream = match self.stream(origin, &mut retry).await {
                Ok(stream) => stream,
                Err(stop) => return stop,
            };
            self.received.connection();
            let (begun, before) = (luna::now(), [self.sent.records(), self.received.records()]);
            let broken = match self.carry(&stream).await {
                Ok(()) => return Stop::Closed,
                Err(stop @ (Stop::HungUp | Stop::Failed(_))) => stop,
                Err(stop) => return stop,
            };
            let is_over = self.outgoing.is_none();
            if is_over && matches!(broken, Stop::HungUp) {
                return Stop::Closed;
            }
            if policy == Reconnect::NEVER && matches!(origin, Origin::Connect(_)) {
                return broken;
            }
            let [has_sent, has_received] = [
                self.sent.records() > before[0],
                self.received.records() > before[1],
            ];
            // Sent data may have come no further than the kernel, where the other side closes at
            // once.
            if has_received || has_sent && luna::now() - begun > retry.pause {
                retry = Retry::new(policy);
            } else if retry.is_last() && matches!(origin, Origin::Connect(_)) {
                return broken;
            }
        }
    }

    /// The next connection, unless a channel is poisoned or both have ended meanwhile.
    async fn stream(&self, origin: &Origin, retry: &mut Retry) -> Result<TcpStream, Stop> {
        let mut connected = pin!(stream(origin, retry));
        let mut out_ended = pin!(self.outgoing.as_ref().map(Receiver::poisoned));
        let mut in_ended = pin!(self.incoming.as_ref().map(Sender::ended));
        let mut is_in_closed = false;
        poll_fn(|cx| {
            if let Some(ended) = out_ended.as_mut().as_pin_mut()
                && ended.poll(cx).is_ready()
            {
                return Poll::Ready(Err(Stop::Poisoned));
            }
            if !is_in_closed
                && let Some(ended) = in_ended.as_mut().as_pin_mut()
                && let Poll::Ready(end) = ended.poll(cx)
            {
                match Stop::from(end) {
                    Stop::Closed if self.outgoing.is_some() && !self.until_unread => {
                        is_in_closed = true;
                    }
                    stop => return Poll::Ready(Err(stop)),
                }
            }
            connected.as_mut().poll(cx).map_err(Stop::Failed)
        })
        .await
    }

    /// Over one connection, until it breaks, or both channels have ended.
    async fn carry(&mut self, stream: &TcpStream) -> Result<(), Stop> {
        // A small record must not wait for the next one.
        let prepared = stream
            .set_nodelay(true)
            .and_then(|()| Ok((stream.try_clone()?, stream.try_clone()?)));
        let (one, other) =
            prepared.map_err(|error| Stop::Failed(LinkError::SetUp(error.into())))?;
        let (mut read_end, mut write_end) = (Wire::new(one.into())?, Wire::new(other.into())?);
        self.splitter.clear();
        let Self {
            outgoing,
            incoming,
            splitter,
            packer,
            is_unsent,
            patience,
            until_unread,
            on_bad,
            sent,
            received,
        } = self;
        let mut out_stop = None;
        let mut in_stop = None;
        {
            let mut out = pin!(async {
                match outgoing {
                    Some(receiver) => {
                        let kind = Kind::Stream;
                        pump_out(
                            &mut write_end,
                            packer,
                            is_unsent,
                            receiver,
                            kind,
                            *patience,
                            sent,
                        )
                        .await
                    }
                    None => Err(Stop::Closed),
                }
            });
            let mut come = pin!(async {
                match incoming {
                    Some(sender) => {
                        pump_in(
                            &mut read_end,
                            splitter,
                            sender,
                            Kind::Stream,
                            *on_bad,
                            received,
                        )
                        .await
                    }
                    None => Err(Stop::Closed),
                }
            });
            poll_fn(|cx| {
                if out_stop.is_none()
                    && let Poll::Ready(Err(stop)) = out.as_mut().poll(cx)
                {
                    // After a connection breaks, data that came before is still read; then reading
                    // ends by itself.
                    let how = match &stop {
                        Stop::Closed => Shutdown::Write,
                        _ => Shutdown::Both,
                    };
                    let _ = stream.shutdown(how);
                    let is_final = matches!(stop, Stop::Poisoned | Stop::Record(_));
                    out_stop = Some(stop);
                    if is_final {
                        return Poll::Ready(());
                    }
                }
                if in_stop.is_none()
                    && let Poll::Ready(Err(stop)) = come.as_mut().poll(cx)
                {
                    let goes_on = matches!(stop, Stop::Closed) && !*until_unread;
                    in_stop = Some(stop);
                    if !goes_on {
                        return Poll::Ready(());
                    }
                }
                match (&out_stop, &in_stop) {
                    (Some(_), Some(_)) => Poll::Ready(()),
                    _ => Poll::Pending,
                }
            })
            .await;
        }
        if matches!(out_stop, Some(Stop::Closed)) {
            self.outgoing = None;
        }
        if matches!(in_stop, Some(Stop::Closed)) {
            self.incoming = None;
        }
        // The error that came first is the cause: a write after a reset only finds it again.
        match (out_stop, in_stop) {
            (Some(stop @ (Stop::Poisoned | Stop::Record(_))), _)
            | (_, Some(stop @ (Stop::Poisoned | Stop::Record(_)))) => Err(stop),
            (Some(Stop::Closed) | None, Some(Stop::Closed) | None) => Ok(()),
            (Some(Stop::Closed) | None, Some(stop)) | (Some(stop), _) => Err(stop),
        }
    }
}
