//! Locks: whatever happens at once, one at a time holds a mutex, no waiter is forgotten, and no
//! notification or permit is lost or doubled.

use super::{check, check_within, poll};
use crate::lock_sync::{Condvar, LockError, Mutex, MutexGuard, Semaphore};
use loom::future::block_on;
use loom::thread;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::Poll;

/// Locks a mutex that never has a dead owner.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    block_on(mutex.lock()).expect("nobody dies")
}

/// Adds one, in a way in which two at once would lose one; loom watches the value too.
fn add(mutex: &Mutex<u32>) {
    let mut guard = lock(mutex);
    let before = *guard;
    *guard = before + 1;
}

#[test]
fn one_at_a_time() {
    check(|| {
        let mutex = Mutex::new(0);
        let other = mutex.clone();
        let thread = thread::spawn(move || {
            add(&other);
            add(&other);
        });
        add(&mutex);
        thread.join().unwrap();
        assert_eq!(*lock(&mutex), 3);
    });
}

#[test]
fn three_at_once() {
    check_within(2, || {
        let mutex = Mutex::new(0);
        let threads = [0, 1].map(|_| {
            let mutex = mutex.clone();
            thread::spawn(move || add(&mutex))
        });
        add(&mutex);
        for thread in threads {
            thread.join().unwrap();
        }
        assert_eq!(*lock(&mutex), 3);
    });
}

#[test]
fn trying_takes_it_or_leaves_it() {
    check(|| {
        let mutex = Mutex::new(0);
        let other = mutex.clone();
        let thread = thread::spawn(move || match other.try_lock() {
            Ok(mut guard) => {
                *guard += 1;
                1
            }
            Err(error) => {
                assert!(error.is_locked());
                0
            }
        });
        add(&mutex);
        let theirs = thread.join().unwrap();
        assert_eq!(*lock(&mutex), 1 + theirs);
    });
}

#[test]
fn one_that_waits_goes_as_it_is_handed_the_mutex() {
    check(|| {
        let mutex = Mutex::new(0);
        let (of_holder, of_next) = (mutex.clone(), mutex.clone());
        let mut going = Box::pin(mutex.lock());
        let holder = thread::spawn(move || add(&of_holder));
        // It may have to wait, or be handed the mutex as it goes; or it holds it, and unlocks here.
        drop(poll(&mut going));
        let next = thread::spawn(move || add(&of_next));
        drop(going);
        holder.join().unwrap();
        next.join().unwrap();
        assert_eq!(*lock(&mutex), 2);
    });
}

#[test]
fn the_last_handle_goes_right_after_the_mutex_was_handed_on() {
    check(|| {
        let mutex = Mutex::new(Arc::new(()));
        let value = Arc::downgrade(&*lock(&mutex));
        let other = mutex.clone();
        let thread = thread::spawn(move || {
            drop(lock(&other));
        });
        drop(lock(&mutex));
        drop(mutex);
        thread.join().unwrap();
        assert!(value.upgrade().is_none());
    });
}

#[test]
fn a_holder_that_dies_is_known_to_the_next_alone() {
    check(|| {
        let mutex = Mutex::new(0);
        let other = mutex.clone();
        let dying = lock(&mutex);
        let thread = thread::spawn(move || match block_on(other.lock()) {
            Err(LockError::OwnerDied(died)) => *died.recover() += 1,
            _ => panic!("it was left in the middle"),
        });
        luna_core::current::with_abandoned(|| drop(dying));
        thread.join().unwrap();
        assert_eq!(*lock(&mutex), 1);
    });
}

#[test]
fn a_notification_is_not_lost_between_unlocking_and_waiting() {
    check(|| {
        let mutex = Mutex::new(false);
        let condition = Condvar::new();
        let (theirs, notifies) = (mutex.clone(), condition.clone());
        let thread = thread::spawn(move || {
            *lock(&theirs) = true;
            notifies.notify_one();
        });
        let guard = lock(&mutex);
        let guard = block_on(condition.wait_while(guard, |is_set| !*is_set));
        assert!(*guard.expect("nobody dies"));
        thread.join().unwrap();
    });
}

#[test]
fn all_that_wait_are_notified() {
    check_within(2, || {
        let mutex = Mutex::new(false);
        let condition = Condvar::new();
        let threads = [0, 1].map(|_| {
            let (mutex, condition) = (mutex.clone(), condition.clone());
            thread::spawn(move || {
                let guard = lock(&mutex);
                drop(block_on(condition.wait_while(guard, |is_set| !*is_set)));
            })
        });
        *lock(&mutex) = true;
        condition.notify_all();
        for thread in threads {
            thread.join().unwrap();
        }
    });
}

