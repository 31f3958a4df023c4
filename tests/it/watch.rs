//! The newest value for many readers.

use crate::common;
use common::{PLACEMENTS, SpawnOk, watchdog};
use luna::prelude::*;
use luna::sync::Watch;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

const LAST: u64 = 2_000;

/// Both halves are set together: a reader that sees them differ has seen a value that is torn.
type Halves = [u64; 16];

#[test]
fn every_reader_comes_to_the_last_value_and_sees_none_torn_or_twice() {
    for of_writer in PLACEMENTS {
        for of_readers in PLACEMENTS {
            let _watchdog = watchdog();
            let newest: Watch<Halves> = Watch::new([0; 16]);
            let done = Arc::new(AtomicUsize::new(0));
            let mut system = System::new("watch");
            for number in 0..4 {
                let (mut reader, done) = (newest.reader(), done.clone());
                let name = format!("reader {number}");
                of_readers
                    .process(&mut system, &name, &name)
                    .spawn_ok(async move {
                        let mut before = None;
                        loop {
                            let now = reader.changed().await?;
                            assert!(now.iter().all(|half| *half == now[0]), "{now:?}");
                            assert!(before < Some(now[0]), "{before:?}, then {}", now[0]);
                            before = Some(now[0]);
                            if now[0] == LAST {
                                break;
                            }
                        }
                        done.fetch_add(1, SeqCst);
                        Ok(())
                    });
            }
            of_writer
                .process(&mut system, "writer", "writer")
                .spawn_ok(async move {
                    for number in 1..=LAST {
                        newest.set([number; 16]).await?;
                    }
                    Ok(())
                });
            system.run().unwrap();
            assert_eq!(done.load(SeqCst), 4);
        }
    }
}

#[test]
fn a_reader_has_seen_what_it_took() {
    luna::run(async {
        let newest = Watch::new(1);
        let (mut seen, mut unseen) = (newest.reader(), newest.reader());
        assert_eq!(seen.get().await?, 1);
        newest.blocking_set(2)?;
        newest.set(3).await?;
        assert_eq!((seen.changed().await?, newest.get().await?), (3, 3));
        assert_eq!(unseen.changed().await?, 3);
        // Nothing new; and a reader that waited in vain misses nothing later.
        let waits = futures_lite::future::poll_once(seen.changed()).await;
        assert!(waits.is_none());
        newest.set(4).await?;
        assert_eq!(seen.changed().await?, 4);
        Ok(())
    })
    .unwrap();
}

#[test]
fn a_thread_sets_and_gets() {
    let newest = Watch::new(1).named("newest");
    let of_thread = newest.clone();
    let thread = std::thread::spawn(move || {
        of_thread.blocking_set(2).unwrap();
        of_thread.blocking_get().unwrap()
    });
    assert_eq!(thread.join().unwrap(), 2);
    luna::run(async move {
        assert_eq!(newest.get().await?, 2);
        Ok(())
    })
    .unwrap();
}
