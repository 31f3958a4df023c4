//! Callbacks: when they are called, how they end, and what they cost others.

use super::*;
use crate::common::SpawnOk;

#[test]
fn a_callback_is_called_once_a_slot_and_never_before() {
    own_process!();
    let mut system = managed("callback");
    let seen = Arc::new(Mutex::new(Vec::with_capacity(1_000)));
    let (calls, noted) = (Arc::new(AtomicU64::new(0)), seen.clone());
    let counted = calls.clone();
    let phase = PERIOD / 4;
    let manager = system.timer_manager().unwrap();
    let one = manager
        .callback("one", move |firing| {
            assert!(luna::now() >= firing.deadline);
            noted.lock().unwrap().push(firing);
            counted.fetch_add(1, Ordering::Release);
        })
        .unwrap();
    one.every(PERIOD, phase).unwrap();
    runs_until(&mut system, move || calls.load(Ordering::Acquire) >= 20);
    let report = system.run().unwrap();
    let seen = seen.lock().unwrap();
    assert!(seen[0].number >= 1);
    for pair in seen.windows(2) {
        assert_eq!(pair[1].number, pair[0].number + 1 + pair[1].missed);
        let slots = (pair[1].number - pair[0].number) as u32;
        assert_eq!(pair[1].deadline - pair[0].deadline, PERIOD * slots);
        assert!(pair[1].lateness < PERIOD);
    }
    let counted = callback(&report, "one");
    assert_eq!(counted.calls, seen.len() as u64);
    assert_eq!(
        counted.missed,
        seen.iter().map(|one| one.missed).sum::<u64>()
    );
    assert!(
        !one.is_set() && !one.cancel(),
        "it has ended with its system"
    );
    one.every(PERIOD, phase).unwrap();
    assert!(!one.is_set());
}

#[test]
fn one_shots_fire_once_each_and_one_can_set_itself_anew() {
    own_process!();
    let mut system = managed("once");
    let manager = system.timer_manager().unwrap();
    let order = Arc::new(Mutex::new(Vec::with_capacity(16)));
    let once = |name: &'static str| {
        let order = order.clone();
        let called = move |_| order.lock().unwrap().push(name);
        manager.callback(name, called).unwrap()
    };
    let [first, second, third, never] = ["first", "second", "third", "never"].map(once);
    let now = luna::now();
    third.at(now + PERIOD * 3);
    first.at(now); // has passed when the system starts
    second.at(now + PERIOD * 2);
    never.at(now + PERIOD * 2);
    assert!(never.cancel());
    let again: Arc<Mutex<Option<luna::time::TimerCallback>>> = Arc::default();
    let (own, left) = (again.clone(), Arc::new(AtomicU64::new(3)));
    let done = left.clone();
    let chain = manager
        .callback("chain", move |_| {
            if left.fetch_sub(1, Ordering::Release) > 1 {
                own.lock().unwrap().as_ref().unwrap().after(Duration::ZERO);
            }
        })
        .unwrap();
    chain.at(now + PERIOD * 4);
    *again.lock().unwrap() = Some(chain);
    runs_until(&mut system, move || done.load(Ordering::Acquire) == 0);
    let report = system.run().unwrap();
    assert_eq!(*order.lock().unwrap(), ["first", "second", "third"]);
    assert_eq!(callback(&report, "never").calls, 0);
    assert_eq!(callback(&report, "chain").calls, 3);
    assert!(!first.is_set());
}

/// Callbacks that set themselves, or each other, to an instant long ago in every call.
#[test]
fn one_that_is_always_late_starves_nobody() {
    own_process!();
    const PAST: Instant = Instant::from_nanos(1);
    // For each: the callbacks that it sets.
    for partners in [&[0][..], &[1, 0]] {
        let mut system = managed("late");
        let manager = system.timer_manager().unwrap();
        let handles: Arc<Mutex<Vec<luna::time::TimerCallback>>> = Arc::default();
        for (number, &partner) in partners.iter().enumerate() {
            let sets = handles.clone();
            let late = manager
                .callback(&format!("late {number}"), move |firing| {
                    assert_eq!(firing.deadline, PAST);
                    sets.lock().unwrap()[partner].at(PAST);
                })
                .unwrap();
            handles.lock().unwrap().push(late);
        }
        handles.lock().unwrap()[0].at(PAST);
        let (calls, counted) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
        let (slots, once) = (calls.clone(), counted.clone());
        let patient = manager
            .callback("patient", move |_| {
                calls.fetch_add(1, Ordering::Relaxed);
            })
            .unwrap();
        patient.every(PERIOD, Duration::ZERO).unwrap();
        let single = manager
            .callback("single", move |_| {
                counted.fetch_add(1, Ordering::Relaxed);
            })
            .unwrap();
        single.at(Instant::now() + PERIOD * 2);
        runs_until(&mut system, move || {
            slots.load(Ordering::Relaxed) >= 5 && once.load(Ordering::Relaxed) == 1
        });
        let began = Instant::now();
        let report = system.run().unwrap();
        // Each rests for at least 100 µs between two calls.
        let most = (Instant::now() - began).as_micros() / 100 + 1;
        for number in 0..partners.len() {
            let late = callback(&report, &format!("late {number}"));
            assert!(late.calls > 1 && u128::from(late.calls) <= most, "{late:?}");
        }
    }
}

