//! What the measured programs share: their policy, and their figures.

use nix::sys::mman::{MlockAllFlags, mlockall};
use std::env;
use std::io;
use std::time::Duration;

/// The argument with the number of cycles; 2000 without one.
pub(crate) fn cycles(index: usize) -> Result<usize, String> {
    match env::args().nth(index) {
        None => Ok(2000),
        Some(text) => match text.parse() {
            Ok(cycles) if cycles > 0 => Ok(cycles),
            _ => Err(format!("no number of cycles: {text}")),
        },
    }
}

/// Locks the memory, and puts the thread under SCHED_FIFO 80.
pub(crate) fn become_real_time() -> Result<(), String> {
    mlockall(MlockAllFlags::MCL_CURRENT | MlockAllFlags::MCL_FUTURE)
        .map_err(|error| format!("mlockall: {error}"))?;
    let parameters = libc::sched_param { sched_priority: 80 };
    // SAFETY: the pointer is that of a live structure, which the call only reads.
    if unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &parameters) } != 0 {
        return Err(format!("SCHED_FIFO 80: {}", io::Error::last_os_error()));
    }
    Ok(())
}

/// Latencies, in memory that is there before the first.
pub(crate) struct Latencies {
    all: Vec<Duration>,
}

impl Latencies {
    pub(crate) fn new(cycles: usize) -> Latencies {
        let mut all = vec![Duration::MAX; cycles];
        all.clear();
        Latencies { all }
    }

    pub(crate) fn add(&mut self, late: Duration) {
        self.all.push(late);
    }

    /// Prints the figures as `busy` does.
    pub(crate) fn print(mut self, name: &str) {
        self.all.sort();
        let last = self.all.len() - 1;
        let micros = |part: f64| self.all[(last as f64 * part) as usize].as_nanos() as f64 / 1000.0;
        println!(
            "{name}: {} cycles, wake-up latency p50 {:.2} p99 {:.2} max {:.2} us",
            self.all.len(),
            micros(0.5),
            micros(0.99),
            micros(1.0),
        );
    }
}
