//! Lies about what was chosen.

use super::*;
use crate::operational::network::{End, Failure, Side};
use Failure::Closed;
use Fin::{Complete, Stuck};
use Outcome::{Expired, Failed, Received, Sent, Skipped};

#[test]
fn pri_alt_takes_the_first_that_is_ready() {
    let network = network(
        &[Kind::Rendezvous; 2],
        [
            &[plain(send(0, 1))],
            &[plain(send(1, 2))],
            &[choice(false, &[recv(0), recv(1)], false)],
        ],
    );
    let both_wait = [begins(0, 0), waits(0), begins(1, 0), waits(1), begins(2, 0)];
    let second = [
        sees(2, Received(1, 2)),
        sees(1, Sent(0)),
        leaves(1),
        leaves(2),
    ];
    let rest = [sees(0, Failed(0, Closed)), leaves(0)];
    refused(&network, &[&both_wait, &second, &rest], Complete, 5);
    // If the first comes while the choice is made, it may be too late.
    let meanwhile = [begins(1, 0), waits(1), begins(2, 0), begins(0, 0), waits(0)];
    allowed(&network, &[&meanwhile, &second, &rest], Complete);
}

#[test]
fn skip_and_try_say_that_nothing_was_ready_at_an_instant() {
    let guards = [recv(0), recv(1)];
    for second in [
        choice(false, &guards, true),
        choice(true, &guards, true),
        Step::Plain(recv(0), Patience::Try),
    ] {
        let mut network = network(&[Kind::Rendezvous; 2], [&[plain(send(0, 1))], &[second]]);
        // No agent sends on the second channel, but one could.
        network.agents[0].ends.push(End {
            channel: 1,
            side: Side::Sender,
        });
        let end = [leaves(1), sees(0, Failed(0, Closed)), leaves(0)];
        let skips = [begins(1, 0), sees(1, Skipped)];
        allowed(
            &network,
            &[&[begins(0, 0)], &skips, &[waits(0)], &end],
            Complete,
        );
        refused(
            &network,
            &[&[begins(0, 0), waits(0)], &skips, &end],
            Complete,
            3,
        );
    }
}

#[test]
fn a_guard_whose_precondition_is_false_is_not_offered() {
    let mut network = network(
        &[Kind::Rendezvous; 2],
        [
            &[plain(send(0, 1))],
            &[choice(true, &[recv(0), recv(1)], false)],
        ],
    );
    let trace = [
        begins(0, 0),
        begins(1, 0),
        sees(0, Sent(0)),
        sees(1, Received(0, 1)),
        leaves(0),
        leaves(1),
    ];
    allowed(&network, &[&trace], Complete);
    let Step::Alternative { offers, .. } = &mut network.agents[1].steps[0] else {
        unreachable!()
    };
    offers[0].open = false;
    refused(&network, &[&trace], Complete, 2);
    // With no guard open it stops, and reports nothing about the channel without a sender.
    let Step::Alternative { offers, .. } = &mut network.agents[1].steps[0] else {
        unreachable!()
    };
    offers[1].open = false;
    allowed(
        &network,
        &[&[begins(0, 0), waits(0), begins(1, 0), waits(1)]],
        Stuck,
    );
    refused(
        &network,
        &[&[
            begins(0, 0),
            waits(0),
            begins(1, 0),
            sees(1, Failed(1, Closed)),
        ]],
        Stuck,
        3,
    );
}

#[test]
fn losing_guards_leave_no_trace() {
    let network = network(
        &[Kind::Rendezvous; 2],
        [
            &[choice(true, &[send(0, 1), send(1, 2)], false)],
            &[plain(recv(0))],
            &[plain(recv(1))],
        ],
    );
    let start = [
        begins(0, 0),
        waits(0),
        begins(1, 0),
        sees(1, Received(0, 1)),
        begins(2, 0),
    ];
    let end = [sees(0, Sent(0)), leaves(0), leaves(1)];
    allowed(
        &network,
        &[&start, &end, &[sees(2, Failed(0, Closed)), leaves(2)]],
        Complete,
    );
    refused(
        &network,
        &[&start, &end, &[sees(2, Received(0, 2)), leaves(2)]],
        Complete,
        8,
    );
    refused(&network, &[&start, &[sees(0, Sent(1))]], Complete, 5);
}

#[test]
fn two_alternatives_agree_and_do_not_wait_for_each_other_for_ever() {
    let network = network(
        &[Kind::Rendezvous; 2],
        [
            &[choice(false, &[send(0, 1), send(1, 2)], false)],
            &[choice(false, &[recv(1), recv(0)], false)],
        ],
    );
    let start = [begins(0, 0), begins(1, 0)];
    allowed(
        &network,
        &[
            &start,
            &[sees(0, Sent(0)), sees(1, Received(1, 1))],
            &all_leave(2),
        ],
        Complete,
    );
    allowed(
        &network,
        &[
            &start,
            &[sees(0, Sent(1)), sees(1, Received(0, 2))],
            &all_leave(2),
        ],
        Complete,
    );
    refused(
        &network,
        &[&start, &[sees(0, Sent(0)), sees(1, Received(0, 2))]],
        Complete,
        3,
    );
    // The one that came second may have given way to others, but has communicated.
    refused(&network, &[&start, &[waits(0), waits(1)]], Stuck, 4);
    refused(&network, &[&start, &[waits(0)]], Stuck, 3);
}

#[test]
fn an_expired_timeout_is_one_of_the_guards() {
    let network = network(
        &[Kind::Rendezvous],
        [
            &[plain(send(0, 1))],
            &[choice(false, &[Guard::After(9), recv(0)], false)],
        ],
    );
    let start = [begins(0, 0), waits(0), begins(1, 0)];
    allowed(
        &network,
        &[
            &start,
            &[
                sees(1, Expired(0)),
                leaves(1),
                sees(0, Failed(0, Closed)),
                leaves(0),
            ],
        ],
        Complete,
    );
    allowed(
        &network,
        &[
            &start,
            &[sees(1, Received(1, 1)), sees(0, Sent(0))],
            &all_leave(2),
        ],
        Complete,
    );
    refused(&network, &[&start, &[sees(1, Expired(1))]], Complete, 3);
    // It fires some time.
    refused(&network, &[&[begins(1, 0), waits(1)]], Stuck, 2);
}

#[test]
fn alt_takes_the_ready_end_that_was_chosen_least_recently() {
    let both = choice(true, &[recv(0), recv(1)], false);
    let network = network(
        &[Kind::Fifo(2); 2],
        [
            &[plain(send(0, 1)), plain(send(0, 2)), plain(send(1, 3))],
            &[both.clone(), both.clone(), both],
        ],
    );
    let start = steps(0, 0, &[Sent(0); 3]);
    let [one, two, three] = [Received(0, 1), Received(0, 2), Received(1, 3)];
    let end = all_leave(2);
    allowed(
        &network,
        &[&start, &steps(1, 0, &[one, three, two]), &end],
        Complete,
    );
    refused(
        &network,
        &[&start, &steps(1, 0, &[one, two, three]), &end],
        Complete,
        9,
    );
    refused(
        &network,
        &[&start, &steps(1, 0, &[three, one, two]), &end],
        Complete,
        7,
    );
}
