use super::*;
use crate::error::Error;
use crate::safety::{Cause, Safety};
use std::pin::pin;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, Weak};
use std::task::{Wake, Waker};

fn why(text: &str) -> Error {
    Error::other(text)
}

/// A waiting process of another core: it runs as soon as it is woken, before the thread that wakes
/// it goes on.
struct Waits {
    wait: Mutex<Option<Pin<Box<SafeStateEntered>>>>,
    /// What it does when it is woken, in the state that it finds, before it waits again.
    does: fn(&Emergency),
    emergency: Arc<Emergency>,
    wakes: AtomicUsize,
    reported: AtomicUsize,
}

impl Waits {
    fn new(emergency: &Arc<Emergency>, wait: SafeStateEntered, does: fn(&Emergency)) -> Arc<Self> {
        let waits = Arc::new(Self {
            wait: Mutex::new(Some(Box::pin(wait))),
            does,
            emergency: emergency.clone(),
            wakes: AtomicUsize::new(0),
            reported: AtomicUsize::new(0),
        });
        waits.clone().poll();
        waits
    }

    fn poll(self: Arc<Self>) {
        let waker = Waker::from(self.clone());
        let mut wait = self.wait.lock().unwrap();
        let Some(wait) = &mut *wait else { return };
        // Once it has reported, as a body that goes on and waits again.
        for _ in 0..2 {
            let polled = wait.as_mut().poll(&mut Context::from_waker(&waker));
            if polled.is_pending() {
                break;
            }
            self.reported.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn counts(&self) -> (usize, usize) {
        let count = |counter: &AtomicUsize| counter.load(Ordering::Relaxed);
        (count(&self.wakes), count(&self.reported))
    }
}

impl Wake for Waits {
    fn wake(self: Arc<Self>) {
        let wakes = self.wakes.fetch_add(1, Ordering::Relaxed);
        assert!(wakes < 10, "it is woken on and on");
        (self.does)(&self.emergency);
        self.poll();
    }
}

fn enter(emergency: &Emergency) {
    emergency.enter_safe_state(Cause::Raised(why("hot")));
}

fn leave(emergency: &Emergency) {
    emergency.journal.reset(why("cool"), || true).unwrap();
}

#[test]
fn one_that_finds_it_left_again_waits_for_the_next_one_and_is_not_woken_by_this() {
    let emergency = Emergency::new(Weak::new());
    let wait = SafeStateEntered::new(emergency.clone(), false);
    let waits = Waits::new(&emergency, wait, leave);
    enter(&emergency);
    assert_eq!(waits.counts(), (1, 0));
    enter(&emergency);
    assert_eq!(waits.counts(), (2, 0));
    waits.wait.lock().unwrap().take();
    enter(&emergency);
    assert_eq!(waits.counts(), (2, 0));
}

#[test]
fn one_that_waits_for_an_edge_is_told_once_and_waits_on_in_the_safe_state() {
    let emergency = Emergency::new(Weak::new());
    let wait = SafeStateEntered::new(emergency.clone(), true);
    let waits = Waits::new(&emergency, wait, |_| {});
    for round in 1..=3 {
        enter(&emergency);
        assert_eq!(waits.counts(), (round, round));
        // It is in one already.
        enter(&emergency);
        leave(&emergency);
        assert_eq!(waits.counts(), (round, round));
    }
    waits.wait.lock().unwrap().take();
}

/// Entered anew while some of the first round are still to be woken: no waiter is forgotten, and
/// each is notified.
#[test]
fn whichever_enters_it_anew_wakes_those_too_that_were_not_yet() {
    let emergency = Emergency::new(Weak::new());
    let again = |emergency: &Emergency| {
        leave(emergency);
        if emergency.journal.state().events.len() < 4 {
            enter(emergency);
        }
    };
    let wait = || SafeStateEntered::new(emergency.clone(), false);
    let first = Waits::new(&emergency, wait(), again);
    let others: [_; 3] = std::array::from_fn(|_| Waits::new(&emergency, wait(), |_| {}));
    enter(&emergency);
    for other in &others {
        assert!(other.counts().0 >= 1);
        other.wait.lock().unwrap().take();
    }
    first.wait.lock().unwrap().take();
}

#[test]
fn an_edge_tells_of_each_state_once() {
    let emergency = Emergency::new(Weak::new());
    let safety = Safety::new(emergency.clone());
    let mut cx = Context::from_waker(Waker::noop());
    let mut edge = pin!(safety.safe_state_edge());
    let mut is_reported = || edge.as_mut().poll(&mut cx).is_ready();
    assert!(!is_reported());
    safety.warn(why("warm"));
    assert!(!is_reported());
    enter(&emergency);
    assert!(is_reported() && !is_reported());
    safety.warn(why("still warm"));
    assert!(!is_reported());
    leave(&emergency);
    assert!(!is_reported());
    enter(&emergency);
    // A later edge has not reported it.
    let mut late = pin!(safety.safe_state_edge());
    let mut cx = Context::from_waker(Waker::noop());
    assert!(late.as_mut().poll(&mut cx).is_ready() && late.as_mut().poll(&mut cx).is_pending());
    assert!(is_reported() && !is_reported());
    emergency.journal.worsen(Degree::Emergency);
    assert!(is_reported() && !is_reported());
}
