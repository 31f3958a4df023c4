//! Two sides over a network that loses, doubles and delays messages.

use super::*;
use crate::Role;
use crate::age::Sent;
use crate::inbox::{Inbox, inbox};
use crate::message::decode;
use crate::outbox::Outbox;
use std::collections::VecDeque;
use std::sync::mpsc;
use std::time::Duration;

const SECOND: u64 = 1_000_000_000;

pub(crate) fn own(role: Role, number: u64, type_name: &str) -> Own {
    Own {
        name: "test".to_owned(),
        role,
        number,
        info: TypeInfo {
            name: type_name.to_owned(),
            version: 0,
        },
        peer: Peer {
            pid: number as u32,
            host: "here".to_owned(),
        },
        clock: number,
        memory: Memory::default(),
        window: 8,
        lost_after: Duration::from_secs(1),
    }
}

/// Delivers to a test.
struct ToTest(mpsc::Sender<u64>);

impl Inbox for ToTest {
    fn take(&mut self, _: u64, _: Instant, _: Sent, bytes: &[u8]) -> Result<Accepted, String> {
        let value = postcard::from_bytes(bytes).map_err(|error| error.to_string())?;
        self.0.send(value).unwrap();
        Ok(Accepted::Yes)
    }

    fn deliver(&mut self) {}
}

fn sender(number: u64) -> Peering {
    let values = Values::Out(Outbox::new(|| ()));
    Peering::new(own(Role::Sender, number, "u64"), Status::default(), values)
}

fn receiver(number: u64, type_name: &str) -> (Peering, mpsc::Receiver<u64>) {
    let (deliver, delivered) = mpsc::channel();
    let values = Values::receiving(Box::new(ToTest(deliver)));
    let own = own(Role::Receiver, number, type_name);
    (Peering::new(own, Status::default(), values), delivered)
}

fn batch(values: impl IntoIterator<Item = u64>) -> Batch {
    let mut batch = Batch::new(8, 10);
    for value in values {
        batch.add(&value, 0).unwrap();
    }
    batch
}

fn at(nanos: u64) -> Instant {
    Instant::from_nanos(nanos)
}

/// Carries what one side owes to the other; the events there.
fn carry(from: &mut Peering, to: &mut Peering, taken: u64, now: Instant) -> Vec<Event> {
    from.report_taken(taken);
    let mut events = Vec::new();
    while let Some(message) = from.next_message(taken, now) {
        let (head, body, values) = decode(&message).unwrap();
        events.extend(to.hear(head, body, values, now).into_iter().flatten());
    }
    events
}

fn join(one: &mut Peering, other: &mut Peering, now: Instant) {
    for _ in 0..3 {
        carry(one, other, 0, now);
        carry(other, one, 0, now);
    }
    assert!(one.is_joined() && other.is_joined());
}

#[test]
fn every_value_comes_once_and_in_order_over_a_bad_network() {
    let mut state = 88172645463325252_u64;
    let mut chance = |percent: u64| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state % 100 < percent
    };
    for loss in [0, 10, 40] {
        let (mut out, (mut inn, delivered)) = (sender(1), receiver(2, "u64"));
        let mut network: [Vec<Vec<u8>>; 2] = Default::default();
        let (mut taken, mut queued, mut now) = (0, 0, 0);
        for step in 0..40_000_u64 {
            now += SECOND / 100;
            let room = 8 - (queued - out.status.acknowledged());
            if queued < 500 && room > 0 && out.is_joined() {
                let next = queued + 1 + (step % room).min(499 - queued);
                out.queue(&batch(queued + 1..=next));
                queued = next;
            }
            if step % 25 == 0 {
                assert!(out.tick(at(now)).is_none() && inn.tick(at(now)).is_none());
            }
            while let Ok(value) = delivered.try_recv() {
                taken += 1;
                assert_eq!(value, taken, "in order, each once");
                inn.status.acknowledge(taken, 1);
            }
            inn.report_taken(taken);
            for (from, side) in [&mut out, &mut inn].into_iter().enumerate() {
                while let Some(message) = side.next_message(taken, at(now)) {
                    // A silence of a second would be a loss of the partner.
                    let is_lost = chance(loss) && step % 25 != 0;
                    if !is_lost {
                        network[from].push(message.clone());
                    }
                    if chance(loss / 2) {
                        network[from].push(message);
                    }
                }
            }
            for (from, side) in [&mut inn, &mut out].into_iter().enumerate() {
                while !network[from].is_empty() && chance(80) {
                    // Two change places at times.
                    let next = usize::from(network[from].len() > 1 && chance(loss / 2));
                    let message = network[from].remove(next);
                    let (head, body, values) = decode(&message).unwrap();
                    let events = side.hear(head, body, values, at(now));
                    let bad = events
                        .iter()
                        .flatten()
                        .find(|e| !matches!(e, Event::Joined { .. }));
                    assert!(bad.is_none(), "{bad:?}");
                }
            }
        }
        assert_eq!((queued, taken), (500, 500), "with {loss} % lost");
        assert_eq!(out.status.acknowledged(), 500);
        assert!(loss == 0 || out.status.resent() > 0);
    }
}

