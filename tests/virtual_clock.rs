//! Systems on a virtual clock: what holds on the real one holds there, time jumps, and nothing depends on the machine.

mod common;

use common::watchdog;
use luna::prelude::*;
use luna::{ClockKind, End, Error, Instant, OnOverrun, Policy, SetupError, Watchdog};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);
const HOUR: Duration = Duration::from_secs(3600);

/// A system whose clock is virtual, and one executor of it.
fn simulated() -> (System, luna::Executor) {
    let mut system = System::new("simulated");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    (system, main)
}

/// What processes note down, in the order in which they do.
#[derive(Clone, Default)]
struct Notes(Arc<Mutex<Vec<(u64, String)>>>);

impl Notes {
    /// The microseconds since the clock's beginning, with `what`.
    fn note(&self, what: impl Into<String>) {
        let micros = (luna::now().as_nanos() - 1_000_000_000) / 1000;
        self.0.lock().unwrap().push((micros, what.into()));
    }

    fn take(&self) -> Vec<(u64, String)> {
        std::mem::take(&mut self.0.lock().unwrap())
    }

    fn names(&self) -> Vec<String> {
        self.take().into_iter().map(|(_, what)| what).collect()
    }
}

#[test]
fn an_hour_takes_moments_and_is_exact() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let body = async {
        let start = luna::now();
        let mut tick = luna::periodic("hourly", MS * 10)?;
        for number in 1..=360_000 {
            let cycle = tick.next().await;
            assert_eq!((cycle.number, cycle.missed), (number, 0));
            assert_eq!(
                (cycle.lateness, cycle.deadline),
                (Duration::ZERO, luna::now())
            );
        }
        assert_eq!(luna::now() - start, HOUR);
        Ok(())
    };
    main.process("loop").spawn(body).unwrap();
    let report = system.run().unwrap();
    assert_eq!(
        (report.end, report.clock),
        (End::Completed, ClockKind::Virtual)
    );
    assert_eq!(report.elapsed, HOUR);
    let one = &report.loops["hourly"];
    assert_eq!((one.cycles, one.missed, one.late), (360_000, 0, 0));
    assert_eq!(one.wake_latency.max(), Duration::ZERO);
    let text = report.to_string();
    assert!(text.contains("on a virtual clock, which took"), "{text}");
    assert!(
        text.contains("on the thread of the virtual clock"),
        "{text}"
    );
}

/// A small network with times, on whichever clock: what it gives must be the same.
fn network(is_virtual: bool) -> Vec<u64> {
    let mut system = System::new("network");
    if is_virtual {
        system.virtual_clock();
    }
    let one = system.executor("one").build().unwrap();
    let two = system.executor("two").build().unwrap();
    let (samples, sampled) = luna::channel::<u64>();
    let (squares, squared) = luna::buffered::<u64>(luna::Buffer::fifo(3));
    let results = Arc::new(Mutex::new(Vec::new()));
    let sample = async move {
        let mut tick = luna::periodic("sample", MS * 5)?;
        for _ in 0..10 {
            let cycle = tick.next().await;
            samples.send(cycle.number + cycle.missed).await?;
        }
        Ok(())
    };
    one.process("sample").spawn(sample).unwrap();
    let square = async move {
        while let Ok(value) = sampled.recv().await {
            squares.send(value * value).await?;
        }
        Ok(())
    };
    two.process("square").spawn(square).unwrap();
    let kept = results.clone();
    let collect = async move {
        let mut timeouts = 0;
        loop {
            luna::alt! {
                value = squared.recv() => match value {
                    Ok(value) => kept.lock().unwrap().push(value),
                    Err(_) => break,
                },
                _ = luna::after(HOUR) => timeouts += 1,
            }
        }
        assert_eq!(timeouts, 0);
        Ok(())
    };
    system
        .thread("three")
        .process("collect")
        .spawn(collect)
        .unwrap();
    system.run().unwrap();
    std::mem::take(&mut results.lock().unwrap())
}

