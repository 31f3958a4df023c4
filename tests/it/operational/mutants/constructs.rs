//! Lies about barriers, branches, and the end.

use super::*;
use crate::operational::network::Failure;
use Failure::{Closed, Poisoned};
use Fin::{Complete, Stuck};
use Outcome::{Failed, Joined, Received, Sent, Synced};

#[test]
fn a_barrier_holds_all_until_the_last_has_come() {
    let mut network = network(&[], [&[Step::Sync(0)], &[Step::Sync(0)]]);
    network.barriers.push(2);
    let start = [begins(0, 0), waits(0)];
    allowed(
        &network,
        &[
            &start,
            &[begins(1, 0), sees(1, Synced(0)), sees(0, Synced(0))],
            &all_leave(2),
        ],
        Complete,
    );
    refused(&network, &[&start, &[sees(0, Synced(0))]], Complete, 2);
    refused(&network, &[&start, &[begins(1, 0), waits(1)]], Stuck, 4);
}

#[test]
fn an_alternative_comes_to_a_barrier_only_if_all_others_have() {
    let sync = Guard::Sync { barrier: 0 };
    let mut network = network(
        &[Kind::Rendezvous],
        [
            &[choice(false, &[sync, recv(0)], false)],
            &[Step::Sync(0)],
            &[plain(send(0, 1))],
        ],
    );
    network.barriers.push(2);
    let start = [begins(0, 0), waits(0)];
    let sent = [begins(2, 0), sees(2, Sent(0))];
    let met = [
        begins(1, 0),
        sees(1, Synced(0)),
        sees(0, Synced(0)),
        leaves(0),
        leaves(1),
    ];
    allowed(
        &network,
        &[
            &start,
            &met,
            &[begins(2, 0), sees(2, Failed(0, Closed)), leaves(2)],
        ],
        Complete,
    );
    // Not with an agent that has chosen another guard.
    allowed(
        &network,
        &[
            &start,
            &sent,
            &[
                sees(0, Received(1, 1)),
                leaves(0),
                leaves(2),
                begins(1, 0),
                waits(1),
            ],
        ],
        Stuck,
    );
    refused(&network, &[&start, &sent, &met], Complete, 5);
    refused(&network, &[&start, &[begins(1, 0), waits(1)]], Stuck, 4);
}

/// A process of two branches, the second of which fails while the first waits.
fn failing_branch() -> Network {
    let mut network = network(
        &[Kind::Rendezvous; 2],
        [
            &[Step::Par(vec![1, 2])],
            &[plain(recv(0)), plain(recv(0))],
            &[plain(send(1, 1))],
            &[plain(send(0, 2))],
        ],
    );
    for branch in [1, 2] {
        network.agents[branch].parent = Some(0);
        network.agents[branch].strict = true;
    }
    network
}

#[test]
fn a_branch_that_fails_ends_its_siblings() {
    let network = failing_branch();
    let start = [
        begins(0, 0),
        begins(1, 0),
        waits(1),
        begins(2, 0),
        sees(2, Failed(0, Closed)),
        leaves(2),
    ];
    let end = [leaves(1), sees(0, Joined { failed: true }), leaves(0)];
    let alone = [begins(3, 0), sees(3, Failed(0, Closed)), leaves(3)];
    allowed(
        &network,
        &[&start, &[sees(1, Failed(0, Poisoned))], &end, &alone],
        Complete,
    );
    // A partner may come before the sibling has learned of it, but not for its next operation.
    let partner = [
        begins(3, 0),
        sees(3, Sent(0)),
        sees(1, Received(0, 2)),
        begins(1, 1),
    ];
    allowed(
        &network,
        &[
            &start,
            &partner,
            &[sees(1, Failed(0, Poisoned))],
            &end,
            &[leaves(3)],
        ],
        Complete,
    );
    refused(
        &network,
        &[&start, &partner, &[leaves(3), sees(1, Failed(0, Closed))]],
        Complete,
        11,
    );
    refused(&network, &[&start, &[waits(0)]], Stuck, 7);
    refused(
        &network,
        &[
            &start,
            &[
                sees(1, Failed(0, Poisoned)),
                sees(0, Joined { failed: true }),
            ],
        ],
        Complete,
        7,
    );
    refused(
        &network,
        &[
            &start,
            &[
                sees(1, Failed(0, Poisoned)),
                leaves(1),
                sees(0, Joined { failed: false }),
            ],
        ],
        Complete,
        8,
    );
}

#[test]
fn a_branch_ends_at_its_failure_and_its_parent_waits_for_all() {
    let network = failing_branch();
    let start = [begins(0, 0), begins(2, 0), sees(2, Failed(0, Closed))];
    refused(&network, &[&start, &[begins(2, 1)]], Complete, 3);
    refused(
        &network,
        &[&start, &[leaves(2), sees(0, Joined { failed: true })]],
        Complete,
        4,
    );
}

#[test]
fn the_end_is_as_the_trace_says() {
    let network = network(
        &[Kind::Rendezvous],
        [&[plain(send(0, 1))], &[plain(recv(0))]],
    );
    let trace = [
        begins(0, 0),
        begins(1, 0),
        sees(0, Sent(0)),
        sees(1, Received(0, 1)),
        leaves(0),
    ];
    allowed(&network, &[&trace, &[leaves(1)]], Complete);
    refused(&network, &[&trace, &[leaves(1)]], Stuck, 6);
    refused(&network, &[&trace], Complete, 5);
    refused(&network, &[&trace], Stuck, 5);
}

#[test]
fn a_branch_at_a_barrier_is_dropped_when_its_sibling_fails() {
    let waiting = choice(false, &[Guard::Sync { barrier: 0 }, Guard::After(9)], false);
    for step in [Step::Sync(0), waiting] {
        let mut network = network(
            &[],
            [
                &[Step::Par(vec![1, 2])],
                std::slice::from_ref(&step),
                &[Step::Fail],
            ],
        );
        network.barriers.push(2);
        for branch in [1, 2] {
            network.agents[branch].parent = Some(0);
        }
        let start = [begins(0, 0), begins(1, 0), waits(1)];
        let fails = [begins(2, 0), sees(2, Failed(0, Failure::Own)), leaves(2)];
        let end = [sees(0, Joined { failed: true }), leaves(0)];
        allowed(&network, &[&start, &fails, &[leaves(1)], &end], Complete);
        refused(&network, &[&start, &[leaves(1)]], Complete, 3);
        refused(
            &network,
            &[&start, &fails, &[sees(1, Synced(0))]],
            Complete,
            6,
        );
        refused(&network, &[&start, &fails], Stuck, 6);
    }
}
