//! No wake of a branch is lost, in any interleaving of wakers and parent.

use super::*;
use std::task::Poll;

/// The parent ends when each branch has been woken as often as given; a lost wake is a deadlock.
fn no_wake_is_lost(count: usize, branches_of_wakers: &'static [&'static [usize]]) {
    let mut model = loom::model::Builder::new();
    // All interleavings take hours.
    model.preemption_bound = Some(2);
    model.check(move || {
        let mut branches = Branches::new(count);
        let waker_of = |branch: &usize| branches.with_waker(*branch, |cx| cx.waker().clone());
        let wakers = branches_of_wakers.iter().map(|of_one| {
            let own: Vec<Waker> = of_one.iter().map(waker_of).collect();
            loom::thread::spawn(move || own.into_iter().for_each(Waker::wake))
        });
        let wakers: Vec<_> = wakers.collect();
        let mut missing: Vec<usize> = branches_of_wakers.concat();
        missing.sort_unstable();
        missing.dedup();
        loom::future::block_on(std::future::poll_fn(|cx| {
            branches.stop_waiting();
            while let Some(branch) = branches.next() {
                missing.retain(|&other| other != branch);
            }
            if missing.is_empty() {
                return Poll::Ready(());
            }
            branches.wait(cx);
            Poll::Pending
        }));
        // The wakers may still use the block that was dropped here.
        drop(branches);
        for waker in wakers {
            waker.join().unwrap();
        }
    });
}

#[test]
fn two_branches_of_one_word() {
    no_wake_is_lost(2, &[&[0], &[1]]);
}

#[test]
fn two_words() {
    no_wake_is_lost(65, &[&[0], &[64]]);
}

#[test]
fn one_branch_after_another() {
    no_wake_is_lost(2, &[&[0, 1, 0]]);
}
