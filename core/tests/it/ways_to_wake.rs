//! A process is woken by its wakers and without them, on its own thread and from elsewhere (see
//! `task`). Here all is done at once, in all orders, by all threads, also while the process ends.

#![cfg(not(loom))]

use crate::support;
use luna_core::current::{self, QueueEnd};
use luna_core::{Executor, Exit, ProcessHandle, ProcessSpec};
use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Waker};
use support::{Drops, Random, Token, executor, quiet_panics, rounds, until, watchdog};

/// What a process does to itself in one poll.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pull {
    /// Through the waker.
    Waker,
    /// On its own thread, without the waker.
    Here(QueueEnd),
    /// Through a waker that another thread wakes before this poll goes on.
    Elsewhere,
}

const PULLS: [Pull; 4] = [
    Pull::Waker,
    Pull::Here(QueueEnd::Front),
    Pull::Here(QueueEnd::Back),
    Pull::Elsewhere,
];

fn pull(pull: Pull, cx: &Context<'_>) {
    match pull {
        Pull::Waker => cx.waker().wake_by_ref(),
        Pull::Here(place) => current::ready_again(cx, place),
        Pull::Elsewhere => {
            let waker = cx.waker().clone();
            std::thread::spawn(move || waker.wake()).join().unwrap();
        }
    }
}

/// Ends in its poll number `polls`, and pulls `pulls` in each, the last included. Each poll takes
/// one reading of `cx` alone.
async fn pulled(polls: usize, pulls: Vec<Pull>) {
    let mut count = 0;
    poll_fn(move |cx| {
        count += 1;
        pulls.iter().for_each(|&one| pull(one, cx));
        if count == polls {
            Poll::Ready(())
        } else {
            Poll::Pending
        }
    })
    .await;
}

#[test]
fn every_pair_of_pulls_in_the_first_a_later_and_the_last_poll() {
    let _watchdog = watchdog();
    for polls in 1..=3 {
        for first in PULLS {
            for second in PULLS {
                let (executor, drops) = (executor(), Drops::default());
                let token = drops.token();
                let process = executor.spawn(ProcessSpec::new("pulled"), move || async move {
                    let _token = token;
                    pulled(polls, vec![first, second, first]).await;
                });
                executor.release();
                assert_eq!(process.wait(), Exit::Completed, "{first:?} {second:?}");
                assert_eq!(
                    (process.polls(), drops.count()),
                    (polls as u64, 1),
                    "{first:?} {second:?}"
                );
                // Ends only if the task was retired.
                executor.stop();
            }
        }
    }
}

#[test]
fn however_often_it_is_woken_on_its_thread_it_runs_once_more() {
    let _watchdog = watchdog();
    let executor = executor();
    let spec = || ProcessSpec::new("woken").level(20);
    let process = executor.spawn(spec(), || async {
        pulled(
            2,
            [[Pull::Waker; 10], [Pull::Here(QueueEnd::Back); 10]].concat(),
        )
        .await;
        // Nothing wakes it after the next poll, so the lower one below runs, and then this one
        // again.
        let mut polls = 0;
        poll_fn(move |cx| {
            polls += 1;
            WOKEN.lock().unwrap().replace(cx.waker().clone());
            if polls == 3 {
                Poll::Ready(())
            } else {
                Poll::Pending
            }
        })
        .await;
    });
    static WOKEN: Mutex<Option<Waker>> = Mutex::new(None);
    let lower = executor.spawn(ProcessSpec::new("lower").level(10), || async {
        WOKEN.lock().unwrap().take().unwrap().wake();
    });
    executor.release();
    assert_eq!(lower.wait(), Exit::Completed);
    // Once to begin, once for twenty wakes in the first poll, once for as many in the second, and
    // once for the last one.
    assert_eq!((process.wait(), process.polls()), (Exit::Completed, 4));
}

#[test]
fn one_that_wakes_itself_comes_after_those_that_are_ready_when_its_turn_is_over() {
    static WAITS: Mutex<Option<Waker>> = Mutex::new(None);
    static ORDER: Mutex<Vec<&str>> = Mutex::new(Vec::new());
    let _watchdog = watchdog();
    let executor = executor();
    executor.spawn(ProcessSpec::new("waits"), || async {
        let mut polls = 0;
        poll_fn(move |cx| {
            polls += 1;
            WAITS.lock().unwrap().replace(cx.waker().clone());
            match polls {
                1 => return Poll::Pending,
                _ => ORDER.lock().unwrap().push("waits"),
            }
            Poll::Ready(())
        })
        .await;
    });
    let wakes = executor.spawn(ProcessSpec::new("wakes"), || async {
        let mut polls = 0;
        poll_fn(move |cx| {
            ORDER.lock().unwrap().push("wakes");
            polls += 1;
            if polls == 2 {
                return Poll::Ready(());
            }
            cx.waker().wake_by_ref();
            WAITS.lock().unwrap().take().unwrap().wake();
            Poll::Pending
        })
        .await;
    });
    executor.release();
    assert_eq!(wakes.wait(), Exit::Completed);
    assert_eq!(*ORDER.lock().unwrap(), ["wakes", "waits", "wakes"]);
}

