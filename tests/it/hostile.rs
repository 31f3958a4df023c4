//! Hostile user code: wakers that panic, payloads that panic when dropped, operations moved from
//! one run to another.

use crate::common::SpawnOk;
use luna::prelude::*;
use luna::{Error, RecvError};
use std::cell::Cell;
use std::future::Future;
use std::panic::{AssertUnwindSafe, catch_unwind, panic_any};
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::task::{Context, Poll, Wake, Waker};
use std::time::Duration;

/// What `f` returns; a hang is a failure after a generous while.
fn ends<T: Send + 'static>(f: impl FnOnce() -> T + Send + 'static) -> T {
    let (result, done) = mpsc::channel();
    std::thread::spawn(move || result.send(f()));
    done.recv_timeout(Duration::from_secs(60)).expect("it ends")
}

fn burn(time: Duration) {
    let end = luna::now() + time;
    while luna::now() < end {}
}

/// A flag that an emergency function sets.
fn flag_of(system: &mut System) -> Arc<AtomicBool> {
    let flag = Arc::new(AtomicBool::new(false));
    let own = flag.clone();
    system.on_emergency("flag", move || own.store(true, Ordering::SeqCst));
    flag
}

type Boxed = Pin<Box<dyn Future<Output = ()> + Send>>;

#[test]
fn a_delay_is_polled_in_one_run_and_awaited_in_the_next() {
    ends(|| {
        let mut delay: Boxed = Box::pin(luna::after(Duration::from_millis(100)));
        luna::run(std::future::poll_fn(|cx| {
            assert!(delay.as_mut().poll(cx).is_pending());
            Poll::Ready(Ok(()))
        }))
        .unwrap();
        luna::run(async {
            delay.await;
            Ok(())
        })
        .unwrap();
    });
}

/// A waker that owns a delay: dropping it cancels one.
struct OwnsDelay(#[expect(dead_code, reason = "for its drop")] Mutex<Boxed>);

impl Wake for OwnsDelay {
    fn wake(self: Arc<Self>) {}
}

#[test]
fn a_waker_that_owns_a_delay_is_dropped_with_another() {
    luna::run(async {
        let far = Duration::from_secs(1000);
        let mut inner: Boxed = Box::pin(luna::after(far));
        let mut cx = Context::from_waker(Waker::noop());
        assert!(inner.as_mut().poll(&mut cx).is_pending());
        let waker = Waker::from(Arc::new(OwnsDelay(Mutex::new(inner))));
        let mut outer: Boxed = Box::pin(luna::after(far));
        assert!(
            outer
                .as_mut()
                .poll(&mut Context::from_waker(&waker))
                .is_pending()
        );
        drop(waker);
        drop(outer);
        Ok(())
    })
    .unwrap();
}

#[test]
fn a_loop_that_is_always_late_lets_more_urgent_ones_run() {
    let mut system = System::new("hog");
    let executor = system.executor("one").build().unwrap();
    let hog_cycles = Arc::new(AtomicU32::new(0));
    let counted = hog_cycles.clone();
    let hog = async move {
        let mut tick = luna::periodic("hog", Duration::from_millis(1))?;
        for _ in 0..300 {
            tick.next().await;
            counted.fetch_add(1, Ordering::Relaxed);
            burn(Duration::from_micros(1500));
        }
        Ok(())
    };
    executor.process("hog").priority(1).spawn_ok(hog);
    let seen = Arc::new(AtomicU32::new(0));
    let at_end = seen.clone();
    let urgent = async move {
        let mut tick = luna::periodic("urgent", Duration::from_millis(5))?;
        for _ in 0..5 {
            tick.next().await;
        }
        at_end.store(hog_cycles.load(Ordering::Relaxed), Ordering::Relaxed);
        Ok(())
    };
    executor.process("urgent").priority(31).spawn_ok(urgent);
    system.run().unwrap();
    assert!(
        seen.load(Ordering::Relaxed) < 300,
        "the hog had to end first"
    );
}

struct Bomb;

impl Drop for Bomb {
    fn drop(&mut self) {
        panic!("in the drop of a cancelled body");
    }
}

#[test]
fn a_cancelled_body_panics_as_it_is_dropped() {
    let mut system = System::new("bomb");
    let safe = flag_of(&mut system);
    let executor = system.executor("one").build().unwrap();
    let victim = async {
        let _bomb = Bomb;
        std::future::pending().await
    };
    let id = executor.process("victim").spawn_ok(victim);
    let handles = executor.clone();
    let killer = async move {
        handles.process_handle(id).unwrap().cancel();
        std::future::pending().await
    };
    executor.process("killer").spawn_ok(killer);
    assert!(ends(move || system.run()).is_err());
    assert!(safe.load(Ordering::SeqCst));
}

/// A panic's payload that panics when it is dropped.
struct Payload;

impl Drop for Payload {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            panic!("the payload of a panic");
        }
    }
}

#[test]
fn an_emergency_function_panics_with_a_payload_that_panics() {
    let mut system = System::new("payload");
    system.on_emergency("first", || panic_any(Payload));
    let second_ran = flag_of(&mut system);
    let executor = system.executor("one").build().unwrap();
    executor
        .process("panics")
        .spawn_ok(async { panic!("to begin with") });
    assert!(ends(move || system.run()).is_err());
    assert!(second_ran.load(Ordering::SeqCst));
}

struct PanickingWaker;

impl Wake for PanickingWaker {
    fn wake(self: Arc<Self>) {
        panic!("a waker");
    }
}