#[test]
fn a_network_gives_what_it_gives_on_the_real_clock() {
    let _alive = watchdog();
    let squares: Vec<u64> = (1..=10).map(|value| value * value).collect();
    assert_eq!(network(true), squares);
    // On a slow machine slots are missed; the sums of the two are the slots that have passed.
    let real = network(false);
    assert_eq!(real.len(), squares.len());
}

#[test]
fn loops_of_one_instant_run_by_priority_then_as_they_came() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let notes = Notes::default();
    for (name, priority, period) in [
        ("low", 3, 6),
        ("first", 9, 3),
        ("second", 9, 2),
        ("high", 30, 6),
    ] {
        let notes = notes.clone();
        let body = async move {
            let mut tick = luna::periodic(name, MS * period)?.phase(Duration::ZERO)?;
            for _ in 0..12 / period {
                tick.next().await;
                notes.note(name);
            }
            Ok(())
        };
        main.process(name).priority(priority).spawn(body).unwrap();
    }
    system.run().unwrap();
    let at_6 = ["high", "first", "second", "low"];
    let seen: Vec<String> = notes
        .take()
        .into_iter()
        .filter(|(micros, _)| *micros == 6000)
        .map(|(_, name)| name)
        .collect();
    assert_eq!(seen, at_6);
}

#[test]
fn executors_take_their_turns_by_policy_then_as_described() {
    let _alive = watchdog();
    let mut system = System::new("many");
    system.virtual_clock();
    let notes = Notes::default();
    let policies = [("b", 0), ("c", 0), ("low", 5), ("a", 90)];
    let executors = policies.map(|(name, priority)| {
        let policy = if priority == 0 {
            Policy::Other
        } else {
            Policy::fifo(priority)
        };
        (name, system.executor(name).policy(policy).build().unwrap())
    });
    for (name, executor) in &executors {
        let (name, notes) = (*name, notes.clone());
        let body = async move {
            for _ in 0..3 {
                luna::after(MS).await;
                notes.note(name);
            }
            Ok(())
        };
        executor.process(name).spawn(body).unwrap();
    }
    let own = notes.clone();
    let on_thread = async move {
        luna::after(MS).await;
        own.note("thread");
        Ok(())
    };
    let thread = system.thread("thread").policy(Policy::fifo(20));
    thread.process("thread").spawn(on_thread).unwrap();
    let report = system.run().unwrap();
    let later = ["a", "low", "b", "c"];
    let expected = [&["a", "thread", "low", "b", "c"][..], &later, &later].concat();
    assert_eq!(notes.names(), expected);
    assert_eq!(report.threads.len(), 5);
    assert_eq!(report.all_shortfalls().count(), 0);
}

#[test]
fn a_higher_executor_runs_as_soon_as_it_is_woken() {
    let _alive = watchdog();
    let mut system = System::new("preempting");
    system.virtual_clock();
    let low = system.executor("low").build().unwrap();
    let high = system
        .executor("high")
        .policy(Policy::fifo(50))
        .build()
        .unwrap();
    let notes = Notes::default();
    let (sender, receiver) = luna::buffered::<u32>(luna::Buffer::fifo(10));
    let own = notes.clone();
    let wakes = async move {
        for value in 0..3 {
            sender.send(value).await?;
            own.note(format!("sent {value}"));
            luna::yield_now().await;
        }
        Ok(())
    };
    low.process("low").spawn(wakes).unwrap();
    let own = notes.clone();
    let woken = async move {
        while let Ok(value) = receiver.recv().await {
            own.note(format!("received {value}"));
        }
        Ok(())
    };
    high.process("high").spawn(woken).unwrap();
    system.run().unwrap();
    let order = [
        "sent 0",
        "received 0",
        "sent 1",
        "received 1",
        "sent 2",
        "received 2",
    ];
    assert_eq!(notes.names(), order);
}

