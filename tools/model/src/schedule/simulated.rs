//! Random sets of tasks, run by a simulated core: no response is longer than its bound.

use super::{Arrivals, Demand, Task, Thread, bounds};
use std::collections::VecDeque;
use std::time::Duration;

/// SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// From `low` to `high`, both included.
    fn within(&mut self, low: u64, high: u64) -> u64 {
        low + self.next() % (high - low + 1)
    }
}

/// A set, with the polls of each task's job. Times in ns.
#[derive(Debug, Clone)]
struct Set {
    threads: Vec<Thread>,
    tasks: Vec<Task>,
    polls: Vec<Vec<u64>>,
}

const UNIT: u64 = 1000;

fn set(random: &mut Random) -> Set {
    let threads: Vec<Thread> = (0..random.within(1, 3))
        .map(|_| {
            let rank = random.within(1, 4) as u8;
            Thread { core: 0, rank }
        })
        .collect();
    let count = random.within(2, 6);
    let load = random.within(30, 95) as f64 / 100.0 / count as f64;
    let mut polls = Vec::new();
    let tasks = (0..count)
        .map(|_| {
            let period = UNIT * random.within(100, 2000);
            let cost = ((period as f64 * load) as u64).max(10);
            let parts = random.within(1, 4);
            let mut own: Vec<u64> = (1..parts).map(|_| random.within(1, cost / parts)).collect();
            own.push(cost - own.iter().sum::<u64>());
            let longest = own.iter().copied().max().unwrap_or(cost);
            let is_one_poll = own.len() == 1;
            polls.push(own);
            Task {
                thread: random.within(0, threads.len() as u64 - 1) as usize,
                priority: random.within(0, 3) as u8,
                demand: Some(Demand {
                    arrivals: Arrivals::Periodic {
                        period: Duration::from_nanos(period),
                        jitter: Duration::from_nanos(random.within(0, period / 10)),
                    },
                    cost: Duration::from_nanos(cost),
                }),
                longest_poll: Some(Duration::from_nanos(longest)),
                is_one_poll,
            }
        })
        .collect();
    Set {
        threads,
        tasks,
        polls,
    }
}

/// A job that is ready.
struct Job {
    task: usize,
    slot: u64,
    next_poll: usize,
}

struct Core<'a> {
    set: &'a Set,
    /// Of each thread: what is ready, in the order in which it became so, and the poll that it has
    /// begun with what is left of it.
    ready: Vec<VecDeque<Job>>,
    begun: Vec<Option<(Job, u64)>>,
    /// Threads that have work, in the order in which they had some: of those of one rank the first
    /// has the core until it sleeps, also if another takes the core from it meanwhile.
    awake: Vec<usize>,
    /// Of each task: whether it has a job, and the slots of those that are released behind it.
    is_busy: Vec<bool>,
    behind: Vec<VecDeque<u64>>,
    worst: Vec<u64>,
}

impl<'a> Core<'a> {
    fn new(set: &'a Set) -> Self {
        let (threads, tasks) = (set.threads.len(), set.tasks.len());
        Self {
            set,
            ready: (0..threads).map(|_| VecDeque::new()).collect(),
            begun: (0..threads).map(|_| None).collect(),
            awake: Vec::new(),
            is_busy: vec![false; tasks],
            behind: vec![VecDeque::new(); tasks],
            worst: vec![0; tasks],
        }
    }

    /// A process has one job at a time: the next one begins when it has ended.
    fn release(&mut self, task: usize, slot: u64) {
        if std::mem::replace(&mut self.is_busy[task], true) {
            return self.behind[task].push_back(slot);
        }
        let thread = self.set.tasks[task].thread;
        self.ready[thread].push_back(Job {
            task,
            slot,
            next_poll: 0,
        });
        if !self.awake.contains(&thread) {
            self.awake.push(thread);
        }
    }

    /// The thread that has the core.
    fn choose(&mut self) -> Option<usize> {
        let (begun, ready) = (&self.begun, &self.ready);
        self.awake
            .retain(|thread| begun[*thread].is_some() || !ready[*thread].is_empty());
        let rank = |thread: &usize| self.set.threads[*thread].rank;
        self.awake.iter().rev().copied().max_by_key(rank)
    }

    /// Lets the thread begin its most urgent job's next poll, if it has begun none.
    fn begin(&mut self, thread: usize) {
        if self.begun[thread].is_some() {
            return;
        }
        let priority = |job: &Job| self.set.tasks[job.task].priority;
        let ready = &mut self.ready[thread];
        // The first of the most urgent.
        let best = (0..ready.len())
            .rev()
            .max_by_key(|place| priority(&ready[*place]));
        if let Some(job) = best.and_then(|place| ready.remove(place)) {
            let length = self.set.polls[job.task][job.next_poll];
            self.begun[thread] = Some((job, length));
        }
    }

