//! A loop of 1 kHz that brings an axis to its set-point, and its test on a virtual clock.
// ANCHOR: control
use luna::prelude::*;
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);
const CYCLES: u64 = 2_000;

/// The control loop. Each cycle takes the newest set-point, if there is one, and moves the axis by
/// a hundredth of the distance. On a machine it would read a sensor and set a motor here.
async fn control(setpoints: Receiver<f64>, position: Signal<f64>) -> luna::Result<()> {
    let (mut target, mut place) = (0.0, 0.0);
    let mut tick = luna::periodic("servo", PERIOD)?;
    for _ in 0..CYCLES {
        tick.next().await;
        if let Ok(new) = setpoints.try_recv() {
            target = new;
        }
        place += (target - place) * 0.01;
        position.record(place);
    }
    println!("the axis is at {place:.2}");
    Ok(())
}
// ANCHOR_END: control

// ANCHOR: system
/// Which processes there are, where they run, and how they are connected.
fn describe(system: &mut System) -> luna::Result<()> {
    system.lock_memory();
    let fast = system.executor("fast").policy(Policy::fifo(80)).build()?;
    let console = system.thread("console");
    let (setpoint, setpoints) = luna::buffered(Buffer::overwrite_oldest(1));
    let setpoint = setpoint.named("set-point");

    let servo = fast.process("servo").priority(20);
    let position = servo.signal("servo/position").unit("m").register()?;
    servo.spawn(control(setpoints, position))?;
    console.process("operator").spawn(async move {
        setpoint.send(1.0).await?;
        luna::after(Duration::from_secs(1)).await;
        setpoint.send(0.5).await?;
        Ok(())
    })?;
    Ok(())
}

fn main() -> luna::Result<()> {
    let mut system = System::new("servo");
    describe(&mut system)?;
    println!("{}", system.run()?);
    Ok(())
}
// ANCHOR_END: system

// ANCHOR: test
#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_slots_are_kept() -> luna::Result<()> {
        let mut system = System::new("servo");
        system.virtual_clock(); // before executors and threads
        describe(&mut system)?;
        let report = system.run()?;
        let servo = &report.loops["servo"];
        assert_eq!((servo.cycles, servo.missed), (CYCLES, 0));
        assert_eq!(report.elapsed, Duration::from_secs(2));
        Ok(())
    }
}
// ANCHOR_END: test
