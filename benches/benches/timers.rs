//! `timers`: the cost of setting a timer and cancelling it while others are pending, and of waking
//! many processes at the same time; on one core.

use std::{
    future::Future,
    ops::Sub,
    sync::{
        Arc, Mutex, OnceLock, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use futures_lite::future::poll_once;
use luna_benches::{
    cores::one_core,
    executors::{Executor, on_one_core},
    harness::{Case, is_quick, run},
    ours::Luna,
    primitives,
    processes::warm_up,
};
use tokio::runtime;

const SET: &str = "timer, set and taken back, beside others";
const EXPIRED: &str = "timers, expired at once";

/// How many wait beside.
fn waiting() -> &'static [u64] {
    if is_quick() {
        &[0, 100]
    } else {
        &[0, 10, 100, 1_000, 10_000, 100_000]
    }
}

/// How many expire.
fn expiring() -> &'static [u64] {
    if is_quick() {
        &[10, 100]
    } else {
        &[10, 100, 1_000, 10_000, 100_000]
    }
}

/// tokio's current-thread runtime with its timers, which the other benches leave out.
#[derive(Debug)]
struct TokioTimed(runtime::Runtime);

impl Executor for TokioTimed {
    fn new(_: core_affinity::CoreId) -> Self {
        let runtime = runtime::Builder::new_current_thread().enable_time().build();
        TokioTimed(runtime.expect("a runtime with timers asks nothing of the system"))
    }

    fn spawn<T: Send + 'static>(
        &self,
        process: impl Future<Output = T> + Send + 'static,
    ) -> impl Future<Output = T> {
        let task = self.0.spawn(process);
        async {
            task.await
                .expect("a process of a bench panics when its check fails")
        }
    }

    fn start(&self, process: impl Future<Output = ()> + Send + 'static) {
        self.0.spawn(process);
    }

    fn block_on<T>(&self, future: impl Future<Output = T>) -> T {
        self.0.block_on(future)
    }
}

/// A peer's timers.
trait Timers: Executor {
    /// A point of its time.
    type Moment: Copy + PartialOrd + Sub<Output = Duration> + Send + Sync + 'static;

    fn from_now(delay: Duration) -> Self::Moment;
    fn sleep_until(deadline: Self::Moment) -> impl Future<Output = ()> + Send + 'static;
}

impl Timers for Luna {
    type Moment = luna::Instant;

    fn from_now(delay: Duration) -> luna::Instant {
        luna::now() + delay
    }

    fn sleep_until(deadline: luna::Instant) -> impl Future<Output = ()> + Send + 'static {
        luna::at(deadline)
    }
}

impl Timers for TokioTimed {
    type Moment = tokio::time::Instant;

    fn from_now(delay: Duration) -> tokio::time::Instant {
        tokio::time::Instant::now() + delay
    }

    fn sleep_until(deadline: tokio::time::Instant) -> impl Future<Output = ()> + Send + 'static {
        tokio::time::sleep_until(deadline)
    }
}

/// Longer than any block.
const FAR: Duration = Duration::from_secs(3_600);

/// tokio limits a process' operations between yields; half of that.
const BETWEEN_YIELDS: u64 = 64;