#[test]
fn one_that_yields_for_ever_keeps_no_other_executor_from_running() {
    let _alive = watchdog();
    let mut system = System::new("restless");
    system.virtual_clock();
    let high = system
        .executor("high")
        .policy(Policy::fifo(50))
        .build()
        .unwrap();
    let low = system.executor("low").build().unwrap();
    let done = Arc::new(AtomicBool::new(false));
    let seen = done.clone();
    let restless = async move {
        while !seen.load(Relaxed) {
            luna::yield_now().await;
        }
        Ok(())
    };
    high.process("restless").spawn(restless).unwrap();
    let patient = async move {
        for _ in 0..1000 {
            luna::yield_now().await;
        }
        done.store(true, Relaxed);
        Ok(())
    };
    low.process("patient").spawn(patient).unwrap();
    assert_eq!(system.run().unwrap().elapsed, Duration::ZERO);
}

#[test]
fn a_livelock_ends_with_an_error_and_all_are_dropped() {
    let _alive = watchdog();
    let (mut system, main) = simulated();
    system.most_turns_at_an_instant(5000);
    let kept = Arc::new(());
    let held = kept.clone();
    let waits = async move {
        let _held = held;
        luna::after(HOUR).await;
        Ok(())
    };
    main.process("waits").spawn(waits).unwrap();
    let spins = async {
        luna::after(MS).await;
        loop {
            luna::yield_now().await;
        }
    };
    main.process("spins").spawn(spins).unwrap();
    let error = system.run().unwrap_err();
    let at = Instant::from_nanos(1_001_000_000);
    assert_eq!(
        error,
        Error::Livelock {
            process: "spins".into(),
            turns: 5000,
            at
        }
    );
    assert_eq!(system.report().unwrap().end, End::Livelock);
    assert_eq!(Arc::strong_count(&kept), 1);
}

#[test]
fn periods_that_do_not_divide_and_periods_out_of_range() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let body = async {
        let zero = luna::periodic("zero", Duration::ZERO);
        assert!(matches!(
            zero,
            Err(Error::Setup(SetupError::ZeroPeriod { .. }))
        ));
        let huge = luna::periodic("huge", Duration::MAX);
        assert!(matches!(
            huge,
            Err(Error::Setup(SetupError::PeriodTooLong { .. }))
        ));
        let start = luna::now();
        let mut third = luna::periodic("third", Duration::from_nanos(333_333_333))?;
        for _ in 0..3 {
            third.next().await;
        }
        assert_eq!((luna::now() - start).as_nanos(), 999_999_999);
        let century = Duration::from_secs(100 * 365 * 24 * 3600);
        let mut rare = luna::periodic("rare", century)?;
        let before = luna::now();
        rare.next().await;
        assert_eq!(luna::now() - before, century);
        let mut shortest = luna::periodic("shortest", Duration::from_nanos(1))?;
        for number in 1..=1000 {
            assert_eq!(shortest.next().await.number, number);
        }
        Ok(())
    };
    main.process("periods").spawn(body).unwrap();
    system.run().unwrap();
}

#[test]
fn a_cycle_that_waits_too_long_is_overrun_as_ever() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let body = async {
        let mut tick = luna::periodic("slow", MS * 10)?;
        tick.next().await;
        luna::after(MS * 25).await;
        let cycle = tick.next().await;
        assert_eq!((cycle.number, cycle.missed, cycle.lateness), (3, 1, MS * 5));
        Ok(())
    };
    main.process("slow").spawn(body).unwrap();
    let report = system.run().unwrap();
    assert_eq!(
        (report.loops["slow"].missed, report.loops["slow"].overruns),
        (1, 1)
    );
}