fn poll_with_panicking_waker(delay: &mut Boxed) {
    let waker = Waker::from(Arc::new(PanickingWaker));
    assert!(
        delay
            .as_mut()
            .poll(&mut Context::from_waker(&waker))
            .is_pending()
    );
}

#[test]
fn a_foreign_waker_panics_on_an_executors_thread() {
    let mut system = System::new("waker on an executor");
    let safe = flag_of(&mut system);
    let executor = system.executor("one").build().unwrap();
    let body = async {
        let mut delay: Boxed = Box::pin(luna::after(Duration::from_millis(1)));
        poll_with_panicking_waker(&mut delay);
        std::future::pending().await
    };
    executor.process("waits").spawn_ok(body);
    assert!(ends(move || system.run()).is_err());
    assert!(safe.load(Ordering::SeqCst));
}

/// Another sender lives, so the channel does not close by itself.
#[test]
fn partners_elsewhere_learn_that_a_foreign_waker_has_ended_an_executor() {
    let mut system = System::new("partners of an executor");
    let (sender, receiver) = luna::channel::<u32>();
    let _keeps_it_open = sender.clone();
    let executor = system.executor("dies").build().unwrap();
    let has_waker = async {
        let mut delay: Boxed = Box::pin(luna::after(Duration::from_millis(1)));
        poll_with_panicking_waker(&mut delay);
        std::future::pending().await
    };
    executor.process("has the waker").spawn_ok(has_waker);
    let has_sender = async move {
        let _sender = sender;
        std::future::pending().await
    };
    executor.process("has a sender").spawn_ok(has_sender);
    let (learns, learned) = mpsc::channel();
    let partner = async move {
        learns.send(receiver.recv().await).map_err(Error::other)?;
        std::future::pending().await
    };
    let other = system.executor("lives").build().unwrap();
    other.process("partner").spawn_ok(partner);
    // The partner is cancelled when the functions have ended, so one of them waits for what it
    // learns.
    let received = Arc::new(Mutex::new(None));
    let reported = received.clone();
    system.on_emergency_within("waits", Duration::from_secs(30), move || {
        *reported.lock().unwrap() = learned.recv_timeout(Duration::from_secs(20)).ok();
    });
    let error = ends(move || system.run()).unwrap_err();
    assert_eq!(*received.lock().unwrap(), Some(Err(RecvError::Poisoned)));
    let text = format!("{error}");
    assert!(
        text.contains("has the waker") && text.contains("outside of any process"),
        "{text}"
    );
    assert!(text.ends_with("a waker"), "{text}");
}

#[test]
fn a_foreign_waker_panics_on_the_thread_of_a_process() {
    let mut system = System::new("waker on a thread");
    let safe = flag_of(&mut system);
    let body = async {
        let mut delay: Boxed = Box::pin(luna::after(Duration::from_millis(1)));
        poll_with_panicking_waker(&mut delay);
        std::future::pending().await
    };
    system.thread("own").process("waits").spawn_ok(body);
    assert!(ends(move || system.run()).is_err());
    assert!(safe.load(Ordering::SeqCst));
}

/// Panics when polled, and again, with a payload that panics, when dropped.
struct Twice;

impl Future for Twice {
    type Output = luna::Result<()>;
    fn poll(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<luna::Result<()>> {
        panic!("first");
    }
}

impl Drop for Twice {
    fn drop(&mut self) {
        panic_any(Payload);
    }
}

#[test]
fn a_body_panics_and_panics_again_as_it_is_dropped() {
    let mut system = System::new("twice");
    let executor = system.executor("one").build().unwrap();
    executor.process("panics").spawn_ok(Twice);
    assert!(ends(move || system.run()).is_err());
}

#[test]
fn a_failure_beside_a_panic_is_not_the_next_ones() {
    let late = Cell::new(false);
    let both = async {
        par!(
            async {
                let mut tick = luna::periodic("late", Duration::from_micros(100))?.limit(1);
                tick.next().await;
                late.set(true);
                burn(Duration::from_micros(300));
                tick.next().await;
                Ok(())
            },
            async {
                let panics = |_: &mut Context<'_>| {
                    if late.get() {
                        panic!("beside it")
                    } else {
                        Poll::<()>::Pending
                    }
                };
                std::future::poll_fn(panics).await;
                Ok(())
            },
        )
        .await
    };
    assert!(catch_unwind(AssertUnwindSafe(|| luna::run(both))).is_err());
    luna::run(async { Ok(()) }).unwrap();
}

#[test]
fn rephasing_tells_the_cycles_what_it_tells_the_report() {
    let reported = Arc::new(AtomicU64::new(0));
    let sum = reported.clone();
    let mut system = System::new("rephase");
    let executor = system.executor("one").build().unwrap();
    let body = async move {
        let mut tick =
            luna::periodic("loop", Duration::from_millis(2))?.overrun(luna::time::Overrun::Rephase);
        for n in 0..10 {
            sum.fetch_add(tick.next().await.missed, Ordering::Relaxed);
            burn(Duration::from_millis(if n % 3 == 0 { 5 } else { 1 }));
        }
        Ok(())
    };
    executor.process("body").spawn_ok(body);
    let report = system.run().unwrap();
    let one = &report.loops["loop"];
    assert_eq!(one.missed, reported.load(Ordering::Relaxed));
    assert_eq!(one.cycles + one.missed, one.slots_elapsed);
}
