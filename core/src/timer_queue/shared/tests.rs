use super::*;
use crate::timer_queue::Sleep;
use std::future::Future;
use std::sync::Mutex;
use std::task::{Context, Waker};
use std::time::Duration;

/// Keeps the earliest instant at which the owner was asked to look.
#[derive(Default)]
struct Alarm(Mutex<Option<Instant>>);

impl DeadlineListener for Alarm {
    fn ask_look(&self) {}

    fn ask_look_at(&self, deadline: Instant) {
        *self.0.lock().unwrap() = Some(deadline);
    }
}

impl Alarm {
    fn armed(&self) -> Option<Instant> {
        *self.0.lock().unwrap()
    }
}

fn queue() -> (Arc<TimerQueue>, std::sync::Arc<Alarm>) {
    let alarm = std::sync::Arc::new(Alarm::default());
    (Arc::new(TimerQueue::shared(alarm.clone())), alarm)
}

fn far() -> Instant {
    Instant::now() + Duration::from_secs(1000)
}

fn after(base: Instant, seconds: u64) -> Instant {
    base + Duration::from_secs(seconds)
}

#[cfg(not(loom))]
mod alone {
    use super::*;
    use crate::current::WakeHandle;
    use std::pin::Pin;
    use std::task::Wake;

    struct Note(usize, std::sync::Arc<Mutex<Vec<usize>>>);

    impl Wake for Note {
        fn wake(self: std::sync::Arc<Self>) {
            self.1.lock().unwrap().push(self.0);
        }
    }

    fn wait(
        queue: &Arc<TimerQueue>,
        number: u32,
        at: Instant,
        woken: &std::sync::Arc<Mutex<Vec<usize>>>,
    ) -> Pin<Box<Sleep>> {
        let waker = Waker::from(std::sync::Arc::new(Note(number as usize, woken.clone())));
        let mut sleep = Box::pin(Sleep::by(queue, at));
        let polled = sleep.as_mut().poll(&mut Context::from_waker(&waker));
        assert!(polled.is_pending());
        sleep
    }

    fn is_ready(sleep: &mut Pin<Box<Sleep>>) -> bool {
        let polled = sleep.as_mut().poll(&mut Context::from_waker(Waker::noop()));
        polled.is_ready()
    }

    #[test]
    fn what_is_due_is_woken_once_and_nothing_else() {
        let (queue, alarm) = queue();
        let (base, woken) = (far(), std::sync::Arc::default());
        let mut later = wait(&queue, 2, after(base, 20), &woken);
        assert_eq!(alarm.armed(), Some(after(base, 20)));
        let mut first = wait(&queue, 1, after(base, 10), &woken);
        assert_eq!(alarm.armed(), Some(after(base, 10)));
        let mut due = Due::with_room_for(8, 1);
        for (now, so_far) in [(9, vec![]), (10, vec![1]), (19, vec![1]), (25, vec![1, 2])] {
            assert!(queue.take_due(after(base, now), &mut due));
            due.wake();
            queue.settle();
            assert_eq!(*woken.lock().unwrap(), so_far, "at {now}");
        }
        assert_eq!(due.latest, 5_000_000_000);
        assert!(is_ready(&mut first) && is_ready(&mut later));
    }

    #[test]
    fn nobody_is_notified_until_the_owner_settles() {
        let (queue, alarm) = queue();
        let (base, woken) = (far(), std::sync::Arc::default());
        let mut due = Due::with_room_for(8, 1);
        assert!(queue.take_due(base, &mut due));
        let _first = wait(&queue, 1, after(base, 10), &woken);
        assert_eq!(alarm.armed(), None);
        queue.settle();
        assert_eq!(alarm.armed(), Some(after(base, 10)));
        let _later = wait(&queue, 2, after(base, 11), &woken);
        assert_eq!(alarm.armed(), Some(after(base, 10)));
        queue.ask_look_now();
        let _earlier = wait(&queue, 3, after(base, 9), &woken);
        assert_eq!(alarm.armed(), Some(Instant::from_nanos(0)));
    }

    #[test]
    fn more_than_there_is_room_for_comes_in_parts() {
        let (queue, _alarm) = queue();
        let (base, woken) = (far(), std::sync::Arc::default());
        let _waits: Vec<_> = (0..5).map(|n| wait(&queue, n, base, &woken)).collect();
        let mut due = Due::with_room_for(2, 1);
        let mut parts = 1;
        while !queue.take_due(base, &mut due) {
            parts += 1;
            assert_eq!(due.wake(), 2);
        }
        due.wake();
        assert_eq!(parts, 3);
        assert_eq!(*woken.lock().unwrap(), [0, 1, 2, 3, 4]);
    }

