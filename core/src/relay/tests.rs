use super::*;

fn with_jobs(jobs: usize) -> Relay {
    let relay = Relay::new();
    for number in 0..jobs {
        assert_eq!(relay.add(), Some(number));
    }
    relay
}

fn run(leg: Leg) -> Turn {
    match leg {
        Leg::Run(turn) => turn,
        other => panic!("nothing to run: {other:?}"),
    }
}

#[test]
fn jobs_run_in_order_and_once() {
    let relay = with_jobs(3);
    assert!(relay.begin());
    let mut order = Vec::new();
    while let Leg::Run(turn) = relay.take(7) {
        assert_eq!(turn.member(), 7);
        order.push(turn.job());
        assert!(relay.finish(turn));
        assert!(!relay.finish(turn) && !relay.leave_behind(turn));
    }
    assert_eq!(order, [0, 1, 2]);
    assert!(relay.is_done() && !relay.begin());
}

#[test]
fn without_jobs_it_is_done_at_once() {
    let relay = Relay::new();
    assert!(relay.begin() && relay.is_done());
    assert_eq!(relay.take(0), Leg::Rest);
}

#[test]
fn one_that_is_closed_never_begins() {
    let relay = with_jobs(1);
    assert!(relay.close() && relay.close() && !relay.begin());
    assert_eq!((relay.take(0), relay.add()), (Leg::Rest, None));
    let relay = with_jobs(1);
    assert!(relay.begin() && !relay.close());
}

#[test]
fn who_is_left_behind_comes_too_late() {
    let relay = with_jobs(2);
    relay.begin();
    let first = run(relay.take(0));
    assert_eq!(relay.take(1), Leg::Watch(first));
    assert!(relay.leave_behind(first) && !relay.finish(first));
    let second = run(relay.take(1));
    assert!(!relay.leave_behind(first), "that was another turn");
    assert!(relay.finish(second) && relay.is_done());
}

#[test]
fn a_job_that_is_added_while_others_run_is_run_too() {
    let relay = with_jobs(1);
    relay.begin();
    let first = run(relay.take(0));
    assert_eq!(relay.add(), Some(1));
    assert!(relay.finish(first) && !relay.is_done());
    assert!(relay.finish(run(relay.take(0))) && relay.is_done());
    assert_eq!(relay.add(), None);
}

#[test]
fn rounds_are_apart() {
    let relay = with_jobs(1);
    assert!(!relay.again());
    relay.begin();
    let old = run(relay.take(0));
    assert!(!relay.again(), "it runs");
    relay.finish(old);
    assert!(relay.again() && relay.begin());
    let new = run(relay.take(0));
    assert!(!relay.leave_behind(old) && !relay.finish(old));
    assert!(relay.finish(new));
}

#[test]
fn as_many_jobs_as_there_may_be() {
    let relay = with_jobs(MOST_JOBS);
    assert_eq!(relay.add(), None);
    relay.begin();
    for _ in 0..MOST_JOBS {
        assert!(relay.finish(run(relay.take(254))));
    }
    assert!(relay.is_done());
}

#[test]
fn one_that_is_taken_back_is_not_run() {
    let relay = with_jobs(2);
    assert!(relay.remove());
    assert_eq!(relay.add(), Some(1), "its number is free");
    assert!(relay.remove() && relay.remove() && !relay.remove());
    let relay = with_jobs(2);
    assert!(relay.remove() && relay.begin() && !relay.remove());
    let turn = run(relay.take(0));
    assert!(relay.finish(turn) && relay.is_done());
}

#[test]
fn one_that_is_retired_does_not_begin_again() {
    let relay = with_jobs(1);
    assert!(relay.begin() && !relay.retire());
    let turn = run(relay.take(0));
    assert!(relay.finish(turn) && relay.again() && relay.begin());
    let turn = run(relay.take(0));
    assert!(relay.finish(turn) && relay.retire() && relay.retire());
    assert!(!relay.again() && !relay.begin() && !relay.is_under_way());
    assert!(with_jobs(1).retire());
}