#[test]
fn a_timer_that_goes_while_another_of_its_instant_fires() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let notes = Notes::default();
    let (stop, stopped) = luna::channel::<()>();
    let own = notes.clone();
    // Both are due at once; the one that is served first takes the other's timer away, which has been readied already or not.
    let firing = async move {
        luna::after(MS).await;
        own.note("fired");
        stop.send(()).await?;
        Ok(())
    };
    main.process("firing").priority(20).spawn(firing).unwrap();
    let own = notes.clone();
    let dropped = async move {
        luna::pri_alt! {
            _ = stopped.recv() => own.note("stopped"),
            _ = luna::after(MS) => own.note("late"),
        }
        let mut timer = luna::Timer::new();
        timer.set(MS);
        timer.cancel();
        luna::alt! {
            _ = timer.expired() => own.note("never"),
            _ = luna::after(MS * 2) => own.note("after"),
        }
        Ok(())
    };
    main.process("dropped").priority(10).spawn(dropped).unwrap();
    let report = system.run();
    let seen = notes.take();
    // The delay has come before the sender could: it is what the alternative takes only if nobody has sent, and the sender is the more urgent one.
    assert_eq!(seen[0], (1000, "fired".into()));
    assert_eq!(seen[1].0, 1000);
    assert_eq!(seen[2], (3000, "after".into()));
    assert_eq!(seen[1].1 == "stopped", report.is_ok());
}

#[test]
fn timeouts_and_watchdogs_and_ticks_go_by_it() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let dog = Watchdog::new(MS * 50);
    let fed = dog.clone();
    let feeds = async move {
        let mut ticks = luna::ticks(MS * 20)?;
        for number in 1..=5 {
            assert_eq!(ticks.tick().await.number, number);
            fed.feed();
        }
        Ok(())
    };
    main.process("feeds").spawn(feeds).unwrap();
    let guards = async move {
        let start = luna::now();
        dog.expired().await;
        // It goes hungry when more than its timeout has passed.
        let hungry = MS * 150 + Duration::from_nanos(1);
        assert_eq!(luna::now() - start, hungry);
        let (_sender, receiver) = luna::channel::<()>();
        assert!(receiver.recv_timeout(HOUR).await.is_err());
        assert_eq!(luna::now() - start, hungry + HOUR);
        Ok(())
    };
    main.process("guards").spawn(guards).unwrap();
    system.run().unwrap();
}

#[test]
fn ticks_that_are_made_outside_begin_when_they_are_waited_for() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let mut ticks = luna::ticks(MS).unwrap();
    let start = Instant::from_nanos(5_000_000_000);
    let mut given = luna::ticks(MS).unwrap().starting_at(start);
    let body = async move {
        luna::after(MS * 10).await;
        let now = luna::now();
        for number in 1..=3 {
            let tick = ticks.tick().await;
            assert_eq!((tick.number, tick.slot), (number, now + MS * number as u32));
        }
        assert_eq!(given.tick().await.slot, start);
        Ok(())
    };
    main.process("ticks").spawn(body).unwrap();
    system.run().unwrap();
}

#[test]
fn a_guard_spin_and_other_wishes_of_real_time_ask_for_nothing() {
    let _alive = watchdog();
    let mut system = System::new("wishes");
    system.virtual_clock().strict().lock_memory();
    let main = system
        .executor("main")
        .core(4095)
        .policy(Policy::fifo(80))
        .spin_before_sleep(MS / 10)
        .build()
        .unwrap();
    let body = async {
        let mut tick = luna::periodic("servo", MS)?.guard_spin(MS / 20)?;
        for number in 1..=1000 {
            let cycle = tick.next().await;
            assert_eq!((cycle.number, cycle.lateness), (number, Duration::ZERO));
        }
        Ok(())
    };
    main.process("servo").spawn(body).unwrap();
    let report = system.run().unwrap();
    assert_eq!(report.all_shortfalls().count(), 0);
    assert_eq!(report.processes[0].polls, 1001, "no turn was spun away");
}

