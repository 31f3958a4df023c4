//! Networks that random choice seldom makes, each for a situation with an earlier defect.

use crate::operational::network::{
    Agent, End, Form, Guard, Kind, Network, Offer, Patience, Side, Step,
};
use crate::operational::run::{Bench, Placement};

fn agent(parent: Option<usize>, steps: Vec<Step>) -> Agent {
    Agent {
        parent,
        strict: false,
        level: 16,
        ends: Vec::new(),
        steps,
    }
}

/// A sibling fails while an alternative waits that has no guard which could fail with it.
#[test]
fn a_barrier_and_a_delay_in_a_branch_whose_sibling_fails() {
    for fair in [false, true] {
        let guards = [Guard::Sync { barrier: 0 }, Guard::After(2_000)];
        let offers = guards.map(|guard| Offer { guard, open: true });
        let alternative = Step::Alternative {
            fair,
            offers: offers.to_vec(),
            skip: false,
            dropped: None,
        };
        let network = Network {
            channels: Vec::new(),
            barriers: vec![2],
            agents: vec![
                agent(None, vec![Step::Par(vec![1, 2])]),
                agent(Some(0), vec![alternative]),
                agent(Some(0), vec![Step::Yield, Step::Fail]),
            ],
        };
        let bench = Bench::new();
        for placement in [Placement::OneExecutor, Placement::Threads] {
            run(&bench, &network, placement);
        }
    }
}

#[track_caller]
fn run(bench: &Bench, network: &Network, placement: Placement) {
    if let Err(failed) = bench.run(network, placement, false) {
        panic!("{placement:?}\n{failed}");
    }
}

/// A process learns that a channel has ended, and then ends a lower one: an `Alternative` of both,
/// by priority, reports the higher one's end first.
#[test]
fn a_channel_that_ends_because_another_has() {
    let recv = |channel| Step::Plain(Guard::Recv { channel }, Patience::Forever);
    let selection = Step::Registered {
        fair: false,
        inputs: vec![0, 1],
    };
    let mut network = Network {
        channels: vec![Kind::Rendezvous; 2],
        barriers: Vec::new(),
        agents: vec![
            agent(None, vec![selection]),
            agent(None, vec![Step::Yield]),
            agent(None, vec![recv(0)]),
        ],
    };
    for (agent, channel) in [(1, 0), (2, 1)] {
        let side = Side::Sender;
        network.agents[agent].ends.push(End { channel, side });
    }
    network.hand_out_ends();
    let bench = Bench::new();
    for placement in [
        Placement::OneExecutor,
        Placement::TwoExecutors,
        Placement::Threads,
    ] {
        for _ in 0..200 {
            run(&bench, &network, placement);
        }
    }
}

/// A fair `Alternative` finds an ended channel just when its process is to yield to a more urgent
/// one. It still reports the ended channel, and not that another one is ready.
#[test]
fn an_ended_channel_is_not_passed_over_by_one_that_gives_way() {
    let send = Guard::Send {
        channel: 2,
        value: 1,
        form: Form::Given,
    };
    let poison = Step::Poison(End {
        channel: 0,
        side: Side::Sender,
    });
    let selection = Step::Registered {
        fair: true,
        inputs: vec![1, 2],
    };
    let recv = Guard::Recv { channel: 0 };
    let mut network = Network {
        channels: vec![Kind::Rendezvous; 3],
        barriers: Vec::new(),
        // The urgent ones first, so that they wait when the last one begins.
        agents: vec![
            agent(None, vec![Step::Plain(recv, Patience::Forever)]),
            agent(None, vec![Step::Plain(send, Patience::Forever)]),
            agent(None, vec![poison, selection]),
        ],
    };
    network.agents[2].level = 8;
    network.hand_out_ends();
    run(&Bench::new(), &network, Placement::OneExecutor);
}
