//! The protocol without a socket: datagrams and stamps in, datagrams and samples out.

use super::data::{CycleData, TypeIdentity};
use super::datagram::{Echo, HEAD, Head, Kind, MAX_DATAGRAM, MAX_SIZE};
use super::estimate::{Offset, drift};
use super::partner::{Candidate, News, Partner};
use super::sample::{Converted, Measured, Sample, Silence};
use super::settings::Settings;
use super::status::Status;
use luna::Instant;
use luna::time::{Stamp, StampClock};
use std::marker::PhantomData;
use std::time::Duration;

/// The same moment on both clocks that a link goes by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Moment {
    /// On the clock of the stamps.
    pub stamp: Stamp,
    /// On the clock of the loops, for deadlines.
    pub instant: Instant,
}

/// What a datagram was: see [`Protocol::receive`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Received<T> {
    /// A value, newer than all before.
    Sample(Sample<T>),
    /// The partner does not know yet that it was heard: send it a [hello](Protocol::hello) now.
    Answer,
    /// Nothing to be done. If it was dropped, it was counted.
    Nothing,
}

/// One side of the protocol of a [`CycleLink`](super::CycleLink), for a wire of your own and for
/// simulations: no socket, no clock, no waiting. `O` is sent, `I` received.
///
/// Each opening is a *session* with a random number. A side takes values from a session only when
/// that has answered a datagram which this side has sent to it. So no datagram of an earlier opening
/// is ever delivered. While a partner is alive, that is heard within the limit, no other session
/// takes its place.
///
/// Real-time path: all but [`new`](Self::new); O(1) and the conversion of the value, no allocation,
/// no system call.
///
/// ```
/// use luna::Instant;
/// use luna::time::Stamp;
/// use luna_links::cycle::{Moment, Protocol, Received, Settings};
/// use std::time::Duration;
///
/// let settings = Settings::new(Duration::from_millis(1));
/// let at = |nanos| Moment {
///     stamp: Stamp::from_nanos(nanos),
///     instant: Instant::from_nanos(nanos),
/// };
/// let mut here = Protocol::<[u8; 2], [u8; 4]>::new(1, &settings, at(0));
/// let mut there = Protocol::<[u8; 4], [u8; 2]>::new(2, &settings, at(0));
///
/// // Both hear each other, and then a value crosses in 30 ns.
/// let hello = there.hello(at(10)).to_vec();
/// assert_eq!(here.receive(&hello, at(40)), Received::Answer);
/// let hello = here.hello(at(50)).to_vec();
/// assert_eq!(there.receive(&hello, at(80)), Received::Answer);
/// let value = there.send(&[1, 2, 3, 4], None, at(90)).to_vec();
/// let Received::Sample(sample) = here.receive(&value, at(120)) else { panic!() };
/// assert_eq!((sample.value, sample.lost_before), ([1, 2, 3, 4], 0));
/// let age = sample.age.unwrap();
/// let real = Duration::from_nanos(30);
/// assert!(age.time <= real + age.error && real <= age.time + age.error);
/// ```
#[derive(Debug)]
pub struct Protocol<O, I> {
    session: u64,
    limit: Duration,
    drift_ppm: u32,
    clock: StampClock,
    clock_error: Option<u64>,
    /// Of the last datagram.
    number: u64,
    /// Of the last value.
    sequence: u64,
    partner: Option<Partner>,
    candidate: Option<Candidate>,
    /// When the last value came, or the protocol began.
    fresh: Instant,
    has_heard: bool,
    is_stale: bool,
    bytes: Box<[u8; MAX_DATAGRAM]>,
    status: Status,
    _values: PhantomData<fn(O) -> I>,
}

impl<O: CycleData, I: CycleData> Protocol<O, I> {
    const FITS: () = assert!(
        O::SIZE <= MAX_SIZE && I::SIZE <= MAX_SIZE,
        "a value crosses in one datagram, so it has at most MAX_SIZE bytes"
    );