    /// Runs from `now` until `until`, or until all is done.
    fn run(&mut self, mut now: u64, until: u64) {
        while now < until {
            let Some(thread) = self.choose() else { return };
            self.begin(thread);
            let Some((mut job, left)) = self.begun[thread].take() else {
                return;
            };
            let step = left.min(until - now);
            now += step;
            if step < left {
                self.begun[thread] = Some((job, left - step));
                continue;
            }
            job.next_poll += 1;
            if job.next_poll < self.set.polls[job.task].len() {
                self.ready[thread].push_back(job);
                continue;
            }
            self.worst[job.task] = self.worst[job.task].max(now - job.slot);
            self.is_busy[job.task] = false;
            if let Some(slot) = self.behind[job.task].pop_front() {
                self.release(job.task, slot);
            }
        }
    }
}

/// The longest response of each task.
fn simulate(set: &Set, random: &mut Random, is_critical: bool) -> Vec<u64> {
    let end = 60 * 2000 * UNIT;
    let mut releases = Vec::new();
    for (number, task) in set.tasks.iter().enumerate() {
        let (period, jitter) = times(task);
        // The critical instant: late releases of all at once, and early ones then. In a thread the
        // lower priorities come first by a nanosecond, so that they have begun when others come.
        let first = match is_critical {
            true => 2000 * UNIT - jitter - u64::from(3 - task.priority),
            false => random.within(0, period),
        };
        let slots = (0..)
            .map(|n| first + n * period)
            .take_while(|slot| *slot < end);
        for (job, slot) in slots.enumerate() {
            let late = match is_critical {
                true if job == 0 => jitter,
                true => 0,
                false => random.within(0, jitter),
            };
            releases.push((slot + late, slot, number));
        }
    }
    releases.sort_unstable();
    let mut core = Core::new(set);
    let mut now = 0;
    for (at, slot, task) in releases {
        if at > now {
            core.run(now, at);
            now = at;
        }
        core.release(task, slot);
    }
    core.run(now, u64::MAX);
    core.worst
}

/// Period and jitter.
fn times(task: &Task) -> (u64, u64) {
    match &task.demand {
        Some(Demand {
            arrivals: Arrivals::Periodic { period, jitter },
            ..
        }) => (super::nanos(*period), super::nanos(*jitter)),
        _ => unreachable!("the sets have periods"),
    }
}

/// The longest responses of some runs, each with its task's bound.
fn responses(set: &Set, seed: u64) -> Vec<(u64, Option<u64>)> {
    let mut random = Random(seed);
    let mut worst = simulate(set, &mut random, true);
    for _ in 0..4 {
        let again = simulate(set, &mut random, false);
        let both = worst.into_iter().zip(again);
        worst = both.map(|(one, other)| one.max(other)).collect();
    }
    let bounds = bounds(&set.threads, &set.tasks);
    let bounds = bounds.into_iter().map(|bound| bound.ok().map(super::nanos));
    worst.into_iter().zip(bounds).collect()
}

/// Whether a response is beyond its bound.
fn are_beyond(responses: &[(u64, Option<u64>)]) -> bool {
    let mut all = responses.iter();
    all.any(|(worst, bound)| bound.is_some_and(|bound| *worst > bound))
}

/// The set without what it does not need to have a response beyond a bound.
fn smallest(mut set: Set, seed: u64) -> Set {
    let mut task = 0;
    while task < set.tasks.len() {
        let mut less = set.clone();
        less.tasks.remove(task);
        less.polls.remove(task);
        match are_beyond(&responses(&less, seed)) {
            true => set = less,
            false => task += 1,
        }
    }
    set
}

/// `LUNA_SEED` sets the seed, `LUNA_LONG=1` takes 10 000 sets.
#[test]
fn no_simulated_response_exceeds_its_bound() {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    let seed: u64 = number("LUNA_SEED").unwrap_or_else(rand_seed);
    let is_long = std::env::var_os("LUNA_LONG").is_some_and(|text| text == "1");
    let sets = if is_long { 10_000 } else { 300 };
    println!("LUNA_SEED={seed}");
    let mut ratios = Vec::new();
    let mut unbounded = 0;
    for number in 0..sets {
        let seed = seed.wrapping_add(number);
        let set = set(&mut Random(seed));
        let found = responses(&set, seed);
        if are_beyond(&found) {
            let set = smallest(set, seed);
            let found = responses(&set, seed);
            panic!("LUNA_SEED={seed}: worst responses and bounds are {found:?} of\n{set:#?}");
        }
        for (worst, bound) in found {
            match bound {
                Some(bound) => ratios.push(bound as f64 / worst as f64),
                None => unbounded += 1,
            }
        }
    }
    ratios.sort_by(f64::total_cmp);
    let median = ratios[ratios.len() / 2];
    println!(
        "{} bounds, {unbounded} tasks without; bound / worst simulated: median {median:.2}, at \
         most {:.2}",
        ratios.len(),
        ratios[ratios.len() - 1]
    );
    assert_eq!(unbounded, 0, "all sets ask for less than the core has");
    assert!(median <= 1.5, "{median}");
}

fn rand_seed() -> u64 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    now.map_or(0, |now| now.as_nanos() as u64)
}
