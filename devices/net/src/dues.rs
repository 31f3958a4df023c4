//! The messages that a side owes to its partner.

use crate::age::now_nanos;
use crate::message::{Beat, Body, Head, Hello, encode};
use crate::peering::Peering;
use crate::side::Values;
use luna::Instant;
use luna::channel::ChannelEnd;

impl Peering {
    /// The next message that is due. `taken` is the number of the last value that was taken here.
    pub(crate) fn next_message(&mut self, taken: u64, now: Instant) -> Option<Vec<u8>> {
        let from = self.own.number;
        if let Some(to) = self.owes_busy.take()
            && let Some(partner) = &self.partner
        {
            let (pid, host) = (partner.peer.pid, partner.peer.host.clone());
            return Some(encode(Head { from, to }, &Body::Busy { pid, host }, |_| ()));
        }
        let to = self.partner.as_ref().map_or(0, |partner| partner.number);
        let head = Head { from, to };
        if std::mem::take(&mut self.owes_hello) {
            return Some(encode(head, &Body::Hello(self.hello()), |_| ()));
        }
        if self.partner.is_none() {
            // Nobody waits for these.
            (self.owes_beat, self.owes_end) = (false, false);
            return None;
        }
        if let Some(values) = self.next_values(head) {
            return Some(values);
        }
        if std::mem::take(&mut self.owes_beat) {
            let arrived = match &self.values {
                Values::In { arrived, .. } => *arrived,
                Values::Out(_) => 0,
            };
            let beat = Beat {
                taken,
                arrived,
                sent: now_nanos(),
                seen: self.clocks.seen_here(now),
            };
            return Some(encode(head, &Body::Beat(beat), |_| ()));
        }
        if std::mem::take(&mut self.owes_end) {
            let there = self.partner.as_ref().and_then(|partner| partner.end);
            let end = self.end.or(there).unwrap_or(ChannelEnd::Closed);
            let is_poisoned = end == ChannelEnd::Poisoned;
            let is_answer = there.is_some();
            let end = Body::End {
                is_poisoned,
                is_answer,
            };
            return Some(encode(head, &end, |_| ()));
        }
        None
    }

    fn hello(&self) -> Hello {
        let own = &self.own;
        Hello {
            type_name: own.info.name.clone(),
            type_version: own.info.version,
            pid: own.peer.pid,
            host: own.peer.host.clone(),
            clock: own.clock,
            last: own.memory.last,
            session: own.memory.session,
            window: own.window,
        }
    }

    /// Values that wait, as far as the partner has room for them.
    fn next_values(&mut self, head: Head) -> Option<Vec<u8>> {
        let Values::Out(outbox) = &mut self.values else {
            return None;
        };
        let takes = self
            .partner
            .as_ref()
            .is_some_and(|partner| partner.is_joined && partner.end.is_none());
        if self.end.is_some() || !takes {
            return None;
        }
        let first = outbox.next()?;
        let body = Body::Values { first };
        Some(encode(head, &body, |message| outbox.fill(message)))
    }
}
