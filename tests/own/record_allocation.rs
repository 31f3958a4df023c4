//! Recording allocates nothing on the path: choices, contended channels, locks, clock reads, inputs
//! and outputs.

use crate::ALLOCATOR;
use crate::common;

use common::SpawnOk;
use luna::prelude::*;
use luna::replay;
use luna::sync::Mutex;
use std::time::Duration;

const ROUNDS: u64 = 1000;

#[test]
fn nothing_is_allocated_or_freed_by_recording_on_the_path() {
    own_process!();
    let path = std::env::temp_dir().join(format!("luna-record-allocation-{}", std::process::id()));
    let mut system = System::new("recorded");
    system.record_room(&path, 1 << 20);
    let left = system.executor("left").build().unwrap();
    let right = system.executor("right").build().unwrap();
    let (one, from_one) = luna::channel::<u64>();
    let (polled, from_polled) = luna::buffered::<u64>(luna::Buffer::overwrite_oldest(4));
    let shared = Mutex::new(0_u64);
    for executor in [&left, &right] {
        let (one, polled, shared) = (one.clone(), polled.clone(), shared.clone());
        let name = if std::ptr::eq(executor, &left) {
            "first"
        } else {
            "second"
        };
        executor.process(name).spawn_ok(async move {
            let counted = ALLOCATOR.here();
            for n in 0..ROUNDS {
                pri_alt! {
                    sent = one.send(replay::input("number", || n)) => sent?,
                    _ = luna::after(Duration::from_secs(1000)) => unreachable!(),
                }
                polled.send(n).await?;
                *shared.lock().await? += 1;
            }
            assert_eq!(ALLOCATOR.here(), counted);
            Ok(())
        });
    }
    drop((one, polled));
    right.process("takes").spawn_ok(async move {
        let counted = ALLOCATOR.here();
        for _ in 0..2 * ROUNDS {
            let value = alt! { value = from_one.recv() => value? };
            replay::output("value", &value);
            if let Ok(value) = from_polled.try_recv() {
                replay::output("polled", &value);
            }
            replay::output("time", &luna::now().as_nanos());
        }
        assert_eq!(ALLOCATOR.here(), counted);
        // The others are not done with the buffer before they end.
        while from_one.recv().await.is_ok() {}
        Ok(())
    });
    let report = system.run().unwrap();
    let recorded = report.record.unwrap();
    assert_eq!(recorded.lost, 0);
    assert!(recorded.events > 10 * ROUNDS);
    assert!(replay::Recording::open(&path).unwrap().is_whole());
    std::fs::remove_file(&path).unwrap();
}
