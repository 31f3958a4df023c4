//! Locks of processes: mutexes, conditions, semaphores.

use super::{Places, ROUNDS};
use luna::sync::{Condvar, Mutex, Semaphore};
use std::time::Duration;

/// Three processes contend for one lock, at levels of their own, and hold it across awaits, one of
/// them for another lock.
pub(crate) fn mutexes(places: &mut Places) {
    let (total, inner) = (Mutex::new(0_u64), Mutex::new(0_u64));
    let own = inner.clone();
    places.process("holds the inner one", async move {
        for _ in 0..ROUNDS {
            let held = own.lock().await?;
            luna::yield_now().await;
            drop(held);
        }
        Ok(())
    });
    for level in [8, 16, 24] {
        let (total, inner) = (total.clone(), inner.clone());
        let adds = async move {
            for round in 0..ROUNDS {
                let mut sum = total.lock().await?;
                *sum += round;
                luna::yield_now().await;
                *inner.lock().await? += 1;
                drop(sum);
                drop(total.try_lock());
            }
            Ok(())
        };
        let name = format!("adds at {level}");
        places.next(&name).priority(level).spawn(adds).unwrap();
    }
}

pub(crate) fn locks_that_are_given_up(places: &mut Places) {
    let (lock, changed, permits) = (Mutex::new(()), Condvar::new(), Semaphore::new(1));
    for process in 0..2 {
        let (lock, changed, permits) = (lock.clone(), changed.clone(), permits.clone());
        places.process(&format!("waits a while {process}"), async move {
            for _ in 0..20 {
                if let Ok(held) = lock.lock_timeout(Duration::from_micros(100)).await {
                    luna::after(Duration::from_micros(150)).await;
                    drop(changed.wait_timeout(held, Duration::from_micros(50)).await?);
                }
                if let Ok(permit) = permits.acquire_timeout(Duration::from_micros(100)).await {
                    luna::after(Duration::from_micros(150)).await;
                    drop(permit);
                }
            }
            Ok(())
        });
    }
}

pub(crate) fn conditions(places: &mut Places) {
    let (turn, changed) = (Mutex::new(0_u64), Condvar::new());
    for own in 0..2 {
        let (turn, changed) = (turn.clone(), changed.clone());
        places.process(&format!("takes turns {own}"), async move {
            for _ in 0..ROUNDS {
                let turns = turn.lock().await?;
                let mut turns = changed.wait_while(turns, |turns| *turns % 2 != own).await?;
                *turns += 1;
                changed.notify_one();
            }
            Ok(())
        });
    }
}

pub(crate) fn semaphores(places: &mut Places) {
    let two = Semaphore::new(2);
    for process in 0..4 {
        let two = two.clone();
        places.process(&format!("one of two {process}"), async move {
            for _ in 0..ROUNDS {
                let permit = two.acquire().await?;
                luna::yield_now().await;
                drop(permit);
                drop(two.try_acquire());
            }
            Ok(())
        });
    }
}
