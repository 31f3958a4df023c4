//! The thread between, and what it had of the core.

use crate::common::say;
use crate::inversion::{MIDDLE, thread};
use crate::kernel::{burn, processor_time, spoilt, thread_id};
use luna_core::park::Parker;
use luna_platform::clock::Instant;
use luna_platform::thread::Thread;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::time::Duration;

/// How long it keeps the core each time.
pub(crate) const BURST: Duration = Duration::from_millis(4);
/// How much of that a wait with inheritance may contain: none, except what a page fault of the low
/// thread lets through.
const INHERITED: Duration = Duration::from_micros(400);

/// The thread between: each time that it is released it keeps the core for a burst.
pub(crate) struct Burner {
    parker: Arc<Parker>,
    over: Arc<AtomicBool>,
    number: i32,
    thread: Option<Thread<()>>,
}

impl Burner {
    pub(crate) fn start(core: usize) -> Burner {
        let (parker, over) = (Arc::new(Parker::new()), Arc::new(AtomicBool::new(false)));
        let (own, is_over) = (parker.clone(), over.clone());
        let number = Arc::new(AtomicI32::new(0));
        let known = Arc::new(Parker::new());
        let (notify, notified) = (number.clone(), known.clone());
        let thread = thread("middle", core, MIDDLE, move || {
            notify.store(thread_id(), Ordering::SeqCst);
            notified.unpark();
            loop {
                own.park(Instant::NEVER);
                if is_over.load(Ordering::SeqCst) {
                    return;
                }
                burn(BURST);
            }
        });
        known.park(Instant::NEVER);
        Burner {
            parker,
            over,
            number: number.load(Ordering::SeqCst),
            thread: Some(thread),
        }
    }

    /// What lets it go, and how much it has burnt.
    pub(crate) fn control(&self) -> Control {
        Control {
            parker: self.parker.clone(),
            number: self.number,
        }
    }
}

impl Drop for Burner {
    fn drop(&mut self) {
        self.over.store(true, Ordering::SeqCst);
        self.parker.unpark();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[derive(Clone)]
pub(crate) struct Control {
    parker: Arc<Parker>,
    number: i32,
}

impl Control {
    /// Lets it go: it runs as soon as no thread above it does.
    pub(crate) fn go(&self) {
        self.parker.unpark();
    }

    pub(crate) fn burnt(&self) -> Duration {
        processor_time(self.number)
    }
}

/// The least and the most that the one between had of the core while the high one waited.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Waits {
    least: Duration,
    most: Duration,
}

impl Waits {
    /// The first is left out: the memory that the threads need is not resident yet. So are the
    /// extremes that a machine may [spoil](spoilt).
    pub(crate) fn of(all: &[Duration]) -> Waits {
        let mut settled = all[1..].to_vec();
        settled.sort_unstable();
        let left_out = spoilt(settled.len() as u64) as usize;
        Waits {
            least: settled[left_out],
            most: settled[settled.len() - 1 - left_out],
        }
    }

    pub(crate) fn expect_inherited(&self, what: &str) {
        say(&format!("{what}: at most {:?} in between", self.most));
        assert!(self.most < INHERITED, "{what}: {self:?}");
    }

    /// Each time the whole burst.
    pub(crate) fn expect_inverted(&self, what: &str) {
        say(&format!(
            "{what} (control): at least {:?} in between",
            self.least
        ));
        assert!(self.least > BURST / 2, "{what}: {self:?}");
    }
}
