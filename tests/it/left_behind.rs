//! A process that cannot be ended is detached, with all that it borrows.

use crate::common;
use common::{Log, PLACEMENTS, Placement, SpawnOk, panicked, watchdog};
use luna::prelude::*;

#[test]
fn a_process_that_is_blocked_is_left_behind_and_keeps_what_it_borrows() {
    let _watch = watchdog();
    struct Blocked {
        released: std::sync::mpsc::Receiver<()>,
        log: Log,
    }
    impl Process for Blocked {
        async fn run(&mut self) -> luna::Result<()> {
            self.log.add("blocked");
            self.released.recv().unwrap();
            self.log.add("released");
            Ok(())
        }
        fn post_run(&mut self) {
            self.log.add("post");
        }
    }
    impl Drop for Blocked {
        fn drop(&mut self) {
            self.log.add("dropped");
        }
    }
    // Side by side, since each takes the time that a process is given.
    std::thread::scope(|scope| {
        for place in PLACEMENTS {
            scope.spawn(move || {
                let log = Log::default();
                let (release, released) = std::sync::mpsc::channel();
                let mut system = System::new("blocked");
                place
                    .process(&mut system, "stuck", "blocked")
                    .spawn_ok(Blocked {
                        released,
                        log: log.clone(),
                    });
                let culprit = Placement::Thread.process(&mut system, "other", "culprit");
                let own = log.clone();
                culprit.spawn_ok(async move {
                    while own.all().is_empty() {
                        std::thread::yield_now();
                    }
                    panic!("while the other is blocked")
                });
                let start = luna::now();
                assert_eq!(
                    system.run().unwrap_err(),
                    panicked("culprit", "while the other is blocked")
                );
                assert!(
                    luna::now() - start >= std::time::Duration::from_secs(2),
                    "it was given time"
                );
                drop(system);
                // Its thread still runs it, so nothing of it is gone.
                assert_eq!(log.all(), ["blocked"], "{place:?}");
                release.send(()).unwrap();
                while log.all().len() < 2 {
                    std::thread::yield_now();
                }
                assert_eq!(log.all()[1], "released", "{place:?}");
            });
        }
    });
}
