//! The worked examples of the literature, and what is refused.

use super::seen::PREFIX;
use super::*;

fn thread(rank: u8) -> Thread {
    Thread { core: 0, rank }
}

fn ms(count: f64) -> Duration {
    Duration::from_secs_f64(count / 1000.0)
}

/// One poll a job.
fn task(thread: usize, priority: u8, period: f64, cost: f64) -> Task {
    Task {
        thread,
        priority,
        demand: Some(Demand {
            arrivals: Arrivals::Periodic {
                period: ms(period),
                jitter: Duration::ZERO,
            },
            cost: ms(cost),
        }),
        longest_poll: Some(ms(cost)),
        is_one_poll: true,
    }
}

/// Releases of its jobs as these.
fn released(mut task: Task, arrivals: Arrivals) -> Task {
    if let Some(demand) = &mut task.demand {
        demand.arrivals = arrivals;
    }
    task
}

fn found(threads: &[Thread], tasks: &[Task]) -> Vec<Duration> {
    bounds(threads, tasks)
        .into_iter()
        .map(|bound| bound.expect("a bound"))
        .collect()
}

/// Each task on a thread of its own, in the order of their priorities: fully preemptive.
fn preemptive(tasks: &[(f64, f64)]) -> Vec<Duration> {
    let threads: Vec<_> = (0..tasks.len()).map(|n| thread(90 - n as u8)).collect();
    let tasks: Vec<_> = tasks
        .iter()
        .zip(0..)
        .map(|((period, cost), n)| task(n, 0, *period, *cost))
        .collect();
    found(&threads, &tasks)
}

/// A. Burns and A. Wellings, *Real-Time Systems and Programming Languages*, 4th edition, section
/// 11.5: task sets B and C.
#[test]
fn burns_and_wellings() {
    let set = preemptive(&[(20.0, 5.0), (40.0, 10.0), (80.0, 40.0)]);
    assert_eq!(set, [ms(5.0), ms(15.0), ms(80.0)]);
    let set = preemptive(&[(7.0, 3.0), (12.0, 3.0), (20.0, 5.0)]);
    assert_eq!(set, [ms(3.0), ms(6.0), ms(20.0)]);
}

/// J. Lehoczky, *Fixed priority scheduling of periodic task sets with arbitrary deadlines*, RTSS
/// 1990: the longest response of the second task is that of the fifth job, 118 and not 114.
#[test]
fn lehoczky() {
    let set = preemptive(&[(70.0, 26.0), (100.0, 62.0)]);
    assert_eq!(set, [ms(26.0), ms(118.0)]);
}

/// R. Davis, A. Burns, R. Bril and J. Lukkien, *Controller Area Network schedulability analysis:
/// refuted, revisited and revised*, Real-Time Systems 35, 2007: of message C the second instance is
/// the later one.
#[test]
fn messages_that_are_not_preempted() {
    let tasks = [
        task(0, 3, 2.5, 1.0),
        task(0, 2, 3.5, 1.0),
        task(0, 1, 3.5, 1.0),
    ];
    let set = found(&[thread(80)], &tasks);
    assert_eq!(set, [ms(2.0), ms(3.0), ms(3.5)]);
}

#[test]
fn a_job_of_several_polls_gives_way_between_them() {
    let mut low = task(0, 1, 100.0, 10.0);
    low.longest_poll = Some(ms(2.0));
    low.is_one_poll = false;
    let high = task(0, 2, 20.0, 3.0);
    let set = found(&[thread(80)], &[low, high]);
    assert_eq!(set, [ms(13.0), ms(5.0)]);
}

#[test]
fn threads_above_delay_and_those_below_and_elsewhere_do_not() {
    let threads = [
        thread(50),
        thread(60),
        thread(40),
        Thread { core: 1, rank: 99 },
    ];
    let tasks = [
        task(0, 0, 10.0, 2.0),
        task(1, 0, 10.0, 1.0),
        task(2, 0, 10.0, 4.0),
        task(3, 0, 10.0, 5.0),
    ];
    assert_eq!(
        found(&threads, &tasks),
        [ms(3.0), ms(1.0), ms(7.0), ms(5.0)]
    );
}

