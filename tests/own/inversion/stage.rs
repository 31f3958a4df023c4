//! A system in which a high process waits for a low one, beside the thread between.

use crate::common::{Placement, SpawnOk};
use crate::inversion::between::{BURST, Burner, Control, Waits};
use crate::inversion::{HIGH, LOW, ROUNDS};
use crate::kernel::{as_scheduled, scheduled_priority};
use luna::after;
use luna::prelude::*;
use luna::system::ProcessBuilder;
use std::sync::{Arc, Mutex};
use std::time::Duration;

pub(super) struct Stage {
    pub(super) system: System,
    core: usize,
    burner: Burner,
    waits: Arc<Mutex<Vec<Duration>>>,
}

impl Stage {
    pub(super) fn new(core: usize) -> Stage {
        Stage {
            system: System::new("inversion"),
            core,
            burner: Burner::start(core),
            waits: Arc::default(),
        }
    }

    pub(super) fn process(
        &mut self,
        place: Placement,
        name: &str,
        policy: Policy,
    ) -> ProcessBuilder {
        let core = self.core;
        match place {
            Placement::Executor => {
                let executor = self.system.executor(name).core(core).policy(policy);
                executor.build().unwrap().process(name)
            }
            Placement::Thread => {
                let thread = self.system.thread(name).core(core).policy(policy);
                thread.process(name)
            }
        }
    }

    /// The high process: each round it waits to be released, releases the thread between, and does
    /// `once`.
    pub(super) fn high(
        &mut self,
        gone: Option<Receiver<()>>,
        once: impl AsyncFn() -> luna::Result<()> + Send + 'static,
    ) {
        let (control, waits) = (self.burner.control(), self.waits.clone());
        self.process(Placement::Executor, "high", Policy::fifo(HIGH))
            .spawn_ok(async move || {
                for _ in 0..ROUNDS {
                    match &gone {
                        Some(gone) => gone.recv().await?,
                        None => after(Duration::from_micros(300)).await,
                    }
                    let before = control.burnt();
                    control.go();
                    once().await?;
                    let burnt = control.burnt() - before;
                    waits.lock().unwrap().push(burnt);
                    settle(&control, before).await;
                }
                Ok(())
            });
    }

    pub(super) fn run(self) -> Waits {
        self.system.run().unwrap();
        let waits = self.waits.lock().unwrap();
        assert_eq!(waits.len(), ROUNDS);
        Waits::of(&waits)
    }
}

/// Lets it burn what it has left, so that each round begins alike.
async fn settle(control: &Control, before: Duration) {
    while control.burnt() < before + BURST {
        after(BURST).await;
    }
}

/// Releases the high process, which then runs at once; on a machine that was held up, when it is
/// ready for the round.
pub(super) async fn let_go(go: &Sender<()>) {
    while let Err(error) = go.try_send(()) {
        assert!(error.is_full(), "{error}");
        after(BURST).await;
    }
}

/// How the kernel writes the priority of a policy of a low thread.
pub(super) fn scheduled(own: Policy) -> i64 {
    match own.is_real_time() {
        true => as_scheduled(LOW),
        // As the main thread, which has no real-time policy.
        false => scheduled_priority(std::process::id() as i32),
    }
}
