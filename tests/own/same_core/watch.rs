//! The watch: a thread at FIFO 99 that finds the high side standing still, and says in what.
//!
//! It judges by the processor time that the threads have used since an operation began, not by the
//! clock: on a busy machine, or while a hypervisor has the core, the threads use none. The limit is
//! less than the 0.95 s after which the kernel lets ordinary threads run beside one that spins.

use crate::common;
use crate::kernel::{processor_time, stolen};
use crate::same_core::shared::{How, Shared};
use luna_core::park::Parker;
use luna_platform::clock::Instant;
use luna_platform::thread::{Attributes, Policy, Thread, available_cores, spawn};
use std::convert::Infallible;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::time::Duration;

/// What a right operation does not need a thousandth of.
const LIMIT: Duration = Duration::from_millis(300);
/// No thread used any processor time for so long: a deadlock.
const STANDSTILL: Duration = Duration::from_secs(60);
const LOOK: Duration = Duration::from_millis(20);

/// Why the high side stands still.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Why {
    /// It keeps its core busy, and the low side cannot go on.
    Spins,
    /// The low side works, and the high side is not served.
    PassedOver,
    /// The thread between them works instead of either.
    Inverted,
    /// No thread works.
    Deadlock,
}

/// What the watch has found.
#[derive(Debug, Clone)]
pub(crate) struct Verdict {
    pub(crate) scene: String,
    pub(crate) how: How,
    pub(crate) why: Why,
    /// Processor time that the high side, the low side and the thread between them have used since
    /// the operation was first seen.
    pub(crate) used: [Duration; 3],
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "stalled in `{}`, {:?}: {:?}; the high side used {:?}, the low side {:?}, the thread between \
             them {:?}",
            self.scene, self.how, self.why, self.used[0], self.used[1], self.used[2]
        )
    }
}

/// What was so when an operation was first seen.
struct Since {
    number: u64,
    clock: Instant,
    stolen: Duration,
    high: Duration,
    low: Duration,
    burner: Duration,
}

pub(crate) struct Watch {
    thread: Option<Thread<()>>,
    parker: Arc<Parker>,
    over: Arc<AtomicBool>,
}

impl Watch {
    /// Watches the high side on `core`. The callback is called once, with a verdict, and does not
    /// return.
    pub(crate) fn start(
        shared: Arc<Shared>,
        scenes: Vec<&'static str>,
        core: usize,
        report: impl Fn(Verdict) + Send + 'static,
    ) -> Watch {
        let parker = Arc::new(Parker::new());
        let over = Arc::new(AtomicBool::new(false));
        let (own, is_over) = (parker.clone(), over.clone());
        let mut attributes = Attributes::framework("watch", Policy::fifo(99));
        // Not to come between the two, where there is another core.
        if let Some(&other) = available_cores().iter().find(|&&other| other != core) {
            attributes = attributes.core(other);
        }
        let thread = spawn(
            attributes,
            |_| Ok::<_, Infallible>(()),
            move |()| {
                let mut since = None;
                while !is_over.load(Ordering::Acquire) {
                    own.park(Instant::now() + LOOK);
                    if let Some((how, why, used)) = look(&shared, core, &mut since) {
                        let scene = scenes.get(shared.scene.load(Ordering::Relaxed));
                        report(Verdict {
                            scene: scene.unwrap_or(&"no scene").to_string(),
                            how,
                            why,
                            used,
                        });
                        return;
                    }
                }
            },
        )
        .unwrap();
        Watch {
            thread: Some(thread),
            parker,
            over,
        }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Release);
        self.parker.unpark();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn look(
    shared: &Shared,
    core: usize,
    since: &mut Option<Since>,
) -> Option<(How, Why, [Duration; 3])> {
    let time = |thread: &AtomicI32| match thread.load(Ordering::Relaxed) {
        0 => Duration::ZERO,
        thread => processor_time(thread),
    };
    let Some((number, how)) = shared.operation() else {
        *since = None;
        return None;
    };
    let Some(first) = since.as_ref().filter(|first| first.number == number) else {
        *since = Some(Since {
            number,
            clock: Instant::now(),
            stolen: stolen(core),
            high: time(&shared.high_thread),
            low: time(&shared.low_thread),
            burner: time(&shared.burner_thread),
        });
        return None;
    };
    let all = [
        time(&shared.high_thread) - first.high,
        time(&shared.low_thread) - first.low,
        time(&shared.burner_thread) - first.burner,
    ];
    let reasons = [Why::Spins, Why::PassedOver, Why::Inverted];
    let (used, mut why) = all.into_iter().zip(reasons).max_by_key(|(used, _)| *used)?;
    if used < LIMIT {
        if Instant::now() < first.clock + STANDSTILL {
            return None;
        }
        why = Why::Deadlock;
    } else if used < LIMIT + (stolen(core) - first.stolen) {
        // Some kernels count what was stolen as used.
        return None;
    }
    // It may have gone on while this was read.
    (shared.operation() == Some((number, how))).then_some((how, why, all))
}

/// For tests: a stall is a failure, and the threads cannot be stopped.
pub(crate) fn abort(verdict: Verdict) {
    common::say(&format!("{verdict}"));
    std::process::abort();
}
