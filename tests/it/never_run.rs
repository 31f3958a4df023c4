//! A system that is described and never run, or not started: what it was to consist of is dropped.

use crate::common;
use common::{SpawnOk, watchdog};
use luna::Error;
use luna::error::SetupError;
use luna::prelude::*;
use std::sync::{Arc, Weak};

/// What a body or a function holds, and how it is seen to be gone.
struct Kept(Vec<Weak<()>>);

impl Kept {
    fn one(&mut self) -> Arc<()> {
        let one = Arc::new(());
        self.0.push(Arc::downgrade(&one));
        one
    }

    fn left(&self) -> usize {
        self.0.iter().filter(|one| one.upgrade().is_some()).count()
    }
}

struct Holder(Arc<()>, luna::Executor);

impl Process for Holder {
    async fn run(&mut self) -> luna::Result<()> {
        let _both = (&self.0, &self.1);
        Ok(())
    }
}

fn describe(kept: &mut Kept) -> (System, luna::Executor) {
    let mut system = System::new("described");
    let main = system.executor("main").build().unwrap();
    let (one, own) = (kept.one(), main.clone());
    main.process("future").spawn_ok(async move {
        let _both = (&one, &own);
        Ok(())
    });
    main.process("process")
        .spawn_ok(Holder(kept.one(), main.clone()));
    let (one, own) = (kept.one(), main.clone());
    system
        .thread("thread")
        .process("on a thread")
        .spawn_ok(move || {
            let both = (one, own);
            async move {
                drop(both);
                Ok(())
            }
        });
    let (one, own) = (kept.one(), main.clone());
    system.on_emergency("stop", move || {
        let _both = (&one, &own);
    });
    let (one, own) = (kept.one(), main.clone());
    system
        .stand_in("nobody", move |(): ()| {
            let both = (one, own);
            async move {
                drop(both);
                Ok(())
            }
        })
        .unwrap();
    (system, main)
}

#[test]
fn a_system_that_is_dropped_drops_what_was_described() {
    let _watch = watchdog();
    let mut kept = Kept(Vec::new());
    let (system, main) = describe(&mut kept);
    let (sender, receiver) = luna::channel::<()>();
    main.process("sender").spawn_ok(async move {
        sender.send(()).await?;
        Ok(())
    });
    assert_eq!(kept.left(), 5);
    drop(system);
    assert_eq!(kept.left(), 0, "although {main:?} is still here");
    assert!(matches!(
        receiver.try_recv(),
        Err(luna::TryRecvError::Closed)
    ));
    // This process would never start.
    let refused = main.process("late").spawn(async { Ok(()) });
    assert!(matches!(
        refused,
        Err(Error::Setup(SetupError::Ended { .. }))
    ));
}

#[test]
fn so_does_one_that_does_not_start() {
    let _watch = watchdog();
    let mut kept = Kept(Vec::new());
    let (system, main) = describe(&mut kept);
    // The stand-in has no process.
    assert!(system.run().is_err());
    drop((system, main));
    assert_eq!(kept.left(), 0);
}

#[test]
fn a_panic_in_a_drop_keeps_no_other_from_its_own() {
    struct Bomb;
    impl Drop for Bomb {
        fn drop(&mut self) {
            panic!("on purpose");
        }
    }
    let _watch = watchdog();
    let mut kept = Kept(Vec::new());
    let mut system = System::new("bomb");
    let main = system.executor("main").build().unwrap();
    let bomb = Bomb;
    main.process("bomb").spawn_ok(async move {
        let _bomb = &bomb;
        Ok(())
    });
    main.process("holder")
        .spawn_ok(Holder(kept.one(), main.clone()));
    drop(system);
    assert_eq!(kept.left(), 0);
}
