//! The protocol of one opening of a side: its partner, and what is under way. It does no
//! input or output: zenoh's threads and the link's own put events in, and the latter takes
//! messages out.

use crate::age::ClockDifference;
use crate::batch::Batch;
use crate::error::TypeInfo;
use crate::inbox::Accepted;
use crate::message::{Beat, Body, Broken, Head, Hello, end_of, next_value};
use crate::side::{Event, Events, Memory, Own, Partner, Stop, Values};
use crate::{NetError, Peer, Sign, Status};
use luna::Instant;
use luna::channel::ChannelEnd;

pub(crate) struct Peering {
    pub(crate) own: Own,
    status: Status,
    pub(crate) values: Values,
    pub(crate) partner: Option<Partner>,
    pub(crate) clocks: ClockDifference,
    /// Another opening of the partner's role that says hello, and since when.
    rival: Option<(u64, Instant)>,
    is_over: bool,
    /// What was reported to the partner.
    reported: u64,
    pub(crate) end: Option<ChannelEnd>,
    pub(crate) owes_hello: bool,
    pub(crate) owes_beat: bool,
    pub(crate) owes_end: bool,
    pub(crate) owes_busy: Option<u64>,
}

impl Peering {
    pub(crate) fn new(own: Own, status: Status, values: Values) -> Self {
        Self {
            own,
            status,
            values,
            partner: None,
            clocks: ClockDifference::new(false),
            rival: None,
            is_over: false,
            reported: 0,
            end: None,
            owes_hello: true,
            owes_beat: false,
            owes_end: false,
            owes_busy: None,
        }
    }

    pub(crate) fn is_joined(&self) -> bool {
        self.partner
            .as_ref()
            .is_some_and(|partner| partner.is_joined)
    }

    /// The first reason counts.
    fn stop(&mut self, stop: Stop) -> Option<Event> {
        (!std::mem::replace(&mut self.is_over, true)).then_some(Event::Stop(stop))
    }

    fn lost(&mut self, sign: Sign) -> Option<Event> {
        let partner = self.partner.take().filter(|partner| partner.is_joined)?;
        let error = NetError::PartnerLost {
            name: self.own.name.clone(),
            role: self.own.role.other(),
            peer: partner.peer,
            sign,
            acknowledged: self.status.acknowledged(),
            in_doubt: self.status.in_doubt(),
        };
        self.stop(Stop::Failed(error))
    }

    /// A message has arrived.
    pub(crate) fn hear(&mut self, head: Head, body: Body, values: &[u8], now: Instant) -> Events {
        let is_for_this = head.to == self.own.number;
        let is_partner = self
            .partner
            .as_ref()
            .is_some_and(|partner| partner.number == head.from);
        if let Body::Hello(hello) = body {
            return [self.greet(head, hello, is_partner, now), None];
        }
        if let (Body::Busy { pid, host }, true) = (&body, is_for_this) {
            if self.is_joined() {
                return [None, None];
            }
            let (pid, host) = (*pid, host.clone());
            let busy = NetError::Busy {
                name: self.own.name.clone(),
                role: self.own.role,
                holder: Peer { pid, host },
            };
            return [self.stop(Stop::Failed(busy)), None];
        }
        if !is_partner || !is_for_this {
            // Others may be addressed on the same way.
            if is_for_this {
                self.status.drop_one();
            }
            return [None, None];
        }
        let joined = self.join(now);
        let heard = match body {
            Body::Beat(beat) => {
                self.beat(beat, now);
                None
            }
            Body::Values { first } => self.receive(first, values, now),
            Body::End {
                is_poisoned,
                is_answer,
            } => {
                let end = end_of(is_poisoned);
                if let Some(partner) = &mut self.partner {
                    partner.end = Some(end);
                }
                self.owes_end |= !is_answer;
                self.stop(Stop::Ended(end))
            }
            Body::Hello(_) | Body::Busy { .. } => None,
        };
        [joined, heard]
    }

