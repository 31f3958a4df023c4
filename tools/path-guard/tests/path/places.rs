//! The placements of a scenario's processes: each scenario runs in all of them.

#[path = "../../../../tests/shared/mod.rs"]
mod shared;

use luna::system::ProcessBuilder;
use luna::{Executor, Policy, System};
pub(crate) use shared::watchdog;
use std::future::Future;

/// How the processes are spread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Placement {
    /// All on one executor.
    OneExecutor,
    /// On two executors in turn.
    TwoExecutors,
    /// On two executors of one core in turn, the second one at a higher priority.
    Bands,
    /// Each on a thread of its own.
    OsThreads,
    /// On an executor and on threads of their own in turn.
    Mixed,
}

impl Placement {
    pub(crate) const ALL: [Placement; 5] = [
        Placement::OneExecutor,
        Placement::TwoExecutors,
        Placement::Bands,
        Placement::OsThreads,
        Placement::Mixed,
    ];
}

/// A system with processes placed according to the placement.
pub(crate) struct Places {
    pub(crate) system: System,
    pub(crate) placement: Placement,
    /// The expected end of the system, if not success.
    pub(crate) error: Option<&'static str>,
    executors: Vec<Executor>,
    processes: usize,
}

impl Places {
    pub(crate) fn new(name: &str, placement: Placement) -> Self {
        let mut system = System::new(name);
        let executors = match placement {
            Placement::OneExecutor | Placement::Mixed => {
                vec![system.executor("left").build().unwrap()]
            }
            Placement::TwoExecutors => ["left", "right"]
                .map(|name| system.executor(name).build().unwrap())
                .into(),
            Placement::Bands => [("low", 20), ("high", 40)]
                .map(|(name, priority)| {
                    let executor = system.executor(name).core(0);
                    executor.policy(Policy::fifo(priority)).build().unwrap()
                })
                .into(),
            Placement::OsThreads => Vec::new(),
        };
        Self {
            system,
            placement,
            error: None,
            executors,
            processes: 0,
        }
    }

    /// The place of the next process.
    pub(crate) fn next(&mut self, name: &str) -> ProcessBuilder {
        let number = self.processes;
        self.processes += 1;
        let places = match self.placement {
            Placement::Mixed => 2,
            _ => self.executors.len(),
        };
        let executor = number
            .checked_rem(places)
            .and_then(|at| self.executors.get(at));
        match executor {
            Some(executor) => executor.process(name),
            None => self.system.thread(format!("own {number}")).process(name),
        }
    }

    /// A process in the next place.
    pub(crate) fn process(
        &mut self,
        name: &str,
        body: impl Future<Output = luna::Result<()>> + Send + 'static,
    ) {
        self.process_at(16, name, body);
    }

    /// A process in the next place, at a level.
    pub(crate) fn process_at(
        &mut self,
        level: u8,
        name: &str,
        body: impl Future<Output = luna::Result<()>> + Send + 'static,
    ) {
        let body = async move {
            assert!(
                luna::realtime::on_path(),
                "what is to be watched is on the path"
            );
            body.await
        };
        self.next(name).priority(level).spawn(body).unwrap();
    }
}

/// Runs `scenario` in all placements, held to the rules.
pub(crate) fn hold_to_the_rules(name: &'static str, scenario: fn(&mut Places)) {
    let _watch = watchdog();
    for placement in Placement::ALL {
        println!("{name}: {placement:?}");
        luna_path_guard::check(|| {
            let mut places = Places::new(name, placement);
            scenario(&mut places);
            match (places.system.run(), places.error) {
                (Ok(_), None) => {}
                (Err(error), Some(expected)) if error.to_string().contains(expected) => {}
                (outcome, expected) => panic!("expected {expected:?}, but: {outcome:?}"),
            }
        });
    }
}
