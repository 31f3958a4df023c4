//! Which process ran instead: only what a process did is attributed to it.

#![cfg(not(loom))]

use luna_core::timer_queue::Sleep;
use luna_core::{Executor, Exit, Interference, ProcessSpec, blocking, interference, yield_now};
use luna_platform::alarm::Alarm;
use luna_platform::clock::Instant;
use luna_platform::thread::Attributes;
use std::sync::mpsc;
use std::time::Duration;

const LONG: Duration = Duration::from_millis(100);
/// At least as long as an alarm rings before its deadline.
const LEAD: Duration = Duration::from_micros(100);

fn burn(time: Duration) {
    let end = Instant::now() + time;
    while Instant::now() < end {}
}

fn between(from: Instant, until: Instant) -> Option<Interference> {
    interference(from, until, |_| true)
}

#[test]
fn a_turn_is_laid_to_the_one_that_had_it() {
    // Again if a busy machine gave the hog its turn too late to be in the way.
    let is_tried = (0..20).any(|_| {
        let executor = Executor::start(Attributes::new("main")).unwrap();
        let hog = ProcessSpec::new("hog");
        let id = hog.id();
        let (notify, notified) = mpsc::channel::<Instant>();
        let (begin, begun) = mpsc::channel();
        let (answer, answered) = mpsc::channel();
        let asks = executor.spawn(ProcessSpec::new("asks").level(20), move || async move {
            let slot = Instant::now() + Duration::from_millis(10);
            notify.send(slot).unwrap();
            Sleep::until(slot).await;
            let now = Instant::now();
            let was_in_the_way = begun.try_recv().is_ok_and(|began| began < slot);
            if was_in_the_way {
                let turn = between(slot, now).unwrap();
                assert_eq!(turn.process, id);
                assert!(turn.held >= LONG && turn.held <= now - slot);
            }
            answer.send(was_in_the_way).unwrap();
        });
        executor.spawn(hog, move || async move {
            let _ = begin.send(Instant::now());
            let until = notified.recv().unwrap() + LONG;
            while Instant::now() < until {}
        });
        executor.release();
        assert_eq!(asks.wait(), Exit::Completed);
        answered.recv().unwrap()
    });
    assert!(is_tried);
}

/// The executor does not read the clock before each poll then: what an alarm interrupts is known
/// from the alarm on.
#[test]
fn a_turn_of_a_busy_executor_counts_from_the_deadline_on() {
    let has_alarm = Alarm::new(|| ()).is_some();
    // Again if a busy machine gave the hog its turn too late to be in the way.
    let is_tried = (0..20).any(|_| {
        let executor = Executor::start(Attributes::new("main")).unwrap();
        let hog = ProcessSpec::new("hog");
        let id = hog.id();
        let (notify, notified) = mpsc::channel::<Instant>();
        let (begin, begun) = mpsc::channel();
        let (answer, answered) = mpsc::channel();
        let asks = executor.spawn(ProcessSpec::new("asks").level(20), move || async move {
            let slot = Instant::now() + Duration::from_millis(20);
            notify.send(slot).unwrap();
            Sleep::until(slot).await;
            let now = Instant::now();
            let was_in_the_way = begun.try_recv().is_ok_and(|began| began < slot);
            // If a thread lost its core until the hog's end, its alarm rings too late to be
            // meaningful.
            let of_hog = std::cell::Cell::new(None);
            let held = interference(slot, now, |turn| {
                if turn.process == id {
                    of_hog.set(Some(*turn));
                }
                true
            });
            let held = held.filter(|_| was_in_the_way);
            if let Some(held) = held {
                assert_eq!(held.process, id);
                // From the deadline on. The alarm may be late on a busy machine.
                assert!(held.held <= now - slot);
                let turn = of_hog.get().unwrap();
                assert!(turn.ended >= slot + LONG && turn.ended <= now);
                if has_alarm {
                    assert!(turn.began >= slot - LEAD);
                }
            }
            answer.send(held.is_some()).unwrap();
        });
        executor.spawn(ProcessSpec::new("short"), || async {
            for _ in 0..200 {
                yield_now().await;
            }
        });
        executor.spawn(hog, move || async move {
            for _ in 0..100 {
                yield_now().await;
            }
            let _ = begin.send(Instant::now());
            let until = notified.recv().unwrap() + LONG;
            while Instant::now() < until {}
        });
        executor.release();
        assert_eq!(asks.wait(), Exit::Completed);
        answered.recv().unwrap()
    });
    assert!(is_tried);
}

#[test]
fn a_sleep_is_laid_to_nobody() {
    let executor = Executor::start(Attributes::new("main")).unwrap();
    let asks = executor.spawn(ProcessSpec::new("asks"), || async {
        // The executor looks at the clock; then it sleeps without a deadline; then it looks again.
        Sleep::until(Instant::now() + Duration::from_millis(1)).await;
        let (from, until) = blocking(|| {
            std::thread::sleep(LONG);
            (Instant::now() - LONG / 4, Instant::now())
        })
        .await;
        Sleep::until(Instant::now() + Duration::from_millis(1)).await;
        assert_eq!(between(from, until), None);
    });
    executor.release();
    assert_eq!(asks.wait(), Exit::Completed);
}

#[test]
fn the_building_of_a_process_is_laid_to_nobody() {
    // Again if a busy machine began to build too late to be in the way.
    let is_tried = (0..20).any(|_| {
        let executor = Executor::start(Attributes::new("main")).unwrap();
        let handle = executor.handle().clone();
        let (begin, begun) = mpsc::channel();
        let (answer, answered) = mpsc::channel();
        let asks = executor.spawn(ProcessSpec::new("asks"), || async move {
            let slot = Instant::now() + Duration::from_millis(10);
            // By another thread, so that it is built between two polls of this one.
            let spawns = std::thread::spawn(move || {
                handle.spawn(ProcessSpec::new("new"), move || {
                    let _ = begin.send(Instant::now());
                    burn(LONG);
                    async {}
                });
            });
            Sleep::until(slot).await;
            let now = Instant::now();
            spawns.join().unwrap();
            let was_in_the_way = begun.try_recv().is_ok_and(|began| began < slot);
            if was_in_the_way {
                let took = between(slot, now).map_or(Duration::ZERO, |turns| turns.held);
                assert!(now >= slot + LONG / 2 && took < LONG, "{took:?}");
            }
            answer.send(was_in_the_way).unwrap();
        });
        executor.release();
        assert_eq!(asks.wait(), Exit::Completed);
        answered.recv().unwrap()
    });
    assert!(is_tried);
}