#[test]
fn nothing_is_sent_again_to_a_slow_receiver() {
    let mut out = sender(1);
    let (deliver, deliveries) = inbox::<u64>(8);
    let own = own(Role::Receiver, 2, "u64");
    let mut inn = Peering::new(own, Status::default(), Values::receiving(deliver));
    join(&mut out, &mut inn, at(1));
    let (mut taken, mut queued) = (0, 0);
    let mut waiting = VecDeque::new();
    // One value in a second, and four signs of life.
    for step in 1..=800 {
        let now = at(step * SECOND / 4);
        assert!(out.tick(now).is_none() && inn.tick(now).is_none());
        while queued - out.status.acknowledged() < 8 {
            queued += 1;
            out.queue(&batch([queued]));
        }
        carry(&mut out, &mut inn, 0, now);
        if step % 4 == 0 {
            if waiting.is_empty() {
                waiting = deliveries.try_next().unwrap();
            }
            taken += 1;
            let next = waiting.pop_front().unwrap();
            assert_eq!((next.number, next.value), (taken, taken));
            inn.status.acknowledge(taken, 1);
            deliveries.took_one();
        }
        carry(&mut inn, &mut out, taken, now);
    }
    assert_eq!((taken, out.status.acknowledged()), (200, 200));
    assert_eq!(out.status.resent(), 0);
}

#[test]
fn types_are_compared_on_both_sides() {
    let (mut out, (mut inn, _delivered)) = (sender(1), receiver(2, "i64"));
    let there = carry(&mut out, &mut inn, 0, at(1));
    let here = carry(&mut inn, &mut out, 0, at(1));
    for (events, own, other) in [(there, "i64", "u64"), (here, "u64", "i64")] {
        let [Event::Stop(Stop::Failed(error))] = events.as_slice() else {
            panic!("{events:?}");
        };
        let text = error.to_string();
        let (first, second) = (text.find(own), text.find(other));
        assert!(first < second && first.is_some(), "{text}");
    }
}

#[test]
fn silence_loses_the_partner_and_says_what_is_in_doubt() {
    let (mut out, (mut inn, _delivered)) = (sender(1), receiver(2, "u64"));
    join(&mut out, &mut inn, at(1));
    for value in [1, 2] {
        out.status.send(1);
        out.queue(&batch([value]));
    }
    carry(&mut out, &mut inn, 0, at(1));
    carry(&mut inn, &mut out, 1, at(1));
    assert!(out.tick(at(SECOND)).is_none());
    let Some(Event::Stop(Stop::Failed(error))) = out.tick(at(SECOND + 2)) else {
        panic!("it is not noticed");
    };
    let NetError::PartnerLost {
        acknowledged,
        in_doubt,
        sign,
        peer,
        ..
    } = error
    else {
        panic!("{error}");
    };
    assert_eq!((acknowledged, in_doubt, peer.pid), (1, 1, 2));
    assert_eq!(sign, Sign::Silent(Duration::from_secs(1)));
    // The next session goes on after both.
    assert_eq!(out.memory().last, 2);
    assert_eq!(out.memory().acknowledged, Some(1));
    assert!(out.gone(2).is_none(), "it is reported once");
}

