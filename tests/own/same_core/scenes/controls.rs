//! Controls that hang here, which shows that the watch detects it: a lock that spins, and the
//! rendezvous of the standard library, which is crossbeam's.

use super::Scene;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;

/// A lock that yields its core while it waits, which helps no thread of a lower priority.
pub(crate) fn spin_lock() -> Scene {
    let lock = Arc::new(AtomicBool::new(false));
    let of_low = lock.clone();
    let acquire = |lock: &AtomicBool| {
        while lock.swap(true, Ordering::Acquire) {
            std::thread::yield_now();
        }
    };
    Scene::new(
        "spin lock",
        async move |high| {
            for _ in 0..high.rounds {
                high.pause().await;
                high.try_to(|| acquire(&lock));
                lock.store(false, Ordering::Release);
            }
        },
        async move |low| {
            while low.goes_on().await {
                acquire(&of_low);
                low.work(300);
                of_low.store(false, Ordering::Release);
            }
        },
    )
}

pub(crate) fn std_rendezvous() -> Scene {
    let (sender, receiver) = sync_channel::<u64>(0);
    Scene::new(
        "std::sync::mpsc::sync_channel(0)",
        async move |high| {
            for _ in 0..high.rounds {
                high.pause().await;
                high.block(|| receiver.recv()).unwrap();
            }
            drop(receiver);
        },
        async move |low| {
            let mut number = 0;
            while low.goes_on().await {
                number += 1;
                let _ = sender.send(number);
            }
        },
    )
}
