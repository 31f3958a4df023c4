//! A process that cannot be ended is detached, with all that it borrows.

use crate::common;
use common::{PLACEMENTS, Placement, SpawnOk, watchdog};
use luna::Error;
use luna::prelude::*;
use std::sync::{Arc, Mutex};

type Log = Arc<Mutex<Vec<String>>>;

fn panicked(process: &str, message: &str) -> Error {
    Error::Process {
        name: process.to_owned(),
        source: Box::new(Error::Panicked(message.to_owned())),
    }
}

#[test]
fn a_process_that_is_blocked_is_left_behind_and_keeps_what_it_borrows() {
    let _watch = watchdog();
    struct Blocked {
        released: std::sync::mpsc::Receiver<()>,
        log: Log,
    }
    impl Process for Blocked {
        async fn run(&mut self) -> luna::Result<()> {
            self.log.lock().unwrap().push("blocked".to_owned());
            self.released.recv().unwrap();
            self.log.lock().unwrap().push("released".to_owned());
            Ok(())
        }
        fn post_run(&mut self) {
            self.log.lock().unwrap().push("post".to_owned());
        }
    }
    impl Drop for Blocked {
        fn drop(&mut self) {
            self.log.lock().unwrap().push("dropped".to_owned());
        }
    }
    for place in PLACEMENTS {
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
            while own.lock().unwrap().is_empty() {
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
        assert_eq!(*log.lock().unwrap(), ["blocked"], "{place:?}");
        release.send(()).unwrap();
        while log.lock().unwrap().len() < 2 {
            std::thread::yield_now();
        }
        assert_eq!(log.lock().unwrap()[1], "released", "{place:?}");
    }
}