fn set_and_taken_back<E: Timers>(others: u64, operations: u64) -> Duration {
    on_one_core(|executor: &E| {
        let (listed, over): (Arc<AtomicBool>, Arc<AtomicBool>) = Default::default();
        let (lists, holds) = (listed.clone(), over.clone());
        // One process has all the others, so that only the queue is measured; in random order of
        // time.
        let holder = executor.spawn(async move {
            let far = E::from_now(FAR);
            let mut timers = Vec::new();
            for other in 0..others {
                let mut timer = Box::pin(E::sleep_until(E::from_now(FAR + spread(other))));
                if other % BETWEEN_YIELDS == 0 {
                    E::yield_now().await;
                }
                assert!(poll_once(&mut timer).await.is_none(), "not an hour");
                timers.push(timer);
            }
            assert!(E::from_now(Duration::ZERO) < far, "an hour has passed");
            lists.store(true, Ordering::Relaxed);
            while !holds.load(Ordering::Relaxed) {
                E::yield_now().await;
            }
        });
        let timed = executor.spawn(async move {
            while !listed.load(Ordering::Relaxed) {
                E::yield_now().await;
            }
            let among = amidst(E::from_now);
            let mut start = Instant::now();
            let warm_up = warm_up(operations);
            for operation in 0..warm_up + operations {
                if operation % BETWEEN_YIELDS == 0 {
                    E::yield_now().await;
                }
                if operation == warm_up {
                    start = Instant::now();
                }
                let deadline = among[operation as usize % among.len()];
                assert!(
                    poll_once(E::sleep_until(deadline)).await.is_none(),
                    "not an hour"
                );
            }
            let elapsed = start.elapsed();
            over.store(true, Ordering::Relaxed);
            elapsed
        });
        executor.block_on(async {
            holder.await;
            timed.await
        })
    })
}

/// Up to ten seconds, without order.
fn spread(number: u64) -> Duration {
    Duration::from_millis(number * 7_919 % 10_007)
}

/// Deadlines amidst those of the others, in no order.
fn amidst<M>(from_now: impl Fn(Duration) -> M) -> Vec<M> {
    let deadlines = (0..1_024).map(|number| from_now(FAR + spread(number * 37 + 13)));
    deadlines.collect()
}

/// From the first process' run to the last one's, divided by the number between; the wake-up from
/// sleep, which comes before, has another bench. Includes reading the clock in each process, and a
/// lock.
fn expired<E: Timers>(size: u64) -> f64 {
    on_one_core(|executor: &E| {
        let deadline: Arc<OnceLock<E::Moment>> = Arc::default();
        let woken: Arc<Mutex<Woken<E::Moment>>> = Arc::new(Mutex::new(Woken {
            first: None,
            last: None,
        }));
        let (running, ended) = async_channel::bounded::<()>(1);
        for _ in 0..size {
            let (deadline, woken, running) = (deadline.clone(), woken.clone(), running.clone());
            executor.start(async move {
                let _running = running;
                // Long enough for all to have begun.
                let delay = Duration::from_micros(5_000 + 10 * size);
                let deadline = *deadline.get_or_init(|| E::from_now(delay));
                assert!(E::from_now(Duration::ZERO) < deadline, "began too late");
                E::sleep_until(deadline).await;
                let now = E::from_now(Duration::ZERO);
                assert!(now >= deadline, "woken too early");
                let mut woken = woken.lock().unwrap_or_else(PoisonError::into_inner);
                woken.first.get_or_insert(now);
                woken.last = Some(now);
            });
        }
        drop(running);
        // Ends when the last process has dropped its sender.
        let end = executor.spawn(async move { ended.recv().await.is_err() });
        executor.block_on(end);
        let woken = woken.lock().unwrap_or_else(PoisonError::into_inner);
        let elapsed = woken
            .first
            .zip(woken.last)
            .map(|(first, last)| last - first);
        elapsed.expect("some were woken").as_secs_f64() * 1e9 / (size - 1) as f64
    })
}

/// The processes that were woken.
#[derive(Debug)]
struct Woken<M> {
    first: Option<M>,
    last: Option<M>,
}

/// A system with a timer manager that has this many callbacks, due in an hour.
fn managed(
    others: u64,
) -> (
    luna::System,
    luna::time::TimerManager,
    Vec<luna::time::TimerCallback>,
) {
    let mut system = luna::System::new("bench");
    let most = usize::try_from(others).expect("they fit in memory") + 1;
    system.timers(luna::time::Timers::Manager).max_timers(most);
    let manager = system
        .timer_manager()
        .expect("the system was built with one");
    let now = luna::now();
    let others = (0..others).map(|other| {
        let callback = manager.callback("other", |_| ()).expect("there is room");
        callback.at(now + FAR + spread(other));
        callback
    });
    let others = others.collect();
    (system, manager, others)
}