#[test]
fn a_late_release_counts() {
    let arrivals = Arrivals::Periodic {
        period: ms(10.0),
        jitter: ms(0.5),
    };
    let late = released(task(0, 0, 10.0, 2.0), arrivals);
    assert_eq!(found(&[thread(80)], &[late]), [ms(2.5)]);
}

#[test]
fn what_was_seen_repeats_itself() {
    // Bursts of three.
    let releases: Vec<_> = (0..90).map(|n| ms(f64::from(n / 3 * 20 + n % 3))).collect();
    let seen = Arrivals::Seen(Seen::of(&releases).unwrap());
    let burst = released(task(0, 1, 1.0, 1.5), seen);
    let utilization = burst.demand.as_ref().map_or(0.0, Demand::utilization);
    assert!((utilization - 0.225).abs() < 0.01, "{utilization}");
    let set = found(&[thread(80)], &[burst, task(0, 0, 20.0, 1.0)]);
    // The third of a burst, behind two others and a poll of the other task.
    assert_eq!(set[0], ms(4.5 + 1.0 - 2.0));
    assert!(Seen::of(&releases[..1]).is_none());
    assert!(Seen::of(&[ms(1.0), ms(1.0)]).is_none());
    let mut many = vec![ms(1.0); PREFIX + 1];
    many.push(ms(2.0));
    assert!(Seen::of(&many).is_none());
    assert!(Seen::of(&many[1..]).is_some());
}

#[test]
fn what_has_no_bound_says_why() {
    let tasks = [
        task(0, 0, 10.0, 2.0),
        task(1, 1, 10.0, 6.0),
        task(1, 0, 10.0, 6.0),
    ];
    let found = bounds(&[Thread { core: 0, rank: 0 }, thread(80)], &tasks);
    assert_eq!(found[0], Err(NoBound::Ordinary));
    assert_eq!(found[1], Ok(ms(12.0)));
    let Err(NoBound::Overload { utilization }) = found[2] else {
        panic!("{found:?}");
    };
    assert!((utilization - 1.2).abs() < 1e-9, "{utilization}");
}

#[test]
fn what_would_take_too_many_steps_has_no_bound() {
    let task = |period: Duration, jitter: Duration| Task {
        demand: Some(Demand {
            arrivals: Arrivals::Periodic { period, jitter },
            cost: Duration::from_nanos(1),
        }),
        ..task(0, 0, 1.0, 1.0)
    };
    let (ns, day) = (Duration::from_nanos(1), Duration::from_secs(86_400));
    for task in [task(ns, ns), task(ns * 2, day / 86_400)] {
        let found = bounds(&[thread(80)], &[task]);
        assert!(
            matches!(found[..], [Err(NoBound::TooLong { .. })]),
            "{found:?}"
        );
    }
    // Far apart.
    let far = task(Duration::MAX, Duration::ZERO);
    assert_eq!(found(&[thread(80)], &[far]), [ns]);
}

#[test]
fn what_is_not_known_leaves_those_without_a_bound_that_need_it() {
    let with = |demand: bool, poll: bool| {
        let mut open = task(0, 1, 10.0, 1.0);
        if !demand {
            open.demand = None;
        }
        if !poll {
            open.longest_poll = None;
        }
        let tasks = [
            task(0, 2, 10.0, 1.0),
            open,
            task(0, 0, 10.0, 1.0),
            task(1, 0, 10.0, 1.0),
        ];
        bounds(&[thread(80), thread(70)], &tasks)
    };
    let demand = Err(NoBound::Unknown(Gap::Demand(1)));
    let poll = Err(NoBound::Unknown(Gap::Poll(1)));
    let found = with(false, true);
    assert_eq!(found, [Ok(ms(2.0)), demand, demand, demand]);
    let found = with(true, false);
    assert_eq!(found, [poll, Ok(ms(3.0)), Ok(ms(3.0)), Ok(ms(4.0))]);
}

/// A thread of the same rank may hold the core until all that is ready on it is done.
#[test]
fn threads_of_one_rank_delay_each_other_whatever_the_priorities() {
    let tasks = [
        task(0, 9, 20.0, 2.0),
        task(0, 1, 20.0, 3.0),
        task(1, 0, 20.0, 4.0),
    ];
    let set = found(&[thread(80), thread(80)], &tasks);
    assert_eq!(set, [ms(9.0); 3]);
}