#[test]
fn computing_takes_no_time_so_a_budget_holds() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let body = async {
        // However long that takes on the machine.
        let sum: u64 = std::hint::black_box((0..1_000_000_u64).sum());
        assert!(sum > 0);
        Ok(())
    };
    let process = main.process("busy").poll_budget(Duration::from_nanos(1));
    process
        .on_overrun(OnOverrun::Emergency)
        .spawn(body)
        .unwrap();
    let report = system.run().unwrap();
    assert_eq!(report.processes[0].budgets[0].overruns, 0);
    let (system, main) = simulated();
    let waits = async {
        let mut tick = luna::periodic("waits", MS * 10)?;
        tick.next().await;
        luna::after(MS * 2).await;
        tick.next().await;
        Ok(())
    };
    main.process("waits").cycle_budget(MS).spawn(waits).unwrap();
    let report = system.run().unwrap();
    assert_eq!(report.processes[0].budgets[0].overruns, 1, "waiting does");
}

#[test]
fn a_deadlock_is_found_when_nothing_can_run() {
    let _alive = watchdog();
    let mut system = System::new("stuck");
    system.virtual_clock().strict();
    let main = system.executor("main").build().unwrap();
    let other = system.executor("other").build().unwrap();
    let (one, of_one) = luna::channel::<()>();
    let (two, of_two) = luna::channel::<()>();
    let first = async move {
        luna::after(HOUR).await;
        of_two.recv().await?;
        Ok(one.send(()).await?)
    };
    main.process("first").spawn(first).unwrap();
    let second = async move {
        of_one.recv().await?;
        Ok(two.send(()).await?)
    };
    other.process("second").spawn(second).unwrap();
    assert!(matches!(system.run(), Err(Error::Deadlock(_))));
    assert_eq!(system.report().unwrap().elapsed, HOUR);
}

#[test]
fn results_of_blocking_calls_come_in_the_order_of_the_calls_and_time_waits() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let notes = Notes::default();
    let (release, released) = std::sync::mpsc::channel::<()>();
    let mut calls: Vec<Box<dyn FnOnce() -> u64 + Send>> = Vec::new();
    // The first is done when the second is: nobody could tell which comes first by itself.
    calls.push(Box::new(move || {
        released.recv().unwrap();
        luna::now().as_nanos()
    }));
    calls.push(Box::new(move || {
        release.send(()).unwrap();
        luna::now().as_nanos()
    }));
    for (number, call) in calls.into_iter().enumerate() {
        let notes = notes.clone();
        let body = async move {
            luna::after(MS).await;
            let seen = luna::blocking(call).await;
            assert_eq!(
                seen,
                luna::now().as_nanos(),
                "the buddy sees the system's clock"
            );
            notes.note(format!("call {number}"));
            Ok(())
        };
        main.process(&format!("caller {number}"))
            .spawn(body)
            .unwrap();
    }
    let own = notes.clone();
    let waits = async move {
        luna::after(MS).await;
        own.note("waiter");
        luna::after(Duration::from_nanos(1)).await;
        own.note("waiter again");
        Ok(())
    };
    main.process("waiter").spawn(waits).unwrap();
    system.run().unwrap();
    let names = ["waiter", "call 0", "call 1", "waiter again"];
    assert_eq!(notes.names(), names);
}

#[test]
fn a_panic_is_an_emergency_and_time_stands_for_its_functions() {
    let _alive = watchdog();
    let (mut system, main) = simulated();
    let seen = Arc::new(AtomicU64::new(0));
    let kept = seen.clone();
    system.on_emergency("safe", move || kept.store(luna::now().as_nanos(), Relaxed));
    let panics = async {
        luna::after(MS).await;
        panic!("on purpose");
    };
    main.process("panics").spawn(panics).unwrap();
    let cycles = Arc::new(AtomicU64::new(0));
    let counted = cycles.clone();
    let goes_on = async move {
        let mut tick = luna::periodic("goes on", MS)?;
        loop {
            tick.next().await;
            counted.fetch_add(1, Relaxed);
        }
    };
    main.process("goes on").spawn(goes_on).unwrap();
    let error = system.run().unwrap_err();
    assert!(error.to_string().contains("on purpose"), "{error}");
    let report = system.report().unwrap();
    assert_eq!((report.end, report.elapsed), (End::Panic, MS));
    assert_eq!(seen.load(Relaxed), 1_001_000_000);
    // It was due at the instant of the panic, and never after.
    assert_eq!(cycles.load(Relaxed), 1);
}

