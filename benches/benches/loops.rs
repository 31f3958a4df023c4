//! `loops`: six loops of one period, on one core: the delay from the first to the last begin, the
//! lateness, and the processor time of a tick.
//!
//! Under SCHED_FIFO where permitted: as root, or with CAP_SYS_NICE.

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use luna::time::Timers;
use luna::{Instant, Policy, System};
use luna_benches::{
    cores::one_core,
    harness::{Case, Goal, is_quick, percentile, run},
};

const APART: &str = "six loops, the last behind the first";
const APART_99: &str = "six loops, the last behind the first, 99 of 100 ticks";
const LATE: &str = "six loops, the last behind its slot";
const COST: &str = "six loops, processor time";

const LOOPS: usize = 6;
const PERIOD: Duration = Duration::from_millis(1);
/// Until here threads are still being made, and caches filled.
const WARM_UP: u64 = 20;
/// How urgent the threads are.
const PRIORITY: u8 = 80;

fn ticks() -> u64 {
    if is_quick() { 60 } else { 300 }
}

/// The figures of a run, in the order of their tables.
type Figures = [f64; 4];

const ROWS: [(&str, &str); 4] = [
    (APART, "us"),
    (APART_99, "us"),
    (LATE, "us"),
    (COST, "us/tick"),
];

/// What the loops have noted.
#[derive(Debug, Default)]
struct Notes {
    /// Each slot's number, the slot, and when the loop began.
    cycles: Vec<(u64, u64, u64)>,
    /// The program's processor time at two slots.
    used: Vec<(u64, Duration)>,
}

/// One loop's notes, in room that is there before it begins.
#[derive(Debug)]
struct Log(Notes);

impl Log {
    fn new() -> Self {
        Log(Notes {
            cycles: Vec::with_capacity(ticks() as usize),
            used: Vec::with_capacity(2),
        })
    }

    /// A cycle begins. `last`: it is the loop that begins last.
    fn cycle(&mut self, number: u64, slot: u64, began: u64, last: bool) {
        let cycles = &mut self.0.cycles;
        cycles.push((number, slot, began));
        let count = cycles.len() as u64;
        if last && (count == WARM_UP || count == ticks()) {
            self.0.used.push((number, processor_time()));
        }
    }
}

fn processor_time() -> Duration {
    let mut time = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: the structure is the call's own to fill.
    let read = unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut time) };
    assert_eq!(read, 0, "the clock is every system's");
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

/// What comes of all loops' notes.
fn figures(logs: Vec<Notes>) -> Figures {
    assert_eq!(logs.len(), LOOPS);
    let mut ticks: BTreeMap<u64, Vec<(u64, u64)>> = BTreeMap::new();
    for log in &logs {
        for &(number, slot, began) in log.cycles.iter().skip(WARM_UP as usize) {
            assert!(began >= slot, "a loop began before its slot");
            ticks.entry(number).or_default().push((slot, began));
        }
    }
    let whole = ticks.values().filter(|began| began.len() == LOOPS);
    let (mut apart, mut late) = (Vec::new(), Vec::new());
    for began in whole {
        let slot = began[0].0;
        assert!(
            began.iter().all(|one| one.0 == slot),
            "the loops are in phase"
        );
        let first = began.iter().map(|one| one.1).min().unwrap_or(slot);
        let last = began.iter().map(|one| one.1).max().unwrap_or(slot);
        apart.push(last - first);
        late.push(last - slot);
    }
    assert!(!apart.is_empty(), "no tick had all its loops");
    let used = logs.iter().find(|log| log.used.len() == 2);
    let [(first, from), (last, until)] = used.expect("the last loop reads the clock").used[..]
    else {
        unreachable!("it has two readings");
    };
    [
        percentile(&mut apart, 50),
        percentile(&mut apart, 99),
        percentile(&mut late, 50),
        (until - from).as_secs_f64() * 1e6 / (last - first) as f64,
    ]
}

/// Where the loops are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum On {
    Executor,
    Threads,
}

/// What wakes the loops, and on which core.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum By {
    TheirThreads,
    Manager,
    /// On the loops' core.
    ManagerBeside,
}

