//! What one side knows of the other.

use super::datagram::{Echo, Head, Kind};
use super::estimate::{Offset, OffsetBounds};
use super::protocol::Moment;
use luna::Instant;
use luna::time::Stamp;

/// How many datagrams back duplicates are distinguished from overtaken ones.
const WINDOW: u64 = 128;

/// No partner sends so many datagrams between two that arrive: at 100 kHz it would take 11 hours.
const MAX_GAP: u64 = 1 << 32;

/// A session that was heard, and is not yet known to be alive.
#[derive(Debug)]
pub(super) struct Candidate {
    pub(super) session: u64,
    /// The number of the first datagram that was sent to it.
    pub(super) addressed: Option<u64>,
    pub(super) echo: Echo,
}

impl Candidate {
    pub(super) fn new(session: u64, echo: Echo) -> Self {
        Self {
            session,
            addressed: None,
            echo,
        }
    }

    /// Whether this datagram was sent after the session had received one that was sent to it by
    /// this very opening.
    pub(super) fn has_answered(&self, head: &Head, own: u64) -> bool {
        let heard = head.echo.map_or(0, |echo| echo.number);
        head.to == own && self.addressed.is_some_and(|first| heard >= first)
    }
}

/// What a datagram's number shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum News {
    Newest,
    Duplicate,
    Overtaken,
    /// Sent before both sides had heard each other.
    Early,
    /// The partner does not count like that.
    Impossible,
}

/// The session that values are taken from.
#[derive(Debug)]
pub(super) struct Partner {
    pub(super) session: u64,
    /// When its newest datagram came.
    pub(super) heard: Instant,
    pub(super) echo: Echo,
    /// The number of the first datagram.
    first: u64,
    /// The number of the newest datagram.
    newest: u64,
    /// Bit n: the datagram n before the newest has come.
    window: u128,
    /// The sequence of the newest value; none before the first.
    sequence: Option<u64>,
    bounds: OffsetBounds,
}

impl Partner {
    /// The sender of this datagram, which has not been [taken](Self::take) yet.
    pub(super) fn new(head: &Head, drift_ppm: u32, now: Moment) -> Self {
        Self {
            session: head.from,
            heard: now.instant,
            echo: Echo {
                number: head.number,
                sent: head.sent,
                received: now.stamp,
            },
            first: head.number,
            newest: head.number - 1,
            window: 0,
            sequence: None,
            bounds: OffsetBounds::new(drift_ppm),
        }
    }

    /// Notes the datagram's number.
    pub(super) fn take(&mut self, head: &Head) -> News {
        if head.number > self.newest {
            let before = self.sequence.unwrap_or(head.sequence);
            let is_next = match head.kind {
                Kind::Value => self.sequence.is_none() || head.sequence > before,
                Kind::Hello => head.sequence >= before,
            };
            let on = head.number - self.newest;
            if !is_next || head.sequence - before > MAX_GAP || on > MAX_GAP {
                return News::Impossible;
            }
            self.window = match on < WINDOW {
                true => self.window << on | 1,
                false => 1,
            };
            self.newest = head.number;
            return News::Newest;
        }
        if head.number < self.first {
            return News::Early;
        }
        let back = self.newest - head.number;
        if back >= WINDOW {
            // It may have come before: nobody knows.
            return News::Overtaken;
        }
        if self.window >> back & 1 == 1 {
            return News::Duplicate;
        }
        self.window |= 1 << back;
        News::Overtaken
    }

    /// How many values before this one are missing.
    pub(super) fn lost_before(&mut self, sequence: u64) -> u64 {
        let before = self.sequence.replace(sequence);
        before.map_or(0, |before| sequence - before - 1)
    }

    /// Measures both ways by a datagram. Returns how often it contradicted what was known.
    pub(super) fn measure(&mut self, head: &Head, own: u64, now: Stamp) -> u64 {
        let mut steps = u64::from(self.bounds.came(head.sent, now));
        if let Some(echo) = head.echo.filter(|_| head.to == own) {
            let was_set = self.bounds.went(echo.sent, echo.received, now);
            steps += u64::from(was_set);
        }
        steps
    }

    /// The offset at `now`; `errors` are those that both sides state of their TAI. Also whether
    /// those contradict what was measured; they are then not used.
    pub(super) fn offset(&self, errors: Option<(u64, u64)>, now: Stamp) -> (Option<Offset>, bool) {
        let measured = self.bounds.at(now);
        let Some((measured, (own, other))) = measured.zip(errors) else {
            return (measured, false);
        };
        match measured.also_within(own.saturating_add(other)) {
            Some(narrow) => (Some(narrow), false),
            None => (Some(measured), true),
        }
    }
}