/// The same with the timer manager's callbacks, set and cancelled by a process.
fn callback_set_and_cancelled(others: u64, operations: u64) -> Duration {
    let (mut system, manager, _others) = managed(others);
    let core = one_core().id;
    let executor = system.executor("bench").core(core).build();
    let taken: Arc<OnceLock<Duration>> = Arc::default();
    let result = taken.clone();
    let process = async move {
        let callback = manager.callback("timed", |_| unreachable!("not an hour"))?;
        let among = amidst(|delay| luna::now() + delay);
        let mut start = Instant::now();
        let warm_up = warm_up(operations);
        for operation in 0..warm_up + operations {
            if operation == warm_up {
                start = Instant::now();
            }
            callback.at(among[operation as usize % among.len()]);
            assert!(callback.cancel());
        }
        result.set(start.elapsed()).expect("it is set once");
        Ok(())
    };
    let executor = executor.expect("the core is one of the machine's");
    let spawned = executor.process("bench").spawn(process);
    spawned.expect("it has a name of its own");
    system.run().expect("its checks hold");
    *taken.get().expect("the process has ended")
}

/// The same with the timer manager's callbacks, including the clock read by each, and by the
/// manager around each.
fn callbacks_expired(size: u64) -> f64 {
    let (mut system, manager, _) = managed(0);
    system.max_timers(usize::try_from(size).expect("they fit in memory"));
    let called: Arc<Mutex<(u64, Woken<luna::Instant>)>> = Arc::new(Mutex::new((
        0,
        Woken {
            first: None,
            last: None,
        },
    )));
    let callbacks: Vec<_> = (0..size)
        .map(|_| {
            let called = called.clone();
            let callback = manager.callback("one", move |firing| {
                let now = luna::now();
                assert!(now >= firing.deadline, "called too early");
                let mut called = called.lock().unwrap_or_else(PoisonError::into_inner);
                called.0 += 1;
                called.1.first.get_or_insert(now);
                called.1.last = Some(now);
            });
            callback.expect("there is room")
        })
        .collect();
    let executor = system.executor("bench").build();
    let counted = called.clone();
    let process = async move {
        let deadline = luna::now() + Duration::from_micros(1_000 + size);
        for callback in &callbacks {
            callback.at(deadline);
        }
        loop {
            luna::after(Duration::from_millis(1)).await;
            let called = counted.lock().unwrap_or_else(PoisonError::into_inner);
            if called.0 == size {
                return Ok(());
            }
        }
    };
    let executor = executor.expect("it has a name of its own");
    let spawned = executor.process("bench").spawn(process);
    spawned.expect("it has a name of its own");
    system.run().expect("its checks hold");
    let called = called.lock().unwrap_or_else(PoisonError::into_inner);
    let elapsed = called.1.first.zip(called.1.last);
    let elapsed = elapsed.map(|(first, last)| last - first);
    elapsed.expect("some were called").as_secs_f64() * 1e9 / (size - 1) as f64
}

const TOKIO: &str = "tokio, spawn";
const MANAGER: &str = "LUNA, timer manager's callbacks";

/// Some are too large to be measured as often as the others.
const LARGE: u64 = 100_000;

fn main() {
    let mut cases = Vec::new();
    for &size in waiting() {
        let case = |peer, block: fn(u64, u64) -> Duration| {
            Case::new(SET, peer, "ns/timer", move |operations| {
                block(size, operations)
            })
            .size(size)
        };
        cases.push(case("LUNA", set_and_taken_back::<Luna>));
        cases.push(case(MANAGER, callback_set_and_cancelled));
        cases.push(case(TOKIO, set_and_taken_back::<TokioTimed>));
    }
    for &size in expiring() {
        let case = |peer, block: fn(u64) -> f64| {
            let case = Case::once(EXPIRED, peer, "ns/process", move || block(size)).size(size);
            case.blocks(if size == LARGE { 3 } else { usize::MAX })
        };
        cases.push(case("LUNA", expired::<Luna>));
        cases.push(case(MANAGER, callbacks_expired));
        cases.push(case(TOKIO, expired::<TokioTimed>));
    }
    cases.extend(primitives::one_core_cases());
    run("timers", cases);
}
