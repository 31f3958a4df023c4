use super::*;

#[cfg(not(loom))]
mod alone {
    use super::*;
    use std::pin::pin;
    use std::sync::Arc;
    use std::sync::atomic::AtomicUsize;
    use std::task::{Wake, Waker};

    #[derive(Default)]
    struct Count(AtomicUsize);
    impl Wake for Count {
        fn wake(self: Arc<Self>) {
            self.0.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn at(nanos: u64) -> Instant {
        Instant::from_nanos(nanos)
    }

    #[test]
    fn whoever_is_due_is_woken_once_and_nobody_else() {
        let list = TickList::new();
        let mut due = Due::with_room_for(8);
        let counts: [Arc<Count>; 2] = Default::default();
        let wakers = counts.clone().map(Waker::from);
        let mut first = pin!(list.wait(at(10)));
        let mut second = pin!(list.wait(at(20)));
        assert!(
            first
                .as_mut()
                .poll(&mut Context::from_waker(&wakers[0]))
                .is_pending()
        );
        assert!(
            second
                .as_mut()
                .poll(&mut Context::from_waker(&wakers[1]))
                .is_pending()
        );
        for (now, woken) in [
            (9, [0, 0]),
            (10, [1, 0]),
            (19, [1, 0]),
            (25, [1, 1]),
            (30, [1, 1]),
        ] {
            assert!(list.fire(at(now), &mut due));
            due.wake();
            let counted = counts
                .each_ref()
                .map(|count| count.0.load(Ordering::Relaxed));
            assert_eq!(counted, woken, "at {now}");
        }
        let mut cx = Context::from_waker(Waker::noop());
        assert_eq!(first.as_mut().poll(&mut cx), Poll::Ready(Woken::ByTick));
        assert_eq!(second.as_mut().poll(&mut cx), Poll::Ready(Woken::ByTick));
    }

    #[test]
    fn a_tick_for_more_than_there_is_room_for_is_fired_in_parts() {
        let list = TickList::new();
        let mut due = Due::with_room_for(2);
        let count = Arc::new(Count::default());
        let waker = Waker::from(count.clone());
        let mut waits: Vec<_> = (0..5).map(|_| Box::pin(list.wait(at(10)))).collect();
        for wait in &mut waits {
            assert!(
                wait.as_mut()
                    .poll(&mut Context::from_waker(&waker))
                    .is_pending()
            );
        }
        let mut parts = 1;
        while !list.fire(at(10), &mut due) {
            parts += 1;
            assert_eq!(due.wake(), 2);
        }
        due.wake();
        assert_eq!((parts, count.0.load(Ordering::Relaxed)), (3, 5));
    }

    #[test]
    fn a_dropped_wait_is_gone_and_a_polled_one_keeps_its_last_waker() {
        let list = TickList::new();
        let mut due = Due::with_room_for(8);
        let counts: [Arc<Count>; 3] = Default::default();
        let wakers = counts.clone().map(Waker::from);
        let mut gone = Box::pin(list.wait(at(10)));
        assert!(
            gone.as_mut()
                .poll(&mut Context::from_waker(&wakers[0]))
                .is_pending()
        );
        let mut moved = pin!(list.wait(at(10)));
        for waker in &wakers[1..] {
            assert!(
                moved
                    .as_mut()
                    .poll(&mut Context::from_waker(waker))
                    .is_pending()
            );
        }
        drop(gone);
        list.fire(at(10), &mut due);
        due.wake();
        let counted = counts
            .each_ref()
            .map(|count| count.0.load(Ordering::Relaxed));
        assert_eq!(counted, [0, 0, 1]);
    }

    #[test]
    fn a_closed_list_lets_everybody_go() {
        let list = TickList::new();
        let count = Arc::new(Count::default());
        let waker = Waker::from(count.clone());
        let mut cx = Context::from_waker(&waker);
        let mut waits = [10, 20].map(|nanos| Box::pin(list.wait(at(nanos))));
        for wait in &mut waits {
            assert!(wait.as_mut().poll(&mut cx).is_pending());
        }
        list.close();
        assert_eq!(count.0.load(Ordering::Relaxed), 2);
        for wait in &mut waits {
            assert_eq!(wait.as_mut().poll(&mut cx), Poll::Ready(Woken::ByEnd));
        }
        let mut late = pin!(list.wait(at(30)));
        assert_eq!(late.as_mut().poll(&mut cx), Poll::Ready(Woken::ByEnd));
    }

    #[test]
    fn lists_that_fire_together_wake_by_priority() {
        let mut due = Due::with_room_for(8);
        let order: Arc<std::sync::Mutex<Vec<usize>>> = Arc::default();
        struct Note(usize, Arc<std::sync::Mutex<Vec<usize>>>);
        impl Wake for Note {
            fn wake(self: Arc<Self>) {
                self.1.lock().unwrap().push(self.0);
            }
        }
        let mut add = |list: usize, of_list: &[(u8, usize)]| {
            due.lists = list;
            for &(level, tick) in of_list {
                let waker = Waker::from(Arc::new(Note(tick, order.clone())));
                let ready = WakeHandle::of(&Context::from_waker(&waker)).take();
                let priority = Priority { thread: 0, level };
                let number = due.entries.len();
                due.entries.push((priority, number, ready));
            }
        };
        add(1, &[(9, 0), (3, 1)]);
        add(2, &[(20, 2), (9, 3), (3, 4)]);
        assert_eq!(due.wake(), 5);
        assert_eq!(*order.lock().unwrap(), [2, 0, 3, 1, 4]);
    }
}

#[cfg(loom)]
mod interleavings {
    //! On every interleaving: no tick is missed, and a dropped wait is never accessed again. A list
    //! that does not check how far it was fired before it lists a wait misses a tick in the first
    //! model.