    /// A side with this session number, which is another one for each opening and not 0.
    pub fn new(session: u64, settings: &Settings, now: Moment) -> Self {
        let () = Self::FITS;
        Self {
            session: session.max(1),
            limit: settings.limit(),
            drift_ppm: settings.drift_ppm,
            clock: settings.stamps.clock(),
            clock_error: None,
            number: 0,
            sequence: 0,
            partner: None,
            candidate: None,
            fresh: now.instant,
            has_heard: false,
            is_stale: false,
            bytes: Box::new([0; MAX_DATAGRAM]),
            status: Status::default(),
            _values: PhantomData,
        }
    }

    /// What it counts.
    pub fn status(&self) -> Status {
        self.status.clone()
    }

    pub(super) fn limit(&self) -> Duration {
        self.limit
    }

    /// States by how much the clock of the stamps may differ from TAI. Only for stamps of TAI.
    pub fn set_clock_error(&mut self, error: Option<Duration>) {
        let error = error.filter(|_| self.clock == StampClock::Tai);
        self.clock_error =
            error.map(|error| u64::try_from(error.as_nanos()).unwrap_or(u64::MAX - 1));
    }

    /// The datagram with a value, to be sent at once; `tick` is the slot of the loop that sends.
    pub fn send(&mut self, value: &O, tick: Option<Stamp>, now: Moment) -> &[u8] {
        self.sequence += 1;
        value.to_bytes(&mut self.bytes[HEAD..HEAD + O::SIZE]);
        self.head(Kind::Value, tick, now);
        &self.bytes[..HEAD + O::SIZE]
    }

    /// A datagram without a value, to be sent at once: the answer to
    /// [`Received::Answer`], or a sign of life.
    pub fn hello(&mut self, now: Moment) -> &[u8] {
        self.head(Kind::Hello, None, now);
        &self.bytes[..HEAD]
    }

    fn head(&mut self, kind: Kind, tick: Option<Stamp>, now: Moment) {
        self.number += 1;
        let (to, echo) = match (&mut self.candidate, &self.partner) {
            (Some(candidate), _) => {
                candidate.addressed.get_or_insert(self.number);
                (candidate.session, Some(candidate.echo))
            }
            (None, Some(partner)) => (partner.session, Some(partner.echo)),
            (None, None) => (0, None),
        };
        let head = Head {
            kind,
            clock: self.clock,
            from: self.session,
            to,
            of: TypeIdentity::of::<O>(),
            number: self.number,
            sequence: self.sequence,
            sent: now.stamp,
            clock_error: self.clock_error,
            echo,
            tick,
        };
        head.encode(&mut self.bytes);
    }

    /// Takes a datagram, of whatever bytes, that came at `now`.
    pub fn receive(&mut self, bytes: &[u8], now: Moment) -> Received<I> {
        let Some((head, value)) = Head::decode(bytes) else {
            self.status.count(|counters| &counters.malformed);
            return Received::Nothing;
        };
        if head.of != TypeIdentity::of::<I>() {
            self.status.0.other_type.set(head.of);
            self.status.count(|counters| &counters.mistyped);
            return Received::Nothing;
        }
        if self
            .partner
            .as_ref()
            .is_none_or(|partner| partner.session != head.from)
        {
            match self.introduce(&head, now) {
                Some(partner) => self.join(partner),
                None if self.candidate.is_some() => return Received::Answer,
                None => return Received::Nothing,
            }
        }
        self.hear(&head, value, now)
    }

    /// A datagram of another session than the partner's: the partner, if it is proved to have
    /// answered, else perhaps a candidate.
    fn introduce(&mut self, head: &Head, now: Moment) -> Option<Partner> {
        let limit = self.limit;
        let is_alive = |partner: &Partner| now.instant - partner.heard <= limit;
        let is_taken = self.partner.as_ref().is_some_and(is_alive);
        if head.from == self.session || is_taken {
            self.candidate = None;
            self.status.count(|counters| &counters.foreign);
            return None;
        }
        let echo = Echo {
            number: head.number,
            sent: head.sent,
            received: now.stamp,
        };
        let known = self
            .candidate
            .take()
            .filter(|candidate| candidate.session == head.from);
        let mut candidate = known.unwrap_or_else(|| Candidate::new(head.from, echo));
        if candidate.has_answered(head, self.session) {
            return Some(Partner::new(head, self.drift_ppm, now));
        }
        if head.number > candidate.echo.number {
            candidate.echo = echo;
        }
        self.candidate = Some(candidate);
        self.status.count(|counters| &counters.foreign);
        None
    }

