//! From its first value on a plant's process neither allocates nor frees.

use crate::counting::Counting;
use crate::spawn::SpawnOk;
use luna::prelude::*;
use luna_plants::{DeadTime, FirstOrderLag, PanTilt, Plant, PlantLink, Port, Series};
use std::time::Duration;

#[global_allocator]
static ALLOCATOR: Counting = Counting::new();

const MS: Duration = Duration::from_millis(1);

fn exchanges(
    plant: impl Plant + Send + 'static,
    input: &str,
    output: &str,
    held: &[&str],
    lock_step: bool,
) {
    let mut system = System::new("allocation");
    let main = system.executor("main").build().unwrap();
    let (write, written) = luna::buffered::<f64>(Buffer::overwrite_oldest(1));
    let (read, values) = luna::buffered::<f64>(Buffer::overwrite_oldest(1));
    let mut link = PlantLink::new("plant", plant);
    link.actuator(input, written).unwrap();
    link.sensor(output, read).unwrap();
    for input in held {
        link.hold(input, 0.0).unwrap();
    }
    let process = if lock_step {
        link.lock_step(MS)
    } else {
        link.periodic(MS)
    };
    main.process("plant").spawn_ok(process.unwrap());
    main.process("control").spawn_ok(async move {
        let mut before = (0, 0);
        for n in 0..60 {
            values.recv().await?;
            write.send(f64::from(n % 7) / 10.0).await?;
            if n == 10 {
                before = ALLOCATOR.here();
            }
        }
        assert_eq!(ALLOCATOR.here(), before);
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn exchanges_allocate_nothing() {
    for lock_step in [true, false] {
        let chain = || {
            let port = |name| Port::new(name, "V");
            let delay = DeadTime::new(port("u"), port("v"), 5 * MS, MS);
            Series::new(delay, FirstOrderLag::new(port("v"), port("y"), 1.0, 3 * MS)).unwrap()
        };
        exchanges(chain(), "u", "y", &[], lock_step);
        let camera = PanTilt::jiwy([0, 0]);
        exchanges(camera, "pan duty", "pan count", &["tilt duty"], lock_step);
    }
    // The counter counts.
    let before = ALLOCATOR.here();
    drop(std::hint::black_box(Box::new(1)));
    assert_eq!(ALLOCATOR.here(), (before.0 + 1, before.1 + 1));
}
