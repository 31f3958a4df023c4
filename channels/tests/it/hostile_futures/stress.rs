//! All of it at random, from a seed: on one thread and two, on one executor and two.
//!
//! `LUNA_SEED` says the seed, which is printed, and `LUNA_HOSTILE_POLLS` how many polls there are
//! in all.

use crate::common::Random;
use crate::hostile_futures::actors::{Temper, endure, silence_expected_panics, waker};
use crate::hostile_futures::one_at_a_time;
use crate::hostile_futures::world::{KINDS, Kept, Operation, PLAIN_KINDS, World};
use luna_core::{Executor, ExecutorHandle, Exit, ProcessSpec};
use luna_platform::thread::Attributes;
use std::future::poll_fn;
use std::mem;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

const POLLS: u64 = 60_000;
/// How many operations a driver has under way.
const SLOTS: usize = 24;
/// How many steps a world lasts for each driver, about.
const WORLD_STEPS: usize = 400;

/// What the drivers of one run share.
struct Common {
    world: Mutex<Arc<World>>,
    /// Operations on their way to another driver.
    moved: Mutex<Vec<Operation>>,
    executor: Option<ExecutorHandle>,
    polls: Arc<AtomicU64>,
    limit: u64,
}

impl Common {
    fn new(executor: Option<ExecutorHandle>, limit: u64) -> Arc<Self> {
        Arc::new(Self {
            world: Mutex::new(World::new(executor.clone(), true)),
            moved: Mutex::new(Vec::new()),
            executor,
            polls: Arc::default(),
            limit,
        })
    }

    fn is_over(&self) -> bool {
        self.polls.load(Ordering::Relaxed) >= self.limit
    }
}

struct Driver {
    common: Arc<Common>,
    random: Random,
    slots: Vec<Option<Operation>>,
    kept: Vec<Kept>,
    wakers: Vec<Waker>,
}

impl Driver {
    fn new(common: Arc<Common>, seed: u64) -> Self {
        Self {
            common,
            random: Random::new(seed),
            slots: (0..SLOTS).map(|_| None).collect(),
            kept: Vec::new(),
            wakers: Vec::new(),
        }
    }

    fn world(&self) -> Arc<World> {
        self.common.world.lock().unwrap().clone()
    }

    /// One step. `cx` is that of the process that drives, if it is one.
    fn step(&mut self, cx: Option<&mut Context<'_>>) {
        let slot = self.random.below(SLOTS);
        match self.random.below(100) {
            0..70 => self.poll(slot, cx),
            70..76 => {
                let operation = self.slots[slot].take();
                endure(|| drop(operation));
            }
            76..80 => {
                // To another driver, maybe.
                let ours = self.slots[slot].take();
                let theirs = {
                    let mut moved = self.common.moved.lock().unwrap();
                    let theirs = (moved.len() > 4).then(|| moved.remove(0));
                    moved.extend(ours);
                    theirs
                };
                self.slots[slot] = theirs;
            }
            80..90 => {
                let world = self.world();
                endure(|| world.touch(&mut self.random));
                endure(|| drop(world));
            }
            90..95 => {
                if !self.kept.is_empty() {
                    let which = self.random.below(self.kept.len());
                    let kept = self.kept.swap_remove(which);
                    endure(|| drop(kept));
                }
            }
            95 => {
                let world = self.world();
                endure(|| world.break_something(&mut self.random));
                endure(|| drop(world));
            }
            96 if self.random.below(6) == 0 => mem::forget(self.slots[slot].take()),
            97 if self.random.below(WORLD_STEPS / 100) == 0 => {
                let values_panic = self.random.below(3) != 0;
                let world = World::new(self.common.executor.clone(), values_panic);
                let before = mem::replace(&mut *self.common.world.lock().unwrap(), world);
                endure(|| drop(before));
            }
            _ => {
                if !self.wakers.is_empty() {
                    let which = self.random.below(self.wakers.len());
                    let waker = self.wakers.swap_remove(which);
                    endure(|| drop(waker));
                }
            }
        }
    }

    fn waker(&mut self) -> Waker {
        let world = self.world();
        let mut part = |of: usize| self.random.below(of) as u8;
        let temper = Temper {
            panics: [part(16), part(64), part(48)],
            touches: part(24),
        };
        let waker = waker(temper, &world, self.random.next());
        endure(|| drop(world));
        waker
    }