    use super::*;
    use std::sync::Arc;

    fn at(nanos: u64) -> Instant {
        Instant::from_nanos(nanos)
    }

    /// Fires the ticks 1 to `last`.
    fn keep_time(list: &Arc<TickList>, last: u64) -> loom::thread::JoinHandle<()> {
        let list = list.clone();
        loom::thread::spawn(move || {
            let mut due = Due::with_room_for(1);
            for tick in 1..=last {
                while !list.fire(at(tick), &mut due) {
                    due.wake();
                }
                due.wake();
            }
        })
    }

    #[test]
    fn a_wait_that_begins_as_its_tick_fires_is_not_lost() {
        loom::model(|| {
            let list = Arc::new(TickList::new());
            let keeper = keep_time(&list, 2);
            for tick in 1..=2 {
                assert_eq!(loom::future::block_on(list.wait(at(tick))), Woken::ByTick);
            }
            keeper.join().unwrap();
        });
    }

    #[test]
    fn two_who_wait_are_both_woken() {
        loom::model(|| {
            let list = Arc::new(TickList::new());
            let keeper = keep_time(&list, 1);
            let other = {
                let list = list.clone();
                loom::thread::spawn(move || loom::future::block_on(list.wait(at(1))))
            };
            assert_eq!(loom::future::block_on(list.wait(at(1))), Woken::ByTick);
            assert_eq!(other.join().unwrap(), Woken::ByTick);
            keeper.join().unwrap();
        });
    }

    #[test]
    fn a_wait_may_be_dropped_as_it_is_fired() {
        loom::model(|| {
            let list = Arc::new(TickList::new());
            let keeper = keep_time(&list, 1);
            {
                let mut wait = std::pin::pin!(list.wait(at(1)));
                let mut cx = Context::from_waker(std::task::Waker::noop());
                let _ = wait.as_mut().poll(&mut cx);
            }
            keeper.join().unwrap();
            assert!(list.waiting.lock().list.is_empty());
        });
    }

    #[test]
    fn the_end_of_the_one_who_fires_is_nobodys_end() {
        loom::model(|| {
            let list = Arc::new(TickList::new());
            let closer = {
                let list = list.clone();
                loom::thread::spawn(move || list.close())
            };
            assert_eq!(loom::future::block_on(list.wait(at(1))), Woken::ByEnd);
            closer.join().unwrap();
        });
    }
}
