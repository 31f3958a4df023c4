//! Named sub-processes come, go and are looked at without an allocation in the process that they
//! are parts of.

use crate::ALLOCATOR;
use crate::common;

use common::{PLACES, watchdog};
use luna::Error;
use luna::prelude::*;

#[test]
fn nothing_is_allocated_or_freed_by_naming() {
    own_process!();
    let _watch = watchdog();
    for place in PLACES {
        let mut system = System::new("named");
        let observer = system.observer();
        place
            .process(&mut system, "place", "main")
            .spawn(async {
                let before = ALLOCATOR.here();
                assert!(before.0 > 0, "it does count");
                for _ in 0..2000 {
                    par!(
                        luna::named("left", async {
                            luna::yield_now().await;
                            Ok(())
                        }),
                        luna::named("right", luna::named("inner", async { Ok::<(), Error>(()) })),
                    )
                    .await?;
                    // Dropped where it waits.
                    let lost = luna::named("lost", std::future::pending::<()>());
                    futures_lite::future::or(lost, luna::yield_now()).await;
                }
                assert_eq!(ALLOCATOR.here(), before);
                Ok(())
            })
            .unwrap();
        let (done, ended) = std::sync::mpsc::channel::<()>();
        let looker = std::thread::spawn(move || {
            // Marks come and go between the nodes meanwhile.
            while ended.try_recv() != Err(std::sync::mpsc::TryRecvError::Disconnected) {
                assert_eq!(observer.composition().system, "named");
            }
        });
        system.run().unwrap();
        drop(done);
        looker.join().unwrap();
    }
}