#[test]
fn a_second_opening_is_refused_only_beside_one_that_lives() {
    let (mut out, (mut inn, _delivered)) = (sender(1), receiver(2, "u64"));
    join(&mut out, &mut inn, at(1));
    let (mut second, _none) = receiver(3, "u64");
    assert!(carry(&mut second, &mut out, 0, at(2)).is_empty());
    assert!(carry(&mut out, &mut second, 0, at(2)).is_empty());
    // The first one lives on.
    for now in 1..=5 {
        let now = at(now * SECOND / 2);
        assert!(inn.tick(now).is_none() && out.tick(now).is_none());
        carry(&mut inn, &mut out, 0, now);
        carry(&mut out, &mut inn, 0, now);
    }
    second.tick(at(3 * SECOND));
    carry(&mut second, &mut out, 0, at(3 * SECOND));
    let refused = carry(&mut out, &mut second, 0, at(3 * SECOND));
    let [Event::Stop(Stop::Failed(NetError::Busy { holder, .. }))] = refused.as_slice() else {
        panic!("{refused:?}");
    };
    assert_eq!(holder.pid, 2);
}

#[test]
fn both_sides_know_the_end_before_one_is_done() {
    let (mut out, (mut inn, _delivered)) = (sender(1), receiver(2, "u64"));
    join(&mut out, &mut inn, at(1));
    out.end(ChannelEnd::Poisoned);
    let heard = carry(&mut out, &mut inn, 0, at(2));
    assert!(matches!(
        heard.as_slice(),
        [Event::Stop(Stop::Ended(ChannelEnd::Poisoned))]
    ));
    assert!(!out.is_done());
    carry(&mut inn, &mut out, 0, at(2));
    assert!(out.is_done());
    assert!(!inn.is_done());
    inn.end(ChannelEnd::Poisoned);
    carry(&mut inn, &mut out, 0, at(2));
    assert!(inn.is_done());
}

#[test]
fn a_side_that_ends_before_it_has_joined_is_heard_by_one_that_has() {
    let (mut out, (mut inn, _delivered)) = (sender(1), receiver(2, "u64"));
    carry(&mut out, &mut inn, 0, at(1));
    // Its hello names the other, which has joined by that.
    let message = inn.next_message(0, at(1)).unwrap();
    let (head, body, values) = decode(&message).unwrap();
    out.hear(head, body, values, at(1));
    assert!(out.is_joined() && !inn.is_joined());
    inn.end(ChannelEnd::Closed);
    let heard = carry(&mut inn, &mut out, 0, at(2));
    assert!(matches!(
        heard.as_slice(),
        [Event::Stop(Stop::Ended(ChannelEnd::Closed))]
    ));
    assert!(!inn.is_done());
    carry(&mut out, &mut inn, 0, at(2));
    assert!(inn.is_done());
    // Without an answer it does not wait for ever.
    let (mut out, (mut inn, _delivered)) = (sender(1), receiver(2, "u64"));
    carry(&mut out, &mut inn, 0, at(1));
    inn.end(ChannelEnd::Closed);
    carry(&mut inn, &mut out, 0, at(2));
    assert!(!inn.is_done());
    inn.tick(at(SECOND * 2));
    assert!(inn.next_message(0, at(SECOND * 2)).is_none());
    assert!(inn.is_done());
}

#[test]
fn messages_that_make_no_sense_are_passed_over() {
    let (mut out, (mut inn, delivered)) = (sender(1), receiver(2, "u64"));
    // Numbers at the end of their range, from one that is no partner yet.
    let mut far = out.own.clone();
    (far.number, far.memory.last) = (3, u64::MAX);
    let mut far = Peering::new(far, Status::default(), Values::Out(Outbox::new(|| ())));
    assert!(carry(&mut far, &mut inn, 0, at(1)).is_empty());
    join(&mut out, &mut inn, at(1));
    let head = Head { from: 1, to: 2 };
    let mut values = Batch::new(2, 1);
    values.add(&1_u8, u64::MAX).unwrap();
    values.add(&1_u8, 0).unwrap();
    let first = u64::MAX;
    let heard = inn.hear(head, Body::Values { first }, values.bytes(), at(2));
    assert!(heard.iter().all(Option::is_none));
    assert!(delivered.try_recv().is_err());
    for seen in [i64::MIN, i64::MAX] {
        let beat = Beat {
            taken: u64::MAX,
            arrived: u64::MAX,
            sent: u64::MAX,
            seen: Some(seen),
        };
        let head = Head { from: 2, to: 1 };
        out.hear(head, Body::Beat(beat), &[], at(2));
        inn.hear(Head { from: 1, to: 2 }, Body::Beat(beat), &[], at(2));
        assert!(out.tick(at(3)).is_none() && inn.tick(at(3)).is_none());
    }
    // The session goes on.
    out.queue(&batch([1]));
    carry(&mut out, &mut inn, 0, at(4));
    assert_eq!(delivered.try_recv(), Ok(1));
}
