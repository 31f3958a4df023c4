//! What several processes share.

use crate::laps::laps;
use crate::on_one_executor;
use luna::prelude::*;
use luna::sync::Mutex;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// How many come to the barrier.
const PARTIES: usize = 8;

pub(crate) fn barrier(steps: u64) -> luna::Result<()> {
    on_one_executor("barrier", |executor| {
        let barrier = Barrier::new(PARTIES);
        let is_over = Arc::new(AtomicBool::new(false));
        for number in 1..PARTIES {
            let barrier = barrier.clone();
            let is_over = is_over.clone();
            executor
                .process(format!("party {number}"))
                .spawn(async move {
                    while !is_over.load(Ordering::Relaxed) {
                        barrier.sync().await;
                    }
                    // The faster one waits for a next round.
                    barrier.resign();
                    Ok(())
                })?;
        }
        executor.process("counting").spawn(move || async move {
            laps(steps, async |_| {
                barrier.sync().await;
            })
            .await?;
            is_over.store(true, Ordering::Relaxed);
            barrier.resign();
            Ok(())
        })
    })
}

/// Without contention.
pub(crate) fn mutex(steps: u64) -> luna::Result<()> {
    on_one_executor("mutex", |executor| {
        let count = Mutex::new(0);
        executor.process("owner").spawn(move || async move {
            laps(steps, async |number| {
                let mut count = count.lock().await.expect("no holder has panicked");
                assert_eq!(*count, number);
                *count += 1;
            })
            .await
        })
    })
}