    fn greet(&mut self, head: Head, hello: Hello, is_partner: bool, now: Instant) -> Option<Event> {
        if is_partner {
            if head.to == self.own.number {
                return self.join(now);
            }
            // It has not heard this side, or it has bound itself to another.
            if !self.is_joined() && head.to != 0 {
                self.partner = None;
            }
            self.owes_hello |= self.end.is_none();
            return None;
        }
        if let Some(partner) = &self.partner {
            let rival = match self.rival {
                Some(rival) if rival.0 == head.from => rival,
                _ => *self.rival.insert((head.from, now)),
            };
            // What is heard so late was sent while the rival lived.
            if partner.is_joined && partner.heard > rival.1 + self.own.lost_after {
                self.owes_busy = Some(head.from);
            }
            return None;
        }
        if self.is_over || self.end.is_some() {
            return None;
        }
        self.owes_hello = true;
        // Numbers that cannot be reached by counting are no numbers, and nothing passes through a
        // window of none.
        let is_sound = hello.last.max(hello.session) < u64::MAX / 2 && hello.window > 0;
        if !is_sound {
            self.status.drop_one();
            return None;
        }
        if head.to != 0 && head.to != self.own.number {
            return None;
        }
        let peer = Peer {
            pid: hello.pid,
            host: hello.host,
        };
        let there = TypeInfo {
            name: hello.type_name,
            version: hello.type_version,
        };
        if there != self.own.info {
            return self.stop(Stop::Failed(NetError::Type {
                name: self.own.name.clone(),
                role: self.own.role,
                here: Box::new(self.own.info.clone()),
                there: Box::new(there),
                peer,
            }));
        }
        let memory = self.own.memory;
        let start = memory.last.max(hello.last);
        match &mut self.values {
            Values::Out(outbox) => outbox.start(start),
            Values::In { arrived, .. } => *arrived = start,
        }
        self.clocks = ClockDifference::new(hello.clock == self.own.clock);
        self.partner = Some(Partner {
            number: head.from,
            peer,
            session: memory.session.max(hello.session) + 1,
            start,
            window: self.own.window.min(hello.window),
            heard: now,
            is_joined: false,
            arrived: start,
            behind: 0,
            end: None,
        });
        match head.to == self.own.number {
            true => self.join(now),
            false => None,
        }
    }

    /// The partner has named this side.
    fn join(&mut self, now: Instant) -> Option<Event> {
        let partner = self.partner.as_mut()?;
        partner.heard = now;
        if self.is_over || std::mem::replace(&mut partner.is_joined, true) {
            return None;
        }
        let known = self.own.memory.acknowledged;
        let missing = known.map_or(0, |known| partner.start - known.min(partner.start));
        let (peer, window) = (partner.peer.clone(), partner.window);
        self.status
            .join(peer, partner.session, partner.start, missing);
        // The partner may wait for it, unless it hears of the end.
        self.owes_hello |= self.end.is_none();
        Some(Event::Joined { window })
    }

    fn beat(&mut self, beat: Beat, now: Instant) {
        self.clocks.arrived(beat.sent, now);
        if let Some(seen) = beat.seen {
            self.clocks.seen_there(seen, now);
        }
        let Values::Out(outbox) = &mut self.values else {
            return;
        };
        let count = outbox.acknowledge(beat.taken);
        if count > 0 {
            self.status.acknowledge(outbox.acknowledged(), count);
            outbox.notify();
        }
        if let Some(partner) = &mut self.partner
            && beat.arrived > partner.arrived
        {
            partner.arrived = beat.arrived;
            partner.behind = 0;
        }
    }

    fn receive(&mut self, first: u64, mut values: &[u8], now: Instant) -> Option<Event> {
        let mut number = first;
        let Values::In { inbox, arrived, .. } = &mut self.values else {
            return None;
        };
        while !values.is_empty() && !self.is_over {
            let value = next_value(&mut values);
            let decoded = match value {
                Some((sent, bytes)) if number == *arrived + 1 => {
                    inbox.take(number, now, self.clocks.sent(sent, now), bytes)
                }
                // It came before: the acknowledgement may be lost. Or one before it is missing, and
                // will be sent again.
                Some(_) => {
                    self.owes_beat = true;
                    Ok(Accepted::No)
                }
                None => Err("the message is cut off".to_owned()),
            };
            match decoded {
                Ok(Accepted::Yes) => *arrived = number,
                Ok(Accepted::No) => {}
                Err(why) => {
                    let peer = self.partner.as_ref().map(|partner| partner.peer.clone());
                    let error = NetError::Decode {
                        name: self.own.name.clone(),
                        number,
                        peer: peer.unwrap_or_else(|| self.own.peer.clone()),
                        why,
                    };
                    return self.stop(Stop::Failed(error));
                }
            }
            number = number.wrapping_add(1);
        }
        inbox.deliver();
        None
    }

