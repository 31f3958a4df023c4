//! Other people's combinators inside a process: some pass the waker on, some have wakers of their
//! own.

#![cfg(not(loom))]

use crate::support;
use futures_lite::future::{or, race, zip};
use luna_core::timer_queue::Sleep;
use luna_core::{Exit, ProcessSpec, blocking, yield_now};
use luna_platform::clock::Instant;
use std::collections::VecDeque;
use std::future::{Future, pending, poll_fn};
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Wake, Waker};
use std::time::Duration;
use support::{Gate, Log, executor, rounds, until, watchdog};

#[test]
fn or_zip_and_race_inside_a_process() {
    let _watchdog = watchdog();
    let executor = executor();
    let process = executor.spawn(ProcessSpec::new("combines"), || async {
        let both = zip(
            async {
                yield_now().await;
                1
            },
            async {
                Sleep::until(Instant::now() + Duration::from_micros(200)).await;
                2
            },
        );
        assert_eq!(both.await, (1, 2));
        assert_eq!(or(async { blocking(|| 3).await }, pending()).await, 3);
        race(pending(), async {
            for _ in 0..10 {
                yield_now().await;
            }
        })
        .await;
        let too_late = async {
            Sleep::until(Instant::now() + Duration::from_secs(10_000)).await;
            false
        };
        assert!(or(too_late, async { true }).await);
    });
    executor.release();
    assert_eq!(process.wait(), Exit::Completed);
}

/// Polls only those of its futures that were woken, as `FuturesUnordered` does: each has a waker of
/// its own.
struct Unordered {
    futures: Vec<Option<Pin<Box<dyn Future<Output = usize> + Send>>>>,
    ready: Arc<Ready>,
}

#[derive(Default)]
struct Ready {
    queue: Mutex<VecDeque<usize>>,
    parent: Mutex<Option<Waker>>,
}

struct Child(usize, Arc<Ready>);

impl Wake for Child {
    fn wake(self: Arc<Self>) {
        self.1.queue.lock().unwrap().push_back(self.0);
        let parent = self.1.parent.lock().unwrap().clone();
        if let Some(parent) = parent {
            parent.wake();
        }
    }
}

impl Unordered {
    fn new(futures: Vec<Pin<Box<dyn Future<Output = usize> + Send>>>) -> Self {
        let ready = Arc::new(Ready::default());
        ready.queue.lock().unwrap().extend(0..futures.len());
        Self {
            futures: futures.into_iter().map(Some).collect(),
            ready,
        }
    }

    fn poll_next(&mut self, cx: &Context<'_>) -> Poll<Option<usize>> {
        *self.ready.parent.lock().unwrap() = Some(cx.waker().clone());
        loop {
            let Some(index) = self.ready.queue.lock().unwrap().pop_front() else {
                return if self.futures.iter().all(Option::is_none) {
                    Poll::Ready(None)
                } else {
                    Poll::Pending
                };
            };
            let Some(future) = &mut self.futures[index] else {
                continue;
            };
            let waker = Waker::from(Arc::new(Child(index, self.ready.clone())));
            if let Poll::Ready(output) = future.as_mut().poll(&mut Context::from_waker(&waker)) {
                self.futures[index] = None;
                return Poll::Ready(Some(output));
            }
        }
    }
}

#[test]
fn futures_with_wakers_of_their_own() {
    let _watchdog = watchdog();
    for round in 0..rounds(50) {
        let executor = executor();
        let (gates, log) = (Log::new(), Log::new());
        let handle = executor.handle().clone();
        let (own, done) = (gates.clone(), log.clone());
        let process = executor.spawn(ProcessSpec::new("unordered"), move || async move {
            let other = handle.spawn(ProcessSpec::new("other"), || async { yield_now().await });
            let mut futures: Vec<Pin<Box<dyn Future<Output = usize> + Send>>> = Vec::new();
            for n in 0..20 {
                let gate = Gate::default();
                own.add(gate.clone());
                let other = other.clone();
                futures.push(match n % 5 {
                    0 => Box::pin(async move {
                        Sleep::until(Instant::now() + Duration::from_micros(n as u64 * 20)).await;
                        n
                    }),
                    1 => Box::pin(async move {
                        yield_now().await;
                        n
                    }),
                    2 => Box::pin(async move { blocking(move || n).await }),
                    3 => Box::pin(async move {
                        other.join().await;
                        n
                    }),
                    _ => Box::pin(async move {
                        gate.pass().await;
                        n
                    }),
                });
            }
            let mut all = Unordered::new(futures);
            if round % 2 == 0 {
                while let Some(n) = poll_fn(|cx| all.poll_next(cx)).await {
                    done.add(n);
                }
            } else {
                // Dropped with most of them waiting: their wakers may still be used.
                done.add(poll_fn(|cx| all.poll_next(cx)).await.unwrap());
            }
        });
        executor.release();
        until(|| gates.len() == 20);
        gates.take().iter().for_each(Gate::open);
        assert_eq!(process.wait(), Exit::Completed);
        let mut done = log.take();
        done.sort_unstable();
        assert!(if round % 2 == 0 {
            done == (0..20).collect::<Vec<_>>()
        } else {
            done.len() == 1
        });
    }
}
