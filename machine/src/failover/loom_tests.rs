//! Triggers, members that hang, the end of the system, and late jobs, in any order: each job is run
//! once, none is lost.

use super::*;
use luna_platform::sync::Arc;
use luna_platform::sync::atomic::AtomicUsize;

struct Scene {
    failover: FailoverSequence,
    runs: [AtomicUsize; 2],
}

impl Scene {
    fn new(jobs: usize) -> Arc<Self> {
        let failover = FailoverSequence::new();
        for _ in 0..jobs {
            failover.add();
        }
        Arc::new(Self {
            failover,
            runs: std::array::from_fn(|_| AtomicUsize::new(0)),
        })
    }

    fn runs(&self) -> [usize; 2] {
        std::array::from_fn(|job| self.runs[job].load(Ordering::Relaxed))
    }

    /// A member that never hangs, and at once takes the runner before it for hung.
    fn serve(&self, member: u8) {
        loop {
            match self.failover.take(member) {
                Leg::Run(turn) => {
                    self.runs[turn.job()].fetch_add(1, Ordering::Relaxed);
                    if !self.failover.finish(turn) {
                        // It was left behind.
                        return;
                    }
                }
                Leg::Watch(turn) => {
                    self.failover.leave_behind(turn);
                }
                Leg::Rest => return,
            }
        }
    }
}

#[test]
fn members_that_leave_each_other_behind_run_each_job_once() {
    loom::model(|| {
        let scene = Scene::new(2);
        assert!(scene.failover.begin());
        let other = scene.clone();
        let second = loom::thread::spawn(move || other.serve(1));
        scene.serve(0);
        second.join().unwrap();
        // Both may have been left behind only if both jobs were.
        assert!(scene.failover.is_done());
        assert_eq!(scene.runs(), [1, 1]);
    });
}

#[test]
fn of_several_triggers_and_the_end_one_comes_first() {
    loom::model(|| {
        let scene = Scene::new(1);
        let triggers: Vec<_> = (0..2)
            .map(|_| {
                let scene = scene.clone();
                loom::thread::spawn(move || scene.failover.begin())
            })
            .collect();
        let is_closed = scene.failover.close();
        let begun = triggers
            .into_iter()
            .map(|one| usize::from(one.join().unwrap()))
            .sum::<usize>();
        assert_eq!(begun, usize::from(!is_closed));
        scene.serve(0);
        assert_eq!(scene.runs(), [begun, 0]);
    });
}

#[test]
fn a_job_that_comes_late_is_run_or_refused() {
    loom::model(|| {
        let scene = Scene::new(1);
        scene.failover.begin();
        let other = scene.clone();
        let adds = loom::thread::spawn(move || other.failover.add());
        scene.serve(0);
        let added = adds.join().unwrap();
        scene.serve(0);
        assert!(scene.failover.is_done());
        assert_eq!(scene.runs(), [1, usize::from(added.is_some())]);
    });
}

/// A job is removed as it begins: as many run as are left, and that is known at once.
#[test]
fn a_job_that_is_taken_back_meanwhile() {
    loom::model(|| {
        let scene = Scene::new(2);
        let other = scene.clone();
        let trigger = loom::thread::spawn(move || {
            other.failover.begin();
            other.serve(1);
        });
        let is_removed = scene.failover.remove();
        trigger.join().unwrap();
        assert!(scene.failover.is_done());
        assert_eq!(scene.runs(), [1, usize::from(!is_removed)]);
    });
}

/// A retirement and a reset at once: it is never ready again.
#[test]
fn one_that_is_retired_as_it_is_reset() {
    loom::model(|| {
        let scene = Scene::new(1);
        assert!(scene.failover.begin());
        scene.serve(0);
        let other = scene.clone();
        let resets = loom::thread::spawn(move || other.failover.again());
        assert!(scene.failover.retire());
        resets.join().unwrap();
        assert!(!scene.failover.begin() && !scene.failover.is_done());
    });
}

/// The jobs are given up as one is added, and as another member takes one: each is run, given up or
/// refused.
#[test]
fn jobs_that_are_given_up_as_others_come() {
    loom::model(|| {
        let scene = Scene::new(1);
        scene.failover.begin();
        let other = scene.clone();
        let adds = loom::thread::spawn(move || {
            let added = other.failover.add();
            other.serve(1);
            added
        });
        let given_up = scene.failover.give_up();
        let added = adds.join().unwrap();
        assert!(scene.failover.is_done());
        let jobs = 1 + usize::from(added.is_some());
        let first = given_up.unwrap_or(jobs);
        assert_eq!(scene.runs().iter().sum::<usize>(), first);
    });
}
