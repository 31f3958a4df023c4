//! Values of some tens of kilobytes, moved through channels on stacks of the default size.

use crate::common;
use common::{PLACEMENTS, SpawnOk, watchdog};
use luna::prelude::*;

/// An unoptimized build moves a value many times on its way, each time with stack of its own.
const SIZE: usize = 24 << 10;

type Image = [u8; SIZE];

#[test]
fn values_of_24_kib_pass_wherever_processes_run() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let mut system = System::new("images");
        let (output, input) = luna::channel::<Image>();
        let (stored, found) = luna::buffered::<Image>(Buffer::fifo(2));
        let source = place.process(&mut system, "place of source", "source");
        source.spawn_ok(async move {
            output.send([1; SIZE]).await?;
            par!(output.send([2; SIZE]), stored.send([3; SIZE])).await?;
            Ok(())
        });
        let sink = place.process(&mut system, "place of sink", "sink");
        sink.spawn_ok(async move {
            let first = input.recv().await?;
            let second = alt! {
                image = input.recv() => image?,
            };
            let third = found.recv().await?;
            assert_eq!(
                [first[SIZE - 1], second[SIZE - 1], third[SIZE - 1]],
                [1, 2, 3]
            );
            Ok(())
        });
        system.run().unwrap();
    }
}
