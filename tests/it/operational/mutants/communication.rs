//! Lies about values, their order, and their channels' ends.

use super::*;
use crate::operational::network::{End, Failure, Side};
use Failure::{Closed, Poisoned};
use Fin::{Complete, Stuck};
use Outcome::{Done, Expired, Failed, Received, Sent};

#[test]
fn a_value_is_neither_doubled_nor_lost_nor_invented() {
    let network = network(
        &[Kind::Rendezvous],
        [&[plain(send(0, 1))], &[plain(recv(0))], &[plain(recv(0))]],
    );
    let start = [
        begins(1, 0),
        waits(1),
        begins(2, 0),
        waits(2),
        begins(0, 0),
        sees(0, Sent(0)),
    ];
    allowed(
        &network,
        &[
            &start,
            &[
                leaves(0),
                sees(1, Received(0, 1)),
                leaves(1),
                sees(2, Failed(0, Closed)),
                leaves(2),
            ],
        ],
        Complete,
    );
    refused(
        &network,
        &[&start, &[sees(1, Received(0, 1)), sees(2, Received(0, 1))]],
        Stuck,
        7,
    );
    refused(
        &network,
        &[&start, &[leaves(0), sees(1, Failed(0, Closed))]],
        Stuck,
        7,
    );
    refused(&network, &[&start, &[leaves(0)]], Stuck, 7);
    refused(&network, &[&start, &[sees(1, Received(0, 2))]], Stuck, 6);
}

#[test]
fn values_keep_their_order() {
    let sends = [plain(send(0, 1)), plain(send(0, 2)), plain(send(0, 3))];
    let receives = [plain(recv(0)), plain(recv(0))];
    let of = |kind| network(&[kind], [&sends[..], &receives[..]]);
    let sent = steps(0, 0, &[Sent(0); 3]);
    let got = |values: [Value; 2]| steps(1, 0, &values.map(|value| Received(0, value)));
    let end = all_leave(2);
    for (kind, right, wrong, at) in [
        (Kind::Fifo(3), [1, 2], [2, 1], 7),
        (Kind::Fifo(3), [1, 2], [1, 3], 9),
        (Kind::OverwriteOldest(2), [2, 3], [1, 2], 7),
        (Kind::OverwriteNewest(2), [1, 3], [1, 2], 9),
    ] {
        allowed(&of(kind), &[&sent, &got(right), &end], Complete);
        refused(&of(kind), &[&sent, &got(wrong), &end], Complete, at);
    }
    // Its third send has to wait.
    refused(&of(Kind::Fifo(2)), &[&sent], Stuck, 5);
}

#[test]
fn one_that_waits_is_served_by_level_and_then_in_the_order_of_arrival() {
    let mut network = network(
        &[Kind::Rendezvous],
        [
            &[plain(send(0, 1))],
            &[plain(send(0, 2))],
            &[plain(recv(0)), plain(recv(0))],
        ],
    );
    let start = [begins(0, 0), waits(0), begins(1, 0), waits(1)];
    let got = |first, second| steps(2, 0, &[Received(0, first), Received(0, second)]);
    let end = [
        sees(0, Sent(0)),
        leaves(0),
        sees(1, Sent(0)),
        leaves(1),
        leaves(2),
    ];
    allowed(&network, &[&start, &got(1, 2), &end], Complete);
    refused(&network, &[&start, &got(2, 1), &end], Complete, 5);
    network.agents[1].level = 17;
    allowed(&network, &[&start, &got(2, 1), &end], Complete);
    refused(&network, &[&start, &got(1, 2), &end], Complete, 5);
}

#[test]
fn what_was_communicated_is_not_reported_as_poisoned_or_closed() {
    let poison = Step::Poison(End {
        channel: 0,
        side: Side::Receiver,
    });
    let network = network(
        &[Kind::Rendezvous],
        [&[plain(send(0, 1))], &[plain(recv(0)), poison]],
    );
    let start = [
        begins(0, 0),
        waits(0),
        begins(1, 0),
        sees(1, Received(0, 1)),
        begins(1, 1),
        sees(1, Done),
    ];
    allowed(
        &network,
        &[&start, &[sees(0, Sent(0)), leaves(0), leaves(1)]],
        Complete,
    );
    refused(
        &network,
        &[&start, &[sees(0, Failed(0, Poisoned))]],
        Complete,
        6,
    );
    refused(
        &network,
        &[&start, &[leaves(1), sees(0, Failed(0, Closed))]],
        Complete,
        7,
    );
}

#[test]
fn a_closed_channel_first_gives_what_is_buffered() {
    let network = network(
        &[Kind::Fifo(1)],
        [&[plain(send(0, 1))], &[plain(recv(0)), plain(recv(0))]],
    );
    let start = [begins(0, 0), sees(0, Sent(0)), leaves(0)];
    allowed(
        &network,
        &[
            &start,
            &steps(1, 0, &[Received(0, 1), Failed(0, Closed)]),
            &[leaves(1)],
        ],
        Complete,
    );
    refused(
        &network,
        &[&start, &steps(1, 0, &[Failed(0, Closed)])],
        Complete,
        4,
    );
    refused(
        &network,
        &[&start, &steps(1, 0, &[Received(0, 1), Failed(0, Poisoned)])],
        Complete,
        6,
    );
}

#[test]
fn a_timeout_is_exact_and_a_dropped_receive_loses_nothing() {
    let of = |sends, receives| {
        network(
            &[Kind::Rendezvous],
            [
                &[Step::Plain(send(0, 1), sends)],
                &[Step::Plain(recv(0), receives), plain(recv(0))],
            ],
        )
    };
    let start = [begins(1, 0), waits(1), begins(0, 0)];
    let after = [begins(1, 1), sees(1, Received(0, 1)), leaves(0), leaves(1)];
    let exact = of(Patience::Timeout(0), Patience::Timeout(0));
    let dropped = of(Patience::Dropped(0), Patience::Dropped(0));
    // The receive gives up what it was given, and the next one finds it.
    let given_back = [sees(0, Sent(0)), sees(1, Expired(1))];
    allowed(&dropped, &[&start, &given_back, &after], Complete);
    refused(
        &dropped,
        &[&start, &given_back, &[begins(1, 1), waits(1)]],
        Stuck,
        7,
    );
    refused(&exact, &[&start, &given_back, &after], Complete, 4);
    // The send was dropped when its partner had gone on: it stays sent, and does not know.
    let unknown = [
        sees(0, Expired(1)),
        sees(1, Received(0, 1)),
        begins(1, 1),
        leaves(0),
    ];
    allowed(
        &dropped,
        &[&start, &unknown, &[sees(1, Failed(0, Closed)), leaves(1)]],
        Complete,
    );
    refused(&exact, &[&start, &unknown], Complete, 4);
}