    fn join(&mut self, partner: Partner) {
        self.partner = Some(partner);
        self.candidate = None;
        self.status.count(|counters| &counters.sessions);
    }

    /// A datagram of the partner.
    fn hear(&mut self, head: &Head, value: &[u8], now: Moment) -> Received<I> {
        let Some(partner) = &mut self.partner else {
            return Received::Nothing;
        };
        let status = &self.status;
        // One whose bytes mean nothing counts as lost, as if it had not come.
        let value = match head.kind {
            Kind::Hello => None,
            Kind::Value => match I::from_bytes(value) {
                Ok(value) => Some(value),
                Err(_) => {
                    status.count(|counters| &counters.malformed);
                    return Received::Nothing;
                }
            },
        };
        match partner.take(head) {
            News::Newest => {}
            News::Duplicate => {
                status.count(|counters| &counters.duplicates);
                return Received::Nothing;
            }
            News::Overtaken => {
                if head.kind == Kind::Value {
                    status.count(|counters| &counters.overtaken);
                }
                return Received::Nothing;
            }
            News::Early => {
                status.count(|counters| &counters.foreign);
                return Received::Nothing;
            }
            News::Impossible => {
                status.count(|counters| &counters.malformed);
                return Received::Nothing;
            }
        }
        self.candidate = None;
        partner.heard = now.instant;
        partner.echo = Echo {
            number: head.number,
            sent: head.sent,
            received: now.stamp,
        };
        let steps = partner.measure(head, self.session, now.stamp);
        status.add(|counters| &counters.clock_steps, steps);
        let other = head.clock_error.filter(|_| head.clock == StampClock::Tai);
        let both = self.clock_error.zip(other);
        let (offset, contradicts) = partner.offset(both, now.stamp);
        status.add(
            |counters| &counters.clock_contradictions,
            contradicts.into(),
        );
        status.set_offset(offset);
        let Some(value) = value else {
            return Received::Nothing;
        };
        let lost_before = partner.lost_before(head.sequence);
        status.add(|counters| &counters.lost, lost_before);
        status.count(|counters| &counters.received);
        self.fresh = now.instant;
        (self.has_heard, self.is_stale) = (true, false);
        let drift_ppm = self.drift_ppm;
        let on_own = |stamp, offset| converted(stamp, offset, now.stamp, drift_ppm);
        Received::Sample(Sample {
            value,
            sequence: head.sequence,
            lost_before,
            skipped: 0,
            session: status.sessions(),
            sent: head.sent,
            received: now.stamp,
            age: offset.map(|offset| age(on_own(head.sent, offset), now.stamp)),
            tick: offset
                .zip(head.tick)
                .map(|(offset, tick)| on_own(tick, offset)),
        })
    }

    /// Whether the partner is silent for longer than the settings allow. Counted once for each
    /// silence.
    pub fn silence(&mut self, now: Instant) -> Option<Silence> {
        if now - self.fresh <= self.limit {
            return None;
        }
        if !self.is_stale {
            self.is_stale = true;
            self.status.count(|counters| &counters.stale);
        }
        Some(Silence {
            since: self.fresh,
            limit: self.limit,
            has_heard: self.has_heard,
        })
    }

    /// When the partner will have been silent for too long.
    pub fn deadline(&self) -> Instant {
        self.fresh + self.limit
    }
}

/// A stamp of the partner on this computer's clock; the offset is that of `now`, and has drifted
/// since.
fn converted(stamp: Stamp, offset: Offset, now: Stamp, drift_ppm: u32) -> Converted {
    let at = stamp.plus_nanos(offset.nanos.saturating_neg());
    let error = offset.error.saturating_add(drift(at, now, drift_ppm));
    Converted {
        at,
        error: Duration::from_nanos(error),
    }
}

/// An age is not negative, so one that seems so is 0, which is closer.
fn age(sent: Converted, received: Stamp) -> Measured {
    let age = received.nanos_since(sent.at);
    Measured {
        time: Duration::from_nanos(u64::try_from(age).unwrap_or(0)),
        error: sent.error,
    }
}
