//! Models of four to six threads, which are too many for loom: every value arrives once, nothing is
//! lost, no thread waits for ever.

use super::{Drops, Token, check, poll, recv_id};
use crate::{
    Alternative, Barrier, Buffer, Client, Receiver, RecvError, Sender, Server, alt, buffered,
    call_channel, channel, pri_alt,
};
use loom::future::block_on;
use loom::thread;
use std::task::Poll;

/// Sends a token; returns whether it was sent, and it comes back otherwise.
fn send(sender: &Sender<Token>, token: Token) -> bool {
    let id = token.id;
    match block_on(sender.send(token)) {
        Ok(()) => true,
        Err(error) => {
            assert_eq!(error.into_inner().id, id);
            false
        }
    }
}

/// Offers one token to both channels; returns whether it was sent.
fn offer(one: &Sender<Token>, two: &Sender<Token>, drops: &Drops, id: usize) -> bool {
    let (first, second) = (drops.clone(), drops.clone());
    block_on(async {
        alt! {
            sent = one.send_with(move || first.token(id)) => sent.is_ok(),
            sent = two.send_with(move || second.token(id)) => sent.is_ok(),
        }
    })
}

/// Receives from both channels until both have ended.
fn recv_all_of_two(one: &Receiver<Token>, two: &Receiver<Token>) -> Vec<usize> {
    let mut received = Vec::new();
    loop {
        let (from, token) = block_on(async {
            pri_alt! {
                token = one.recv() => (one, token),
                token = two.recv() => (two, token),
            }
        });
        match token {
            Ok(token) => received.push(token.id),
            Err(_) => {
                let other = if std::ptr::eq(from, one) { two } else { one };
                received.extend(recv_all(other));
                return received;
            }
        }
    }
}

fn recv_all(receiver: &Receiver<Token>) -> Vec<usize> {
    std::iter::from_fn(|| recv_id(receiver).ok()).collect()
}

fn sorted(parts: impl IntoIterator<Item = Vec<usize>>) -> Vec<usize> {
    let mut all: Vec<usize> = parts.into_iter().flatten().collect();
    all.sort_unstable();
    all
}

#[test]
fn two_alternatives_on_two_channels_among_plain_senders_and_receivers() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let plain = [(to_one.clone(), 1), (to_two.clone(), 2)].map(|(sender, id)| {
            let token = drops.token(id);
            thread::spawn(move || send(&sender, token))
        });
        let theirs = drops.clone();
        let offers = thread::spawn(move || {
            assert!(offer(&to_one, &to_two, &theirs, 3));
            assert!(offer(&to_two, &to_one, &theirs, 4));
        });
        let other = two.clone();
        let receiver = thread::spawn(move || recv_all(&other));
        let received = recv_all_of_two(&one, &two);
        let received = sorted([received, receiver.join().unwrap()]);
        assert_eq!(received, [1, 2, 3, 4]);
        assert!(plain.into_iter().all(|sender| sender.join().unwrap()));
        offers.join().unwrap();
        assert_eq!(drops.count(), 4);
    });
}

#[test]
fn poison_among_alternatives_and_plain_partners() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let plain = [(to_one.clone(), 1), (to_two.clone(), 2)].map(|(sender, id)| {
            let token = drops.token(id);
            thread::spawn(move || {
                if send(&sender, token) {
                    vec![id]
                } else {
                    vec![]
                }
            })
        });
        let theirs = drops.clone();
        let poisoner = two.clone();
        let offers = thread::spawn(move || {
            (3..=4)
                .filter(|&id| offer(&to_one, &to_two, &theirs, id))
                .collect()
        });
        let poison = thread::spawn(move || poisoner.poison());
        let received = recv_all_of_two(&one, &two);
        poison.join().unwrap();
        let sent = plain.map(|sender| sender.join().unwrap());
        let sent: Vec<Vec<usize>> = sent.into_iter().chain([offers.join().unwrap()]).collect();
        assert_eq!(sorted([received]), sorted(sent), "both, or neither");
    });
}