#[test]
fn poison_and_cancel_end_processes_at_their_instants() {
    let _alive = watchdog();
    let mut system = System::new("ends");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    let notes = Notes::default();
    let (sender, receiver) = luna::channel::<u32>();
    let own = notes.clone();
    let reads = async move {
        while receiver.recv().await.is_ok() {}
        own.note("poisoned");
        Ok(())
    };
    let reads = system
        .thread("reads")
        .process("reads")
        .spawn(reads)
        .unwrap();
    let poisons = async move {
        luna::after(MS).await;
        sender.send(1).await?;
        sender.poison();
        Ok(())
    };
    main.process("poisons").spawn(poisons).unwrap();
    let sleeps = main.process("sleeps").spawn(luna_sleep(HOUR)).unwrap();
    let (own, handles) = (notes.clone(), main.clone());
    let cancels = async move {
        let sleeper = handles.process_handle(sleeps).unwrap();
        let reader = handles.process_handle(reads).unwrap();
        reader.join().await;
        luna::after(MS).await;
        sleeper.cancel();
        assert_eq!(sleeper.join().await, luna::Exit::Cancelled);
        own.note("cancelled");
        Ok(())
    };
    main.process("cancels").spawn(cancels).unwrap();
    // Who is cancelled by another has not done what it was to do.
    let error = system.run().unwrap_err().to_string();
    assert_eq!(
        error,
        "process `sleeps`: cancelled before its body had ended"
    );
    let report = system.report().unwrap();
    assert_eq!(
        notes.take(),
        [(1000, "poisoned".into()), (2000, "cancelled".into())]
    );
    assert_eq!(report.elapsed, MS * 2);
}

async fn luna_sleep(time: Duration) -> luna::Result<()> {
    luna::after(time).await;
    Ok(())
}

/// Notes its phases.
struct Phases(
    Notes,
    #[expect(dead_code, reason = "what counts is when it is dropped")] luna::Sender<()>,
);

impl Process for Phases {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.0.note("pre");
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        luna::after(MS * 3).await;
        self.0.note("run");
        Ok(())
    }

    fn post_run(&mut self) {
        self.0.note("post");
    }
}

#[test]
fn phases_see_its_time_and_a_burial_comes_before_time_goes_on() {
    let _alive = watchdog();
    for _ in 0..20 {
        let (system, main) = simulated();
        let notes = Notes::default();
        let (end, ended) = luna::channel::<()>();
        main.process("phases")
            .spawn(Phases(notes.clone(), end))
            .unwrap();
        let own = notes.clone();
        let other = async move {
            // The channel's end goes with the process, which is dropped after its post_run.
            assert!(ended.recv().await.is_err());
            own.note("closed");
            Ok(())
        };
        main.process("other").spawn(other).unwrap();
        main.process("time").spawn(luna_sleep(HOUR)).unwrap();
        system.run().unwrap();
        let expected = [(0, "pre"), (3000, "run"), (3000, "post"), (3000, "closed")];
        assert_eq!(
            notes.take(),
            expected.map(|(at, what)| (at, what.to_owned()))
        );
    }
}

#[test]
fn processes_are_spawned_while_it_runs_on_every_kind_of_place() {
    let _alive = watchdog();
    let mut system = System::new("growing");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    let other = system.executor("other").build().unwrap();
    let late = system.thread("late").process("on a thread");
    let notes = Notes::default();
    let (own, own_executor) = (notes.clone(), main.clone());
    let spawns = async move {
        luna::after(MS).await;
        for (name, executor) in [("here", &own_executor), ("there", &other)] {
            let own = own.clone();
            let child = executor.process(name).spawn(async move {
                own.note(name);
                luna::after(MS).await;
                Ok(())
            })?;
            let handle = executor.process_handle(child).unwrap();
            handle.join().await;
            own_note(&handle);
        }
        let noted = own.clone();
        late.spawn(async move {
            luna::after(MS).await;
            noted.note("thread");
            Ok(())
        })?;
        own.note("spawned");
        Ok(())
    };
    main.process("spawns").spawn(spawns).unwrap();
    system.run().unwrap();
    let expected = [
        (1000, "here"),
        (2000, "there"),
        (3000, "spawned"),
        (4000, "thread"),
    ];
    assert_eq!(
        notes.take(),
        expected.map(|(at, what)| (at, what.to_owned()))
    );
}

