//! A loop of 1 kHz that brings a spindle to its speed.
// ANCHOR: all
use luna::prelude::*;
use std::time::Duration;

/// Stands for the machine: 10 rad/s for each volt, with a time constant of 0.1 s.
#[derive(Default)]
struct Spindle {
    speed: f64,
}

impl Spindle {
    fn drive(&mut self, volts: f64) {
        self.speed += (10.0 * volts.clamp(-24.0, 24.0) - self.speed) * 0.01;
    }
}

fn main() -> luna::Result<()> {
    let mut system = System::new("spindle");
    let fast = system.executor("fast").policy(Policy::fifo(80)).build()?;
    let console = system.thread("console"); // one process, which may block
    let (setpoint, setpoints) = luna::buffered(Buffer::overwrite_oldest(1));
    let setpoint = setpoint.named("set-point");

    fast.process("control").priority(20).spawn(async move {
        let mut tick = luna::periodic("control", Duration::from_millis(1))?;
        let mut spindle = Spindle::default();
        let (mut target, mut integral) = (0.0, 0.0);
        for _ in 0..2_000 {
            tick.next().await; // the next slot, however late this cycle was
            if let Ok(new) = setpoints.try_recv() {
                target = new;
            }
            let error = target - spindle.speed;
            integral += 0.002 * error;
            spindle.drive(0.2 * error + integral);
        }
        println!("the spindle turns at {:.1} rad/s", spindle.speed);
        Ok(())
    })?;
    console.process("operator").spawn(async move {
        setpoint.send(100.0).await?;
        Ok(())
    })?;
    println!("{}", system.run()?);
    Ok(())
}
// ANCHOR_END: all
