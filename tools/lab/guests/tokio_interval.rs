//! How late tokio's `interval` of 1 ms is, on one thread under SCHED_FIFO 80.
//!
//! ```text
//! tokio_interval [CYCLES]
//! ```

#[path = "latencies.rs"]
mod latencies;

use std::time::Duration;
use tokio::time::{Instant, interval};

fn main() -> Result<(), String> {
    let cycles = latencies::cycles(1)?;
    latencies::become_real_time()?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_time()
        .build();
    let runtime = runtime.map_err(|error| error.to_string())?;
    let mut late = latencies::Latencies::new(cycles);
    runtime.block_on(async {
        let mut tick = interval(Duration::from_millis(1));
        for _ in 0..cycles {
            let due = tick.tick().await;
            late.add(Instant::now() - due);
        }
    });
    late.print("tokio");
    Ok(())
}
