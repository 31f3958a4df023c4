//! A 1 kHz loop at level 20, beside a process at level 1 of the same executor that always can run.
//!
//! ```text
//! busy MODE [CORE]
//! ```
//!
//! The mode is a list of words with a hyphen in between. `busy`: the second process is there.
//! `manager`: the timer manager wakes the loop. `other`, `rr`: the executor's policy, SCHED_FIFO 80
//! if neither is named. `thread`: the loop runs in an OS-thread process of its own, at SCHED_FIFO
//! 81. `deadline`: that one runs under SCHED_DEADLINE, without a core. The program prints the loop's
//! report: its wake-up latency is how late a deadline is noticed.

use luna::prelude::*;
use std::time::Duration;

const CYCLES: u32 = 500;
const PERIOD: Duration = Duration::from_millis(1);

fn main() -> luna::Result<()> {
    let mode = std::env::args().nth(1).unwrap_or_default();
    let core = std::env::args().nth(2);
    let core = core.and_then(|core| core.parse().ok()).unwrap_or(0);
    let has = |word: &str| mode.split('-').any(|other| other == word);
    let mut system = System::new("busy");
    system.lock_memory();
    if has("manager") {
        system.timers(luna::time::Timers::Manager);
    }
    let policy = match (has("other"), has("rr")) {
        (true, _) => Policy::Other,
        (_, true) => Policy::round_robin(80),
        _ => Policy::fifo(80),
    };
    let control = system
        .executor("control")
        .core(core)
        .policy(policy)
        .build()?;
    let (stop, stopped) = luna::buffered::<u8>(Buffer::overwrite_oldest(1));
    let cycles = async move {
        let mut tick = luna::periodic("loop", PERIOD)?;
        for _ in 0..CYCLES {
            tick.next().await;
        }
        stop.send(1).await?;
        Ok(())
    };
    if has("thread") || has("deadline") {
        let thread = system.thread("loop");
        let thread = if has("deadline") {
            let runtime = Duration::from_micros(200);
            thread.policy(Policy::deadline(runtime, PERIOD, PERIOD))
        } else {
            thread.core(core).policy(Policy::fifo(81))
        };
        thread.process("loop").spawn(cycles)?;
    } else {
        control.process("loop").priority(20).spawn(cycles)?;
    }
    if has("busy") {
        let burner = control.process("burner").priority(1);
        burner.spawn(async move {
            while stopped.try_recv().is_err() {
                luna::yield_now().await;
            }
            Ok(())
        })?;
    } else {
        std::mem::forget(stopped);
    }
    let report = system.run()?;
    let own = &report.loops["loop"];
    let micros = |time: Duration| time.as_nanos() as f64 / 1000.0;
    println!(
        "{mode}: {} cycles, {} missed, wake-up latency p50 {:.2} p99 {:.2} max {:.2} us",
        own.cycles,
        own.missed,
        micros(own.wake_latency.percentile(50.0)),
        micros(own.wake_latency.percentile(99.0)),
        micros(own.wake_latency.max()),
    );
    Ok(())
}