/// Offers to send, and to receive: what was sent, and what was received.
async fn exchange(
    to: &Sender<Token>,
    from: &Receiver<Token>,
    token: Token,
) -> (Vec<usize>, Vec<usize>) {
    let id = token.id;
    alt! {
        token = from.recv() => (vec![], token.into_iter().map(|token| token.id).collect()),
        sent = to.send(token) => (sent.into_iter().map(|()| id).collect(), vec![]),
    }
}

#[test]
fn three_in_a_ring_and_one_that_withdraws() {
    check(|| {
        let drops = Drops::default();
        let [(x, from_x), (y, from_y), (z, from_z)] = [channel(), channel(), channel()];
        let (also_to, also_from) = (y.clone(), from_x.clone());
        let ends = [(x, from_z, 1), (y, from_x, 2), (z, from_y, 3)];
        let threads = ends.map(|(to, from, id)| {
            let token = drops.token(id);
            thread::spawn(move || block_on(exchange(&to, &from, token)))
        });
        // The fourth is in the second one's place, and goes.
        let mut fourth = Box::pin(exchange(&also_to, &also_from, drops.token(4)));
        let mut received = match poll(&mut fourth) {
            Poll::Ready((_, received)) => received,
            Poll::Pending => vec![],
        };
        drop(fourth);
        // What it had been given, and has given back, unless another one has that.
        received.extend(also_from.try_recv().map(|token| token.id));
        drop((also_to, also_from));
        let chosen = threads.map(|thread| thread.join().unwrap());
        let (sent, theirs): (Vec<_>, Vec<_>) = chosen.into_iter().unzip();
        let received = sorted(theirs.into_iter().chain([received]));
        // It is not known whether the fourth one's was sent.
        let of_the_fourth = received.iter().filter(|&&id| id == 4).count();
        assert!(of_the_fourth <= 1);
        let sent = sorted(sent.into_iter().chain([vec![4; of_the_fourth]]));
        assert_eq!(received, sent);
        assert!(!received.is_empty(), "somebody finds a partner");
        assert_eq!(drops.count(), 4);
    });
}

/// The barrier, or the channel: whether it met the barrier.
async fn meet(barrier: &Barrier, receiver: &Receiver<u32>, barrier_first: bool) -> bool {
    let received = |value: Result<u32, RecvError>| value.is_err();
    if barrier_first {
        pri_alt! {
            _ = barrier.sync() => true,
            value = receiver.recv() => received(value),
        }
    } else {
        alt! {
            value = receiver.recv() => received(value),
            _ = barrier.sync() => true,
        }
    }
}

#[test]
fn a_barrier_of_three_of_which_two_may_choose_a_sender_instead() {
    check(|| {
        let barrier = Barrier::new(3);
        let [(to_one, one), (to_two, two)] = [channel(), channel()];
        let alternatives = [(one, true), (two, false)].map(|(receiver, barrier_first)| {
            let barrier = barrier.clone();
            thread::spawn(move || {
                let met = block_on(meet(&barrier, &receiver, barrier_first));
                (met, receiver)
            })
        });
        // After the send, this thread comes in the place of the receiver.
        let send_or_meet = |sender: Sender<u32>, barrier: Barrier| {
            let sent = sender.try_send(1).is_ok();
            if sent {
                block_on(barrier.sync());
            }
            (sent, sender)
        };
        let of_second = barrier.clone();
        let second = thread::spawn(move || send_or_meet(to_two, of_second));
        let of_party = barrier.clone();
        let party = thread::spawn(move || block_on(of_party.sync()));
        let (first_sent, _to_one) = send_or_meet(to_one, barrier);
        let (second_sent, _to_two) = second.join().unwrap();
        party.join().unwrap();
        let met = alternatives.map(|alternative| alternative.join().unwrap().0);
        assert_eq!(met, [!first_sent, !second_sent]);
    });
}

