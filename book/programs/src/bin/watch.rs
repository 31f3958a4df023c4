//! The newest pose of a vehicle, for a loop and for a display.
// ANCHOR: watch
use luna::prelude::*;
use luna::sync::{Watch, WatchReader};
use std::time::Duration;

#[derive(Clone, Copy, Default)]
struct Pose {
    x: f64,
    y: f64,
}

/// The writer. `None` tells the readers that it has ended.
async fn localizer(pose: Watch<Option<Pose>>) -> luna::Result<()> {
    let mut tick = luna::periodic("localizer", Duration::from_millis(10))?;
    for n in 1..=10 {
        tick.next().await;
        let way = 0.1 * f64::from(n);
        pose.set(Some(Pose { x: way, y: -way })).await?;
    }
    pose.set(None).await
}

/// A faster reader: it takes the present value in each cycle.
async fn steering(pose: Watch<Option<Pose>>) -> luna::Result<()> {
    let mut tick = luna::periodic("steering", Duration::from_millis(1))?;
    let (mut cycles, mut last) = (0, Pose::default());
    while let Some(now) = pose.get().await? {
        (cycles, last) = (cycles + 1, now); // on a machine: steer
        tick.next().await;
    }
    println!("steering: {cycles} cycles, to {:.1}, {:.1}", last.x, last.y);
    Ok(())
}

/// A slower reader: it waits for a value that it has not seen, and misses those meanwhile.
async fn display(mut poses: WatchReader<Option<Pose>>) -> luna::Result<()> {
    while let Some(pose) = poses.changed().await? {
        println!("display: {:.1}, {:.1}", pose.x, pose.y);
        luna::after(Duration::from_millis(35)).await; // it draws
    }
    Ok(())
}

fn main() -> luna::Result<()> {
    let mut system = System::new("vehicle");
    system.virtual_clock();
    let main = system.executor("main").build()?;
    let pose = Watch::new(Some(Pose::default())).named("pose");
    main.process("display")
        .priority(1)
        .spawn(display(pose.reader()))?;
    main.process("steering")
        .priority(20)
        .spawn(steering(pose.clone()))?;
    main.process("localizer")
        .priority(25)
        .spawn(localizer(pose))?;
    system.run()?;
    Ok(())
}
// ANCHOR_END: watch