/// A process with polls that do random things, and which hands its waker to all the attackers.
struct Attacked {
    random: Random,
    wakers: Arc<Mutex<Vec<Waker>>>,
    _token: Token,
    left: u64,
}

impl Future for Attacked {
    type Output = ();

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        assert!(self.left > 0, "polled after its end");
        self.left -= 1;
        for _ in 0..self.random.below(4) {
            match self.random.below(5) {
                0 => cx.waker().wake_by_ref(),
                1 => current::ready_again(cx, QueueEnd::Front),
                2 => current::ready_again(cx, QueueEnd::Back),
                3 => std::iter::repeat_n(cx.waker().clone(), 2).for_each(Waker::wake),
                _ => self.wakers.lock().unwrap().push(cx.waker().clone()),
            }
        }
        if self.left == 0 {
            assert!(self.random.below(8) > 0, "on purpose");
            return Poll::Ready(());
        }
        // A wake must follow: from itself, in one of the ways, or from an attacker.
        match self.random.below(3) {
            0 => cx.waker().wake_by_ref(),
            1 => current::ready_again(cx, QueueEnd::Back),
            _ => self.wakers.lock().unwrap().push(cx.waker().clone()),
        }
        Poll::Pending
    }
}

/// Wakes, drops and cancels at random until the stop flag is set and nothing is left to wake.
fn attack(
    mut random: Random,
    wakers: &Mutex<Vec<Waker>>,
    processes: &[ProcessHandle],
    stop: &AtomicBool,
) {
    let mut kept = Vec::new();
    loop {
        let mine = std::mem::take(&mut *wakers.lock().unwrap());
        if mine.is_empty() && stop.load(Ordering::SeqCst) {
            return;
        }
        for waker in mine {
            match random.below(4) {
                0 => waker.wake_by_ref(),
                1 => {
                    kept.push(waker.clone());
                    waker.wake();
                }
                _ => waker.wake(),
            }
        }
        if random.below(64) == 0 {
            processes[random.below(processes.len() as u64) as usize].cancel();
        }
        if random.below(8) == 0 {
            kept.drain(..).for_each(|waker: Waker| {
                if random.below(2) == 0 {
                    waker.wake()
                }
            });
        }
    }
}

#[test]
fn stress() {
    let _watchdog = watchdog();
    quiet_panics();
    let mut random = Random::seeded();
    for round in 0..rounds(60) {
        let (drops, wakers) = (Drops::default(), Arc::new(Mutex::new(Vec::new())));
        let executors: Vec<Executor> = (0..1 + round % 2).map(|_| executor()).collect();
        let processes: Vec<ProcessHandle> = (0..100)
            .map(|n| {
                let (random, wakers, token) = (random.split(), wakers.clone(), drops.token());
                let left = 1 + random.clone().below(50);
                let level = random.clone().below(4) as u8;
                executors[n % executors.len()].spawn(
                    ProcessSpec::new("attacked").level(level),
                    move || Attacked {
                        random,
                        wakers,
                        _token: token,
                        left,
                    },
                )
            })
            .collect();
        let stop = AtomicBool::new(false);
        let stop_early = random.below(3) == 0;
        std::thread::scope(|scope| {
            for _ in 0..3 {
                let (random, wakers) = (random.split(), wakers.clone());
                let (processes, stop) = (&processes, &stop);
                scope.spawn(move || attack(random, &wakers, processes, stop));
            }
            executors.iter().for_each(Executor::release);
            if stop_early {
                until(|| {
                    processes
                        .iter()
                        .filter(|process| process.exit().is_some())
                        .count()
                        > 10
                });
                executors.into_iter().for_each(Executor::stop);
            } else {
                processes.iter().for_each(|process| drop(process.wait()));
                // Ends only if all tasks were retired, each once.
                executors.into_iter().for_each(Executor::stop);
            }
            stop.store(true, Ordering::SeqCst);
        });
        assert_eq!(drops.count(), 100, "each body was dropped once");
        for process in &processes {
            let exit = process.exit().expect("all have ended");
            assert!(
                matches!(&exit, Exit::Completed | Exit::Cancelled)
                    || exit == Exit::Panicked("on purpose".into()),
                "{exit}"
            );
        }
    }
}