fn ours(on: On, by: By) -> Figures {
    let core = one_core().id;
    let mut system = System::new("loops");
    system.lock_memory();
    if by != By::TheirThreads {
        system.timers(Timers::Manager);
    }
    if by == By::ManagerBeside {
        system.timer_core(core);
    }
    let executor = (on == On::Executor).then(|| {
        let executor = system.executor("all").core(core);
        executor
            .policy(Policy::fifo(PRIORITY))
            .build()
            .expect("the core is one of the machine's")
    });
    let logs: Arc<Mutex<Vec<Notes>>> = Arc::default();
    for number in 0..LOOPS {
        let name = format!("loop {number}");
        // Each at a level, or a priority, of its own: so the last is known.
        let rank = (LOOPS - number) as u8;
        let process = match &executor {
            Some(executor) => executor.process(&name).priority(rank),
            None => {
                let policy = Policy::fifo(PRIORITY - LOOPS as u8 + rank);
                let thread = system.thread(&name).core(core).policy(policy);
                thread.process(&name)
            }
        };
        let logs = logs.clone();
        let body = async move {
            let mut log = Log::new();
            let mut tick = luna::periodic(&name, PERIOD)?.phase(Duration::ZERO)?;
            for _ in 0..ticks() {
                let cycle = tick.next().await;
                let began = luna::now().as_nanos();
                let slot = cycle.deadline.as_nanos();
                log.cycle(cycle.number, slot, began, number + 1 == LOOPS);
            }
            let mut logs = logs.lock().unwrap_or_else(PoisonError::into_inner);
            logs.push(log.0);
            Ok(())
        };
        process.spawn(body).expect("the names differ");
    }
    system.run().expect("the loops end");
    let mut logs = logs.lock().unwrap_or_else(PoisonError::into_inner);
    figures(std::mem::take(&mut logs))
}

/// Six threads with a kernel timer each, as without a framework.
#[cfg(target_os = "linux")]
fn plain_threads() -> Figures {
    use luna_benches::cores::on_core;
    let origin = Instant::now().as_nanos() + 5_000_000;
    let logs = on_core(one_core(), || {
        let loops: Vec<_> = (0..LOOPS)
            .map(|number| std::thread::spawn(move || plain_loop(number, origin)))
            .collect();
        let ended = loops.into_iter().map(std::thread::JoinHandle::join);
        ended
            .map(|log| log.expect("its checks hold"))
            .collect::<Vec<_>>()
    });
    figures(logs)
}

#[cfg(target_os = "linux")]
fn plain_loop(number: usize, origin: u64) -> Notes {
    let period = PERIOD.as_nanos() as u64;
    let time = |nanos: u64| libc::timespec {
        tv_sec: (nanos / 1_000_000_000) as i64,
        tv_nsec: (nanos % 1_000_000_000) as i64,
    };
    let timing = libc::itimerspec {
        it_interval: time(period),
        it_value: time(origin + period),
    };
    let scheduling = libc::sched_param {
        sched_priority: i32::from(PRIORITY) - number as i32,
    };
    // SAFETY: all pointers are valid during the calls, and the file belongs to this thread.
    let timer = unsafe {
        // Where it is not permitted, the others do without it too.
        libc::sched_setscheduler(0, libc::SCHED_FIFO, &scheduling);
        let timer = libc::timerfd_create(libc::CLOCK_MONOTONIC, 0);
        assert!(timer >= 0, "a timer is made");
        let armed = libc::timerfd_settime(
            timer,
            libc::TFD_TIMER_ABSTIME,
            &timing,
            std::ptr::null_mut(),
        );
        assert_eq!(armed, 0, "a timer is armed");
        timer
    };
    let mut log = Log::new();
    let mut slot = 0;
    for _ in 0..ticks() {
        let mut expired = 0_u64;
        // SAFETY: the number has the eight bytes that reading a timer writes.
        let read = unsafe { libc::read(timer, (&raw mut expired).cast(), 8) };
        assert_eq!(read, 8, "a timer gives its count");
        slot += expired;
        let began = Instant::now().as_nanos();
        log.cycle(slot, origin + slot * period, began, number + 1 == LOOPS);
    }
    // SAFETY: the descriptor is open, and not used any more.
    unsafe { libc::close(timer) };
    log.0
}

const PLAIN: &str = "six threads, a timerfd each";

fn main() {
    let mut all = Vec::new();
    let mut add = |peer, measure: fn() -> Figures| all.extend(Case::of_one(peer, ROWS, measure));
    add("LUNA, one executor", || {
        ours(On::Executor, By::TheirThreads)
    });
    add("LUNA, one executor, manager", || {
        ours(On::Executor, By::Manager)
    });
    add("LUNA, one executor, manager on its core", || {
        ours(On::Executor, By::ManagerBeside)
    });
    add("LUNA, six threads", || ours(On::Threads, By::TheirThreads));
    add("LUNA, six threads, manager", || {
        ours(On::Threads, By::Manager)
    });
    add("LUNA, six threads, manager on their core", || {
        ours(On::Threads, By::ManagerBeside)
    });
    #[cfg(target_os = "linux")]
    add(PLAIN, plain_threads);
    let goal = |case: Case| match (case.peer, case.name) {
        ("LUNA, one executor", APART) => case.goal(Goal::AtMost(10.0)),
        ("LUNA, one executor", COST) if cfg!(target_os = "linux") => case.goal(Goal::Times {
            factor: 1.0,
            name: COST,
            peer: PLAIN,
            size: None,
            of: "six threads with a timer each",
        }),
        _ => case,
    };
    let mut all: Vec<Case> = all.into_iter().map(goal).collect();
    // A table for each figure.
    all.sort_by_key(|case| ROWS.iter().position(|&(name, _)| name == case.name));
    run("loops", all);
}