fn own_note(handle: &luna::ProcessHandle) {
    assert_eq!(handle.exit(), Some(luna::Exit::Completed));
}

#[test]
fn a_real_system_and_virtual_ones_run_at_once() {
    let _alive = watchdog();
    let run_virtual = || {
        let (system, main) = simulated();
        main.process("patient").spawn(luna_sleep(HOUR)).unwrap();
        system.run().unwrap()
    };
    let threads = [(); 3].map(|()| std::thread::spawn(run_virtual));
    let mut real = System::new("real");
    let main = real.executor("main").build().unwrap();
    // And one within a blocking call of the real one.
    let nested = async move {
        let before = luna::now();
        let report = luna::blocking(run_virtual).await;
        assert_eq!(report.elapsed, HOUR);
        luna::after(MS).await;
        assert!(luna::now() >= before + MS && luna::now() < before + HOUR);
        Ok(())
    };
    main.process("nested").spawn(nested).unwrap();
    let report = real.run().unwrap();
    assert_eq!(report.clock, ClockKind::Real);
    assert!(report.elapsed < HOUR);
    for thread in threads {
        assert_eq!(thread.join().unwrap().elapsed, HOUR);
    }
}

#[test]
fn a_real_system_within_a_blocking_call_of_a_virtual_one_has_its_own_time() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let body = async {
        let before = luna::now();
        let elapsed = luna::blocking(|| {
            let mut real = System::new("real");
            let main = real.executor("main").build().unwrap();
            main.process("sleeps").spawn(luna_sleep(MS * 2)).unwrap();
            luna::run(luna_sleep(MS)).unwrap();
            real.run().unwrap().elapsed
        })
        .await;
        assert!(elapsed >= MS * 2);
        assert_eq!(luna::now(), before);
        Ok(())
    };
    main.process("outer").spawn(body).unwrap();
    system.run().unwrap();
}

#[test]
fn a_thread_outside_sends_when_it_will_and_a_delay_above_does_not_shut_it_out() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let (sender, receiver) = luna::channel::<u32>();
    let (ready, is_ready) = std::sync::mpsc::channel::<()>();
    let before = luna::now();
    let outside = std::thread::spawn(move || {
        // Real time here, as before the system ran.
        let now = luna::now();
        assert!(now >= before && now - before < Duration::from_secs(60));
        is_ready.recv().unwrap();
        sender.blocking_send(7)
    });
    let body = async move {
        // While the call is made time stands, so the delay does not come.
        let call = luna::blocking(move || {
            ready.send(()).unwrap();
            outside.join().unwrap()
        });
        let receives = async {
            luna::pri_alt! {
                _ = luna::after(HOUR) => Err(Error::Timeout),
                value = receiver.recv() => Ok(value?),
            }
        };
        let (sent, received) = luna::par!(async { Ok(call.await) }, receives).await?;
        assert_eq!((sent.is_ok(), received), (true, 7));
        Ok(())
    };
    main.process("inside").spawn(body).unwrap();
    system.run().unwrap();
}