#[test]
fn removal_while_it_is_called() {
    own_process!();
    for drops in [false, true] {
        let mut system = managed("removal");
        let manager = system.timer_manager().unwrap();
        let (called, removed) = (
            Arc::new(AtomicBool::new(false)),
            Arc::new(AtomicBool::new(false)),
        );
        let (is_called, is_removed) = (called.clone(), removed.clone());
        let gone = Arc::new(());
        let kept = gone.clone();
        let one = manager
            .callback("one", move |_| {
                let _kept = &kept;
                is_called.store(true, Ordering::Release);
                // In the middle of the call it is taken back.
                while !is_removed.load(Ordering::Acquire) {
                    std::hint::spin_loop();
                }
            })
            .unwrap();
        let process = system.thread("remover").process("remover");
        process.spawn_ok(async move {
            one.every(PERIOD, Duration::ZERO)?;
            while !called.load(Ordering::Acquire) {
                luna::after(Duration::from_micros(100)).await;
            }
            let kept = if drops {
                luna::realtime::off_path(|| drop(one));
                None
            } else {
                assert!(one.cancel());
                assert!(!one.cancel());
                Some(one)
            };
            removed.store(true, Ordering::Release);
            // Other ticks come, and are none of its own.
            let mut tick = luna::periodic("beside", PERIOD)?;
            for _ in 0..5 {
                tick.next().await;
            }
            assert!(kept.is_none_or(|one| !one.is_set()));
            Ok(())
        });
        let report = system.run().unwrap();
        assert_eq!(callback(&report, "one").calls, 1);
        assert_eq!(Arc::strong_count(&gone), 1, "its function is dropped");
    }
}

#[test]
fn a_panic_in_a_callback_is_an_emergency() {
    own_process!();
    let mut system = managed("panics");
    let (brought, safe) = (
        Arc::new(AtomicBool::new(false)),
        Arc::new(AtomicU64::new(0)),
    );
    let (calls, after) = (safe.clone(), brought.clone());
    system.on_emergency("stop", move || after.store(true, Ordering::SeqCst));
    let manager = system.timer_manager().unwrap();
    let other = manager.callback("other", |_| ()).unwrap();
    let bad = manager
        .callback("bad", move |_| {
            calls.fetch_add(1, Ordering::SeqCst);
            panic!("on purpose");
        })
        .unwrap();
    bad.every(PERIOD, Duration::ZERO).unwrap();
    other.every(PERIOD, Duration::ZERO).unwrap();
    let main = system.executor("main").build().unwrap();
    main.process("patient")
        .spawn_ok(async { std::future::pending().await });
    let error = system.run().unwrap_err();
    let expected = Error::Callback {
        name: "bad".to_owned(),
        message: "on purpose".to_owned(),
    };
    assert_eq!(error, expected);
    assert!(
        error
            .to_string()
            .contains("timer callback `bad` panicked: on purpose")
    );
    assert!(brought.load(Ordering::SeqCst));
    let report = system.report().unwrap();
    assert_eq!(report.end, End::Panic);
    assert!(callback(&report, "bad").panicked);
    assert_eq!(
        (safe.load(Ordering::SeqCst), callback(&report, "bad").calls),
        (1, 1)
    );
}

#[test]
fn a_callback_that_takes_too_long_is_counted() {
    own_process!();
    let mut system = managed("long");
    let manager = system.timer_manager().unwrap();
    let slow = manager
        .callback("slow", |_| {
            burn_until(luna::now() + Duration::from_micros(300))
        })
        .unwrap();
    slow.after(Duration::ZERO);
    let own = Arc::new(slow);
    let seen = own.clone();
    runs_until(&mut system, move || !seen.is_set());
    let report = system.run().unwrap();
    let slow = callback(&report, "slow");
    assert_eq!((slow.calls, slow.too_long), (1, 1));
    assert!(slow.longest >= Duration::from_micros(300));
    assert!(
        report.to_string().contains("callback `slow`: 1 calls"),
        "{report}"
    );
}