#[test]
fn a_registered_alternative_of_three_senders_beside_another_receiver() {
    check(|| {
        let drops = Drops::default();
        let (senders, receivers): (Vec<_>, Vec<_>) = (0..3).map(|_| channel()).unzip();
        let threads: Vec<_> = senders
            .into_iter()
            .enumerate()
            .map(|(index, sender)| {
                let tokens = [drops.token(2 * index), drops.token(2 * index + 1)];
                thread::spawn(move || tokens.map(|token| assert!(send(&sender, token))))
            })
            .collect();
        let other = receivers[1].clone();
        let competitor = thread::spawn(move || recv_all(&other));
        let mut inputs = Alternative::fair(&receivers[..2]);
        let mut received = Vec::new();
        {
            // A receive that is given up as the senders come, and leaves what it has to the next.
            let mut recv = Box::pin(inputs.recv());
            if let Poll::Ready((_, Ok(token))) = poll(&mut recv) {
                received.push(token.id);
            }
        }
        // What the one that is removed was given goes back to its channel.
        assert!(inputs.remove(0));
        inputs.add(&receivers[2]);
        inputs.add(&receivers[0]);
        while !inputs.is_empty() {
            match block_on(inputs.recv()) {
                (_, Ok(token)) => received.push(token.id),
                (index, Err(error)) => {
                    assert_eq!(error, RecvError::Closed);
                    assert!(inputs.remove(index));
                }
            }
        }
        drop(inputs);
        for thread in threads {
            thread.join().unwrap();
        }
        let received = sorted([received, competitor.join().unwrap()]);
        assert_eq!(received, [0, 1, 2, 3, 4, 5]);
        assert_eq!(drops.count(), 6);
    });
}

/// Serves until the last client is gone: which requests, and how many answers arrived.
fn serve(server: &Server<Token, Token>, drops: &Drops) -> (Vec<usize>, usize) {
    let (mut served, mut answered) = (Vec::new(), 0);
    while let Ok(call) = block_on(server.accept()) {
        let id = call.id;
        served.push(id);
        answered += usize::from(call.reply(drops.token(10 + id)).is_ok());
    }
    (served, answered)
}

#[test]
fn two_clients_and_two_servers_and_a_client_that_goes() {
    check(|| {
        let drops = Drops::default();
        let (client, server): (Client<Token, Token>, _) = call_channel();
        let clients = [1, 3].map(|first| {
            let (client, drops) = (client.clone(), drops.clone());
            thread::spawn(move || {
                for id in [first, first + 1] {
                    let answer = block_on(client.call(drops.token(id)));
                    assert_eq!(answer.unwrap().id, 10 + id, "the answer to this call");
                }
            })
        });
        let servers = [server.clone(), server].map(|server| {
            let drops = drops.clone();
            thread::spawn(move || serve(&server, &drops))
        });
        let mut call = Box::pin(client.call(drops.token(5)));
        let is_answered = poll(&mut call).is_ready();
        drop(call);
        drop(client);
        for client in clients {
            client.join().unwrap();
        }
        let (served, answered): (Vec<_>, Vec<_>) = servers
            .map(|server| server.join().unwrap())
            .into_iter()
            .unzip();
        let served = sorted(served);
        let answered: usize = answered.iter().sum();
        assert_eq!(served[..4], [1, 2, 3, 4], "each once");
        assert!(served[4..].is_empty() || served[4..] == [5]);
        assert!((4 + usize::from(is_answered)..=served.len()).contains(&answered));
        // The requests, and as many answers as were made.
        assert_eq!(drops.count(), 5 + served.len());
    });
}

#[test]
fn a_full_buffer_between_two_senders_an_alternative_and_a_receiver() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = buffered(Buffer::fifo(1));
        let (_idle, never) = channel();
        let senders = [0, 10].map(|first| {
            let (sender, drops) = (sender.clone(), drops.clone());
            thread::spawn(move || (first..first + 3).all(|id| send(&sender, drops.token(id))))
        });
        drop(sender);
        let other = receiver.clone();
        let plain = thread::spawn(move || recv_all(&other));
        let mut received = Vec::new();
        while let Ok(token) = block_on(async {
            alt! {
                token = receiver.recv() => token,
                token = never.recv() => token,
            }
        }) {
            received.push(token.id);
        }
        let theirs = plain.join().unwrap();
        for of_one in [&received, &theirs] {
            for first in [0, 10] {
                let of_sender = of_one.iter().filter(|&&id| id / 10 == first / 10);
                assert!(of_sender.is_sorted(), "in the order of their sender");
            }
        }
        assert_eq!(sorted([received, theirs]), [0, 1, 2, 10, 11, 12]);
        assert!(senders.into_iter().all(|sender| sender.join().unwrap()));
        assert_eq!(drops.count(), 6);
    });
}