#[test]
fn a_start_that_fails_leaves_nothing() {
    let _alive = watchdog();
    struct Fails;
    impl Process for Fails {
        fn pre_run(&mut self) -> luna::Result<()> {
            Err(Error::other("no"))
        }
        async fn run(&mut self) -> luna::Result<()> {
            Ok(())
        }
    }
    let (mut system, main) = simulated();
    let kept = Arc::new(());
    let held = kept.clone();
    let body = async move {
        let _held = held;
        luna_sleep(HOUR).await
    };
    system.thread("thread").process("held").spawn(body).unwrap();
    main.process("fails").spawn(Fails).unwrap();
    assert_eq!(system.run().unwrap_err().to_string(), "process `fails`: no");
    assert_eq!(Arc::strong_count(&kept), 1);
    let empty = simulated().0;
    assert_eq!(empty.run().unwrap().elapsed, Duration::ZERO);
}

/// Holds an end, which goes when the process is buried.
struct Holder(#[expect(dead_code, reason = "its drop counts")] luna::Sender<u32>);

impl Process for Holder {
    async fn run(&mut self) -> luna::Result<()> {
        luna::after(MS).await;
        Ok(())
    }
}

/// What a process held is dropped by another thread; when others see it does not depend on that thread.
#[test]
fn what_an_ended_process_held_goes_before_anybody_else_runs() {
    let _alive = watchdog();
    let turns_until_closed = || {
        let (system, main) = simulated();
        let (held, end) = luna::channel::<u32>();
        let turns = Arc::new(AtomicU64::new(0));
        let (counted, seen) = (turns.clone(), Arc::new(AtomicU64::new(u64::MAX)));
        let (own, at_close) = (turns, seen.clone());
        main.process("holder").spawn(Holder(held)).unwrap();
        main.process("reader")
            .spawn(async move {
                assert!(end.recv().await.is_err());
                at_close.store(own.load(Relaxed), Relaxed);
                Ok(())
            })
            .unwrap();
        main.process("counter")
            .spawn(async move {
                luna::after(MS).await;
                for _ in 0..20_000 {
                    counted.fetch_add(1, Relaxed);
                    luna::yield_now().await;
                }
                Ok(())
            })
            .unwrap();
        system.run().unwrap();
        seen.load(Relaxed)
    };
    let first = turns_until_closed();
    assert!(first < 10, "{first}");
    for _ in 0..20 {
        assert_eq!(turns_until_closed(), first);
    }
}

/// Tells its end to a process that is not ready for it yet.
struct TellsItsEnd(luna::Sender<u32>);

impl Process for TellsItsEnd {
    async fn run(&mut self) -> luna::Result<()> {
        Ok(())
    }

    fn post_run(&mut self) {
        self.0.blocking_send(1).unwrap();
    }
}

#[test]
fn a_post_run_that_waits_for_time_does_not_keep_time_from_going_on() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let (sender, receiver) = luna::channel();
    main.process("tells").spawn(TellsItsEnd(sender)).unwrap();
    main.process("logger")
        .spawn(async move {
            luna::after(MS).await;
            assert_eq!(receiver.recv().await, Ok(1));
            Ok(())
        })
        .unwrap();
    assert_eq!(system.run().unwrap().end, End::Completed);
}

#[test]
fn callbacks_of_the_timer_manager_are_refused_where_nobody_could_call_them() {
    let _alive = watchdog();
    let (mut system, main) = simulated();
    system.timers(luna::Timers::Manager);
    let timers = system.timer_manager().unwrap();
    let own = timers.clone();
    main.process("late")
        .spawn(async move {
            let late = own.callback("late", |_| ());
            assert!(matches!(
                late,
                Err(Error::Setup(SetupError::CallbackOnVirtualClock { name })) if name == "late"
            ));
            // Loops are as ever.
            let mut tick = luna::periodic("loop", MS)?;
            assert_eq!(tick.next().await.number, 1);
            Ok(())
        })
        .unwrap();
    system.run().unwrap();

    let (mut system, _main) = simulated();
    system.timers(luna::Timers::Manager);
    let timers = system.timer_manager().unwrap();
    let _callback = timers.callback("early", |_| ()).unwrap();
    assert!(matches!(
        system.run(),
        Err(Error::Setup(SetupError::CallbackOnVirtualClock { name })) if name == "early"
    ));
}
