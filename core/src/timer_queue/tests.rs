use super::*;
use crate::current::ExecutorId;
use std::pin::pin;
use std::sync::atomic::AtomicUsize;
use std::task::{Wake, Waker};

#[derive(Default)]
struct Count(AtomicUsize);
impl Wake for Count {
    fn wake(self: std::sync::Arc<Self>) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

#[test]
fn expires_at_its_deadline_and_not_before() {
    let queue = Arc::new(TimerQueue::new());
    let _entered = current::enter_executor(ExecutorId::new(), queue.clone(), false);
    let count = std::sync::Arc::new(Count::default());
    let waker = Waker::from(count.clone());
    let mut cx = Context::from_waker(&waker);
    let deadline = Instant::now() + Duration::from_secs(1000);

    let mut sleep = pin!(Sleep::until(deadline));
    assert!(sleep.as_mut().poll(&mut cx).is_pending());
    assert_eq!(queue.next_deadline(), deadline);
    queue.expire(deadline - Duration::from_nanos(1));
    assert_eq!(count.0.load(Ordering::Relaxed), 0);
    queue.expire(deadline);
    assert_eq!(count.0.load(Ordering::Relaxed), 1);
    assert_eq!(queue.next_deadline(), Instant::NEVER);
    assert!(sleep.as_mut().poll(&mut cx).is_ready());
}

#[test]
fn a_span_is_counted_from_the_first_poll() {
    const SPAN: Duration = Duration::from_secs(1000);
    let queue = Arc::new(TimerQueue::new());
    let _entered = current::enter_executor(ExecutorId::new(), queue.clone(), false);
    let mut cx = Context::from_waker(Waker::noop());
    let mut sleep = pin!(Sleep::after(SPAN));
    let made = Instant::now();
    while Instant::now() < made + Duration::from_millis(1) {}
    assert_eq!(sleep.deadline(), Instant::NEVER);
    assert!(sleep.as_mut().poll(&mut cx).is_pending());
    let deadline = sleep.deadline();
    assert!(
        deadline >= made + SPAN + Duration::from_millis(1) && deadline <= Instant::now() + SPAN
    );
    assert_eq!(queue.next_deadline(), deadline);
    assert!(sleep.as_mut().poll(&mut cx).is_pending());
    assert_eq!(sleep.deadline(), deadline, "counted once");
}

/// References to the queue are kept by the thread, and let go with its executor.
#[test]
fn a_queue_goes_with_its_executor_and_its_sleeps() {
    let queue = Arc::new(TimerQueue::new());
    let far = Instant::now() + Duration::from_secs(1000);
    let mut cx = Context::from_waker(Waker::noop());
    let mut left = Box::pin(Sleep::until(far));
    {
        let _entered = current::enter_executor(ExecutorId::new(), queue.clone(), false);
        for _ in 0..3 {
            let mut sleeps = [0; 2].map(|_| Box::pin(Sleep::until(far)));
            for sleep in &mut sleeps {
                assert!(sleep.as_mut().poll(&mut cx).is_pending());
            }
        }
        assert!(left.as_mut().poll(&mut cx).is_pending());
    }
    assert_eq!(Arc::strong_count(&queue), 2);
    std::thread::spawn(move || drop(left)).join().unwrap();
    assert_eq!(Arc::strong_count(&queue), 1);
    assert_eq!(queue.next_deadline(), Instant::NEVER);
}

#[test]
fn a_dropped_or_reset_sleep_is_gone() {
    let queue = Arc::new(TimerQueue::new());
    let _entered = current::enter_executor(ExecutorId::new(), queue.clone(), false);
    let mut cx = Context::from_waker(Waker::noop());
    let far = Instant::now() + Duration::from_secs(1000);
    {
        let mut sleep = pin!(Sleep::until(far));
        assert!(sleep.as_mut().poll(&mut cx).is_pending());
        sleep.as_mut().reset(far + Duration::from_secs(1));
        assert_eq!(queue.next_deadline(), Instant::NEVER);
        assert!(sleep.as_mut().poll(&mut cx).is_pending());
        assert_eq!(queue.next_deadline(), far + Duration::from_secs(1));
    }
    assert_eq!(queue.next_deadline(), Instant::NEVER);
}

#[test]
fn an_owner_is_called_for_what_it_does_not_provide_for() {
    #[derive(Default)]
    struct Calls(AtomicUsize);
    impl DeadlineListener for Calls {
        fn ask_look(&self) {
            self.0.fetch_add(1, Ordering::Relaxed);
        }
    }
    let calls = std::sync::Arc::new(Calls::default());
    let queue = Arc::new(TimerQueue::attended(calls.clone()));
    let _entered = current::enter_executor(ExecutorId::new(), queue.clone(), false);
    let at = |seconds| Instant::now() + Duration::from_secs(seconds);
    let sleep = |deadline| {
        let mut sleep = Box::pin(Sleep::until(deadline));
        let polled = sleep.as_mut().poll(&mut Context::from_waker(Waker::noop()));
        assert!(polled.is_pending());
        sleep
    };
    let count = || calls.0.swap(0, Ordering::Relaxed);
    let (near, far) = (at(1000), at(2000));
    let first = sleep(far);
    assert_eq!((count(), queue.provided()), (1, far));
    let later = sleep(at(3000));
    assert_eq!(count(), 0);
    let earlier = sleep(near);
    assert_eq!((count(), queue.provided()), (1, near));
    // A deadline that was dropped is provided for all the same.
    drop((first, later, earlier));
    let again = sleep(near);
    assert_eq!(count(), 0);
    queue.ask_look();
    assert_eq!(count(), 1);
    queue.provide(Instant::from_nanos(0));
    drop((again, sleep(at(500))));
    queue.ask_look();
    assert_eq!(count(), 0, "it looks anyway");
    queue.provide(Instant::NEVER);
    drop(sleep(at(9000)));
    assert_eq!(count(), 1);
}

#[test]
fn a_sleep_may_be_dropped_on_another_thread() {
    let queue = Arc::new(TimerQueue::new());
    let _entered = current::enter_executor(ExecutorId::new(), queue.clone(), false);
    let mut cx = Context::from_waker(Waker::noop());
    let mut sleep = Box::pin(Sleep::until(Instant::now() + Duration::from_secs(1000)));
    assert!(sleep.as_mut().poll(&mut cx).is_pending());
    std::thread::spawn(move || drop(sleep)).join().unwrap();
    assert_eq!(queue.next_deadline(), Instant::NEVER);
}

#[test]
#[should_panic(expected = "runs no LUNA process")]
fn a_thread_without_timers_says_so() {
    let mut sleep = pin!(Sleep::until(Instant::NEVER));
    let _ = sleep.as_mut().poll(&mut Context::from_waker(Waker::noop()));
}