#[test]
fn a_wait_returns_once_for_each_notification() {
    check(|| {
        let mutex = Mutex::new(());
        let condition = Condvar::new();
        let (mine, theirs) = (mutex.clone(), condition.clone());
        let mut wait = Box::pin(condition.wait(lock(&mutex)));
        assert!(poll(&mut wait).is_pending());
        // Polled for nothing as it is notified: it returns for that alone, holding the mutex.
        let thread = thread::spawn(move || {
            drop(lock(&mine));
            theirs.notify_one();
        });
        let early = poll(&mut wait);
        let guard = match early {
            Poll::Ready(guard) => guard,
            Poll::Pending => block_on(wait),
        };
        assert!(mutex.try_lock().is_err());
        drop(guard);
        thread.join().unwrap();
        let mut again = Box::pin(condition.wait(lock(&mutex)));
        assert!(poll(&mut again).is_pending());
        assert!(poll(&mut again).is_pending(), "notified for nothing");
    });
}

#[test]
fn a_notification_is_passed_on_by_the_one_that_goes() {
    check(|| {
        let mutex = Mutex::new(());
        let condition = Condvar::new();
        let notifies = condition.clone();
        let mut goes = Box::pin(condition.wait(lock(&mutex)));
        assert!(poll(&mut goes).is_pending());
        let mut stays = Box::pin(condition.wait(lock(&mutex)));
        assert!(poll(&mut stays).is_pending());
        let thread = thread::spawn(move || notifies.notify_one());
        drop(goes);
        // Whether the first was notified or had gone already, the second is.
        drop(block_on(stays));
        thread.join().unwrap();
        assert!(mutex.try_lock().is_ok(), "the mutex is free again");
    });
}

#[test]
fn one_that_is_notified_with_all_and_goes_takes_nobody_elses() {
    check(|| {
        let mutex = Mutex::new(());
        let condition = Condvar::new();
        let notifies = condition.clone();
        let mut goes = Box::pin(condition.wait(lock(&mutex)));
        assert!(poll(&mut goes).is_pending());
        let mut stays = Box::pin(condition.wait(lock(&mutex)));
        assert!(poll(&mut stays).is_pending());
        let thread = thread::spawn(move || notifies.notify_all());
        drop(goes);
        drop(block_on(stays));
        thread.join().unwrap();
        let mut late = Box::pin(condition.wait(lock(&mutex)));
        assert!(poll(&mut late).is_pending());
        assert!(
            poll(&mut late).is_pending(),
            "notified by one that had gone"
        );
    });
}

#[test]
fn permits_are_neither_lost_nor_doubled() {
    check(|| {
        let semaphore = Semaphore::new(1);
        let inside = Arc::new(AtomicUsize::new(0));
        let enter = |semaphore: &Semaphore, inside: &AtomicUsize| {
            let permit = block_on(semaphore.acquire()).expect("nobody fails");
            assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0);
            inside.fetch_sub(1, Ordering::SeqCst);
            drop(permit);
        };
        let (other, theirs) = (semaphore.clone(), inside.clone());
        let thread = thread::spawn(move || enter(&other, &theirs));
        enter(&semaphore, &inside);
        thread.join().unwrap();
        assert_eq!(semaphore.available_permits(), 1);
    });
}

#[test]
fn one_that_acquires_goes_as_it_is_given_its_permits() {
    check(|| {
        let semaphore = Semaphore::new(0);
        let adds = semaphore.clone();
        let mut goes = Box::pin(semaphore.acquire_many(2));
        assert!(poll(&mut goes).is_pending());
        let mut stays = Box::pin(semaphore.acquire());
        assert!(poll(&mut stays).is_pending());
        let thread = thread::spawn(move || adds.add_permits(2));
        drop(goes);
        let permit = block_on(stays).expect("nobody fails");
        thread.join().unwrap();
        assert_eq!(semaphore.available_permits(), 1);
        drop(permit);
        assert_eq!(semaphore.available_permits(), 2);
    });
}

#[test]
fn several_are_served_by_one_that_adds() {
    check_within(2, || {
        let semaphore = Semaphore::new(0);
        let threads = [0, 1].map(|_| {
            let semaphore = semaphore.clone();
            thread::spawn(move || {
                block_on(semaphore.acquire())
                    .expect("nobody fails")
                    .forget()
            })
        });
        semaphore.add_permits(2);
        for thread in threads {
            thread.join().unwrap();
        }
        assert_eq!(semaphore.available_permits(), 0);
    });
}
