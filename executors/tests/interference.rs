//! Who ran instead: only what a process did is laid to it.

#![cfg(not(loom))]

use luna_executors::{Executor, Exit, Interference, ProcessSpec, blocking, interference};
use luna_platform::clock::Instant;
use luna_platform::thread::Attributes;
use luna_platform::timer_queue::Sleep;
use std::sync::mpsc;
use std::time::Duration;

const LONG: Duration = Duration::from_millis(100);

fn burn(time: Duration) {
    let end = Instant::now() + time;
    while Instant::now() < end {}
}

fn between(from: Instant, until: Instant) -> Option<Interference> {
    interference(from, until, |_| true)
}

#[test]
fn a_turn_is_laid_to_who_had_it() {
    let executor = Executor::start(Attributes::new("main")).unwrap();
    let hog = ProcessSpec::new("hog");
    let id = hog.id();
    let (tell, told) = mpsc::channel();
    let asks = executor.spawn(ProcessSpec::new("asks").level(20), move || async move {
        let slot = Instant::now() + Duration::from_millis(10);
        tell.send(slot).unwrap();
        Sleep::until(slot).await;
        let now = Instant::now();
        let turn = between(slot, now).unwrap();
        assert_eq!(turn.process, id);
        assert!(turn.began < slot && turn.ended >= slot + LONG && turn.ended <= now);
    });
    executor.spawn(hog, move || async move {
        burn(told.recv().unwrap() + LONG - Instant::now());
    });
    executor.release();
    assert_eq!(asks.wait(), Exit::Completed);
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
    let executor = Executor::start(Attributes::new("main")).unwrap();
    let handle = executor.handle().clone();
    let asks = executor.spawn(ProcessSpec::new("asks"), || async move {
        // From here on the executor has looked at the clock.
        Sleep::until(Instant::now() + Duration::from_millis(1)).await;
        let slot = Instant::now() + Duration::from_millis(1);
        // Built after this poll, on this thread.
        handle.spawn(ProcessSpec::new("new"), || {
            burn(LONG);
            async {}
        });
        Sleep::until(slot).await;
        let now = Instant::now();
        assert!(now >= slot + LONG / 2);
        // The poll itself may have taken long, on a busy machine.
        let took = between(slot, now).map_or(Duration::ZERO, |turn| turn.ended - turn.began);
        assert!(took < LONG, "{took:?}");
    });
    executor.release();
    assert_eq!(asks.wait(), Exit::Completed);
}
