//! From its first value on a plant's process neither allocates nor frees.

use luna::prelude::*;
use luna_plants::{DeadTime, FirstOrderLag, PanTilt, Plant, PlantLink, Port, Series};
use std::alloc::{GlobalAlloc, Layout, System as Heap};
use std::cell::Cell;
use std::time::Duration;

struct Counting;

thread_local! {
    /// Of this thread alone: the thread that runs the system frees the start's memory at any time.
    static CALLS: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    CALLS.set(CALLS.get() + 1);
}

// SAFETY: it passes everything on.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: as the caller promises.
        unsafe { Heap.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        count();
        // SAFETY: as the caller promises.
        unsafe { Heap.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const MS: Duration = Duration::from_millis(1);

fn exchanges(
    plant: impl Plant + Send + 'static,
    input: &str,
    output: &str,
    held: &[&str],
    lock_step: bool,
) -> u64 {
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
    main.process("plant").spawn(process.unwrap()).unwrap();
    let (counted, count) = std::sync::mpsc::channel();
    main.process("control")
        .spawn(async move {
            let mut before = 0;
            for n in 0..60 {
                values.recv().await?;
                write.send(f64::from(n % 7) / 10.0).await?;
                if n == 10 {
                    before = CALLS.get();
                }
            }
            let calls = CALLS.get() - before;
            luna::off_path(|| counted.send(calls).unwrap());
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    count.recv().unwrap()
}

#[test]
fn exchanges_allocate_nothing() {
    for lock_step in [true, false] {
        let chain = || {
            let port = |name| Port::new(name, "V");
            let delay = DeadTime::new(port("u"), port("v"), 5 * MS, MS);
            Series::new(delay, FirstOrderLag::new(port("v"), port("y"), 1.0, 3 * MS)).unwrap()
        };
        assert_eq!(exchanges(chain(), "u", "y", &[], lock_step), 0);
        let camera = PanTilt::jiwy([0, 0]);
        assert_eq!(
            exchanges(camera, "pan duty", "pan count", &["tilt duty"], lock_step),
            0
        );
    }
    // The counter counts.
    let before = CALLS.get();
    drop(std::hint::black_box(Box::new(1)));
    assert_eq!(CALLS.get() - before, 2);
}