    #[test]
    fn a_dropped_wait_is_gone_and_a_polled_one_keeps_its_last_waker() {
        let (queue, _alarm) = queue();
        let (base, woken) = (far(), std::sync::Arc::default());
        let gone = wait(&queue, 0, base, &woken);
        let mut moved = wait(&queue, 1, base, &woken);
        let waker = Waker::from(std::sync::Arc::new(Note(7, woken.clone())));
        let polled = moved.as_mut().poll(&mut Context::from_waker(&waker));
        assert!(polled.is_pending());
        drop(gone);
        let mut due = Due::with_room_for(8, 1);
        queue.take_due(base, &mut due);
        due.wake();
        assert_eq!(*woken.lock().unwrap(), [7]);
    }

    #[test]
    fn a_closed_queue_lets_all_go() {
        let (queue, _alarm) = queue();
        let (base, woken) = (far(), std::sync::Arc::default());
        let mut waits = [0, 1].map(|n| wait(&queue, n, after(base, n.into()), &woken));
        let mut deadline = Deadline::new();
        deadline.arm(&queue, 0, base);
        queue.close();
        assert_eq!(*woken.lock().unwrap(), [0, 1]);
        assert!(waits.iter_mut().all(is_ready) && queue.is_closed());
        let mut late = Box::pin(Sleep::by(&queue, base));
        assert!(is_ready(&mut late));
        deadline.arm(&queue, 0, base);
        assert!(!deadline.disarm());
    }

    #[test]
    fn a_deadline_gives_its_number_once_where_it_was_armed_last() {
        let (queue, alarm) = queue();
        let base = far();
        let mut due = Due::with_room_for(1, 4);
        let mut deadlines = [(); 3].map(|()| Deadline::new());
        for ((deadline, number), at) in deadlines.iter_mut().zip(0..).zip([12, 11, 13]) {
            deadline.arm(&queue, number, after(base, at));
        }
        assert_eq!(alarm.armed(), Some(after(base, 11)));
        deadlines[1].arm(&queue, 1, after(base, 20));
        assert!(deadlines[2].disarm() && !deadlines[2].disarm());
        queue.take_due(after(base, 15), &mut due);
        assert_eq!(due.calls, [0]);
        assert!(deadlines[0].take_fired() && !deadlines[0].take_fired());
        assert!(!deadlines[1].take_fired() && !deadlines[0].disarm());
        due.calls.clear();
        drop(deadlines);
        queue.take_due(after(base, 30), &mut due);
        assert!(due.calls.is_empty());
    }

    #[test]
    fn the_most_urgent_is_woken_first() {
        let order = std::sync::Arc::default();
        let mut due = Due::with_room_for(8, 1);
        for (number, level) in [3, 20, 9, 20, 3].into_iter().enumerate() {
            let note = std::sync::Arc::new(Note(number, std::sync::Arc::clone(&order)));
            let waker = Waker::from(note);
            let ready = WakeHandle::of(&Context::from_waker(&waker)).take();
            let priority = Priority { thread: 0, level };
            due.who.push((priority, number, ready));
        }
        assert_eq!(due.wake(), 5);
        assert_eq!(*order.lock().unwrap(), [1, 3, 2, 0, 4]);
    }
}

#[cfg(loom)]
mod interleavings {
    //! On every interleaving: an armed deadline is taken, or the owner is asked to look for it; and
    //! a dropped wait is never accessed again.

    use super::*;
    use std::pin::pin;

    /// Takes what is due at `now`, as the owner does each time it wakes.
    fn look(queue: &Arc<TimerQueue>, now: Instant) -> loom::thread::JoinHandle<()> {
        let queue = queue.clone();
        loom::thread::spawn(move || {
            let mut due = Due::with_room_for(1, 1);
            while !queue.take_due(now, &mut due) {
                due.wake();
            }
            due.wake();
            queue.settle();
        })
    }

    #[test]
    fn a_wait_that_begins_as_the_owner_looks_is_not_lost() {
        loom::model(|| {
            let (queue, alarm) = queue();
            let at = far();
            let owner = look(&queue, at);
            let mut sleep = pin!(Sleep::by(&queue, at));
            let mut cx = Context::from_waker(Waker::noop());
            let _ = sleep.as_mut().poll(&mut cx);
            owner.join().unwrap();
            let is_taken = queue.next_deadline() == Instant::NEVER;
            assert!(is_taken || alarm.armed().is_some_and(|armed| armed <= at));
            assert_eq!(sleep.as_mut().poll(&mut cx).is_ready(), is_taken);
        });
    }

    #[test]
    fn a_wait_may_be_dropped_as_it_is_taken() {
        loom::model(|| {
            let (queue, _alarm) = queue();
            let at = far();
            let owner = look(&queue, at);
            {
                let mut sleep = pin!(Sleep::by(&queue, at));
                let _ = sleep.as_mut().poll(&mut Context::from_waker(Waker::noop()));
            }
            owner.join().unwrap();
            assert_eq!(queue.next_deadline(), Instant::NEVER);
        });
    }

    #[test]
    fn the_end_of_the_owner_ends_each_wait() {
        loom::model(|| {
            let (queue, _alarm) = queue();
            let closer = {
                let queue = queue.clone();
                loom::thread::spawn(move || queue.close())
            };
            loom::future::block_on(Sleep::by(&queue, far()));
            closer.join().unwrap();
        });
    }
}