    fn poll(&mut self, slot: usize, cx: Option<&mut Context<'_>>) {
        if self.slots[slot].is_none() {
            let kinds = match self.common.executor {
                Some(_) => KINDS,
                None => PLAIN_KINDS,
            };
            let mut kind = self.random.below(kinds);
            // Blocking calls and processes take long.
            if kind >= KINDS - 2 && self.random.below(40) != 0 {
                kind = self.random.below(PLAIN_KINDS);
            }
            let world = self.world();
            self.slots[slot] = endure(|| world.operation(kind, &mut self.random)).flatten();
            endure(|| drop(world));
        }
        if self.wakers.len() < 8 {
            let waker = self.waker();
            self.wakers.push(waker);
        }
        let which = self.random.below(8);
        let Some(operation) = &mut self.slots[slot] else {
            return;
        };
        self.common.polls.fetch_add(1, Ordering::Relaxed);
        let polled = match (cx, self.random.below(5)) {
            (Some(cx), 0..=2) => endure(|| operation.poll(cx)),
            (_, 3) => endure(|| operation.poll(&mut Context::from_waker(Waker::noop()))),
            _ => {
                let mut cx = Context::from_waker(&self.wakers[which % self.wakers.len()]);
                endure(|| operation.poll(&mut cx))
            }
        };
        match polled {
            Some(Poll::Pending) => {}
            Some(Poll::Ready(result)) => {
                let kept = self.slots[slot].take().map(|over| Kept(result, over));
                if self.kept.len() < 8 {
                    self.kept.extend(kept);
                } else {
                    endure(|| drop(kept));
                }
            }
            // It panicked: mostly it goes, and else it is polled again.
            None if self.random.below(3) != 0 => {
                let operation = self.slots[slot].take();
                endure(|| drop(operation));
            }
            None => {}
        }
    }

    fn end(mut self) {
        for operation in mem::take(&mut self.slots) {
            endure(|| drop(operation));
        }
        for kept in mem::take(&mut self.kept) {
            endure(|| drop(kept));
        }
        for waker in mem::take(&mut self.wakers) {
            endure(|| drop(waker));
        }
    }
}

/// Ends the program if the run hangs.
fn watch(common: &Arc<Common>, seed: u64) {
    // Not the whole: its last user drops what is left.
    let polls = Arc::downgrade(&common.polls);
    std::thread::spawn(move || {
        let (mut last, mut since) = (0, Instant::now());
        while let Some(polls) = polls.upgrade() {
            let polls = polls.load(Ordering::Relaxed);
            if polls != last {
                (last, since) = (polls, Instant::now());
            }
            if since.elapsed() > Duration::from_secs(120) {
                eprintln!("hangs after {polls} polls; seed {seed}");
                std::process::abort();
            }
            std::thread::sleep(Duration::from_millis(200));
        }
    });
}

fn on_threads(threads: u64, limit: u64, seed: u64) {
    let common = Common::new(None, limit);
    watch(&common, seed);
    std::thread::scope(|scope| {
        for number in 0..threads {
            let common = common.clone();
            scope.spawn(move || {
                let mut driver = Driver::new(common, seed + number);
                while !driver.common.is_over() {
                    driver.step(None);
                }
                driver.end();
            });
        }
    });
    endure(|| drop(common));
}

fn on_executors(executors: u64, limit: u64, seed: u64) {
    let started: Vec<_> = (0..executors)
        .map(|_| Executor::start(Attributes::new("hostile")).unwrap())
        .collect();
    let common = Common::new(started.first().map(|first| first.handle().clone()), limit);
    watch(&common, seed);
    let mut processes = Vec::new();
    for (number, executor) in (0..).zip(&started) {
        for process in 0..3 {
            let common = common.clone();
            let spec = ProcessSpec::new("drives");
            processes.push(executor.spawn(spec, move || async move {
                let mut driver = Driver::new(common, seed + 16 * number + process);
                poll_fn(|cx| {
                    for _ in 0..16 {
                        driver.step(Some(cx));
                    }
                    cx.waker().wake_by_ref();
                    match driver.common.is_over() {
                        true => Poll::Ready(()),
                        false => Poll::Pending,
                    }
                })
                .await;
                driver.end();
            }));
        }
    }
    started.iter().for_each(Executor::release);
    for process in processes {
        match process.wait() {
            Exit::Completed => {}
            // User code that panics where no process has its turn ends the executor, by design.
            Exit::Panicked(text) if text.contains("outside of any process") => {}
            other => panic!("{other:?}, seed {seed}"),
        }
    }
    // What is left is dropped by a thread that is no executor's.
    endure(|| drop(common));
    started.into_iter().for_each(Executor::stop);
}

#[test]
fn nothing_breaks_at_random() {
    let _alone = one_at_a_time();
    let number = |name: &str| std::env::var(name).ok()?.parse::<u64>().ok();
    let polls = number("LUNA_HOSTILE_POLLS").unwrap_or(POLLS);
    let seed = number("LUNA_SEED").unwrap_or_else(|| {
        let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        since.unwrap_or_default().as_secs()
    });
    println!("seed: LUNA_SEED={seed}, {polls} polls");
    silence_expected_panics();
    let began = Instant::now();
    on_threads(1, polls / 4, seed);
    on_threads(2, polls / 4, seed + 1000);
    on_executors(1, polls / 4, seed + 2000);
    on_executors(2, polls / 4, seed + 3000);
    println!("{polls} polls in {:.1} s", began.elapsed().as_secs_f64());
}
