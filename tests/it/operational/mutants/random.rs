//! Lies about random networks.

use super::*;
use crate::operational::generate::{self, Random};
use crate::operational::network::Failure;
use crate::operational::simulate::simulate;
use Failure::{Closed, Poisoned};
use Fin::{Complete, Stuck};
use Outcome::{Done, Expired, Failed, Joined, Received, Sent, Skipped, Synced};

/// Lies that no network makes true.
fn lies(
    network: &Network,
    trace: &[Entry],
    end: Fin,
    random: &mut Random,
) -> Vec<(Vec<Entry>, Fin)> {
    let with = |place: usize, outcome| {
        let mut trace = trace.to_vec();
        trace[place].event = Event::Ends(outcome);
        (trace, end)
    };
    let mut lies = vec![(
        trace.to_vec(),
        if end == Complete { Stuck } else { Complete },
    )];
    for (place, entry) in trace.iter().enumerate() {
        let Event::Ends(outcome) = entry.event else {
            continue;
        };
        match outcome {
            Received(guard, _) => lies.push(with(place, Received(guard, 1_000))),
            Sent(_) | Expired(_) | Skipped => lies.push(with(place, Done)),
            Failed(guard, Closed) => lies.push(with(place, Sent(guard + 100))),
            Failed(guard, Poisoned | Failure::Own) => {
                lies.push(with(place, Failed(guard + 100, Closed)))
            }
            Joined { failed } => lies.push(with(place, Joined { failed: !failed })),
            Done | Synced(_) => lies.push(with(place, Skipped)),
            Outcome::Broken(_) => unreachable!("the model breaks nothing"),
        }
    }
    // An agent forgets what it did.
    if !trace.is_empty() {
        let mut shorter = trace.to_vec();
        let forgotten = shorter.remove(random.below(trace.len()));
        // That it had to wait need not be said.
        if forgotten.event != Event::Waits {
            lies.push((shorter, end));
        }
    }
    assert!(network.agents.len() > 1);
    lies
}

#[test]
fn lies_about_random_networks_are_refused() {
    let mut reported = 0;
    for seed in 0..150 {
        let network = generate::network(seed);
        let mut random = Random::new(!seed);
        let (trace, end) = simulate(&network, &mut random);
        for (lie, end) in lies(&network, &trace, end, &mut random) {
            reported += 1;
            assert!(
                check(&network, &lie, end).is_err(),
                "seed {seed}: {lie:?}, {end:?} is allowed:\n{network}"
            );
        }
    }
    assert!(reported > 1_000, "{reported}");
}
