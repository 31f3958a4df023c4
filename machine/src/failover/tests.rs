use super::*;

fn with_jobs(jobs: usize) -> FailoverSequence {
    let failover = FailoverSequence::new();
    for number in 0..jobs {
        assert_eq!(failover.add(), Some(number));
    }
    failover
}

fn run(leg: Leg) -> Turn {
    match leg {
        Leg::Run(turn) => turn,
        other => panic!("nothing to run: {other:?}"),
    }
}

#[test]
fn jobs_run_in_order_and_once() {
    let failover = with_jobs(3);
    assert!(failover.begin());
    let mut order = Vec::new();
    while let Leg::Run(turn) = failover.take(7) {
        assert_eq!(turn.member(), 7);
        order.push(turn.job());
        assert!(failover.finish(turn));
        assert!(!failover.finish(turn) && !failover.leave_behind(turn));
    }
    assert_eq!(order, [0, 1, 2]);
    assert!(failover.is_done() && !failover.begin());
}

#[test]
fn without_jobs_it_is_done_at_once() {
    let failover = FailoverSequence::new();
    assert!(failover.begin() && failover.is_done());
    assert_eq!(failover.take(0), Leg::Rest);
}

#[test]
fn one_that_is_closed_never_begins() {
    let failover = with_jobs(1);
    assert!(failover.close() && failover.close() && !failover.begin());
    assert_eq!((failover.take(0), failover.add()), (Leg::Rest, None));
    let failover = with_jobs(1);
    assert!(failover.begin() && !failover.close());
}

#[test]
fn one_that_is_left_behind_comes_too_late() {
    let failover = with_jobs(2);
    failover.begin();
    let first = run(failover.take(0));
    assert_eq!(failover.take(1), Leg::Watch(first));
    assert!(failover.leave_behind(first) && !failover.finish(first));
    let second = run(failover.take(1));
    assert!(!failover.leave_behind(first), "that was another turn");
    assert!(failover.finish(second) && failover.is_done());
}

#[test]
fn a_job_that_is_added_while_others_run_is_run_too() {
    let failover = with_jobs(1);
    failover.begin();
    let first = run(failover.take(0));
    assert_eq!(failover.add(), Some(1));
    assert!(failover.finish(first) && !failover.is_done());
    assert!(failover.finish(run(failover.take(0))) && failover.is_done());
    assert_eq!(failover.add(), None);
}

#[test]
fn rounds_are_apart() {
    let failover = with_jobs(1);
    assert!(!failover.again());
    failover.begin();
    let old = run(failover.take(0));
    assert!(!failover.again(), "it runs");
    failover.finish(old);
    assert!(failover.again() && failover.begin());
    let new = run(failover.take(0));
    assert!(!failover.leave_behind(old) && !failover.finish(old));
    assert!(failover.finish(new));
}

#[test]
fn as_many_jobs_as_there_may_be() {
    let failover = with_jobs(MAX_JOBS);
    assert_eq!(failover.add(), None);
    failover.begin();
    for _ in 0..MAX_JOBS {
        assert!(failover.finish(run(failover.take(254))));
    }
    assert!(failover.is_done());
}

#[test]
fn one_that_is_taken_back_is_not_run() {
    let failover = with_jobs(2);
    assert!(failover.remove());
    assert_eq!(failover.add(), Some(1), "its number is free");
    assert!(failover.remove() && failover.remove() && !failover.remove());
    let failover = with_jobs(2);
    assert!(failover.remove() && failover.begin() && !failover.remove());
    let turn = run(failover.take(0));
    assert!(failover.finish(turn) && failover.is_done());
}

#[test]
fn one_that_is_retired_does_not_begin_again() {
    let failover = with_jobs(1);
    assert!(failover.begin() && !failover.retire());
    let turn = run(failover.take(0));
    assert!(failover.finish(turn) && failover.again() && failover.begin());
    let turn = run(failover.take(0));
    assert!(failover.finish(turn) && failover.retire() && failover.retire());
    assert!(!failover.again() && !failover.begin() && !failover.is_under_way());
    assert!(with_jobs(1).retire());
}

#[test]
fn the_rest_is_given_up_while_none_runs() {
    let failover = with_jobs(3);
    assert_eq!((failover.give_up(), failover.look()), (None, Leg::Rest));
    failover.begin();
    let first = run(failover.take(0));
    assert!(failover.is_running() && failover.look() == Leg::Watch(first));
    assert_eq!(failover.give_up(), None, "one runs");
    assert!(failover.leave_behind(first) && !failover.is_running());
    assert_eq!(failover.look(), Leg::Rest, "a free job is no duty");
    assert_eq!(failover.give_up(), Some(1));
    assert!(failover.is_done() && failover.add().is_none());
    assert!(
        failover.again() && failover.begin(),
        "a new round has all jobs"
    );
    assert_eq!(run(failover.take(1)).job(), 0);
}