    /// A token of the partner's role has appeared.
    pub(crate) fn appeared(&mut self) {
        self.owes_hello |= !self.is_joined() && !self.is_over && self.end.is_none();
    }

    /// A token of the partner's role has gone.
    pub(crate) fn gone(&mut self, number: u64) -> Option<Event> {
        match &self.partner {
            Some(partner) if partner.number == number => self.lost(Sign::Disconnected),
            _ => None,
        }
    }

    /// A message could not be read. Anybody may have sent it: it changes nothing.
    pub(crate) fn drop_broken(&mut self, broken: Broken) {
        self.status.drop_one();
        if broken == Broken::OtherVersion {
            self.status.hear_other_version();
        }
    }

    /// A period has passed.
    pub(crate) fn tick(&mut self, now: Instant) -> Option<Event> {
        match &mut self.partner {
            Some(partner) => {
                if now - partner.heard > self.own.lost_after {
                    return self.lost(Sign::Silent(self.own.lost_after));
                }
                match partner.is_joined {
                    true => self.owes_beat = true,
                    false => self.owes_hello |= self.end.is_none(),
                }
                self.owes_end |= self.end.is_some() && partner.end.is_none();
                if let Values::Out(outbox) = &mut self.values {
                    // What has arrived there is never sent again.
                    let missing = outbox.missing(partner.arrived);
                    partner.behind = match missing > 0 {
                        true => partner.behind + 1,
                        false => 0,
                    };
                    if partner.behind > 1 {
                        self.status.resend(missing as u64);
                        outbox.send_again(partner.arrived);
                        partner.behind = 0;
                    }
                }
            }
            None => self.owes_hello |= !self.is_over,
        }
        None
    }

    /// Values are to be sent.
    pub(crate) fn queue(&mut self, batch: &Batch) {
        if let Values::Out(outbox) = &mut self.values {
            outbox.add(batch);
        }
    }

    /// This side's link has ended.
    pub(crate) fn end(&mut self, end: ChannelEnd) {
        if self.end.is_none() {
            self.end = Some(end);
            self.owes_end = true;
        }
    }

    /// Whether nothing is left to be done after the end of the link.
    pub(crate) fn is_done(&self) -> bool {
        // One that is bound may have joined already.
        let waits = self
            .partner
            .as_ref()
            .is_some_and(|partner| partner.end.is_none());
        self.end.is_some() && !waits && !self.owes_end && !self.owes_hello
    }

    /// The link's thread looks, and values up to this number were taken.
    pub(crate) fn report_taken(&mut self, taken: u64) {
        if taken > self.reported {
            self.reported = taken;
            self.owes_beat |= self.is_joined();
        }
    }

    /// Whether the link's thread is to look.
    pub(crate) fn has_dues(&self) -> bool {
        let waits = match &self.values {
            Values::Out(outbox) => outbox.waits(),
            Values::In { .. } => false,
        };
        let owes = self.owes_hello || self.owes_beat || self.owes_end;
        waits || owes || self.owes_busy.is_some()
    }

    /// What this channel's next session is to know.
    pub(crate) fn memory(&self) -> Memory {
        if !self.status.has_joined() {
            return self.own.memory;
        }
        let acknowledged = self.status.number();
        Memory {
            last: match &self.values {
                Values::Out(outbox) => outbox.last(),
                Values::In { .. } => acknowledged,
            },
            acknowledged: Some(acknowledged),
            session: self.status.session(),
        }
    }
}

#[cfg(test)]
#[path = "peering_tests.rs"]
pub(crate) mod tests;
