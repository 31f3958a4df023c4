//! A component as other frameworks have it: ports, a parameter, and phases.
// ANCHOR: component
use luna::prelude::*;
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);

struct Axis {
    angle: Receiver<f64>,
    duty: Sender<f64>,
    gain: Parameter<f64>,
}

impl Process for Axis {
    fn pre_run(&mut self) -> luna::Result<()> {
        println!("ready, with a gain of {}", self.gain.get());
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        let mut tick = luna::periodic("axis", PERIOD)?;
        for _ in 0..2_000 {
            tick.next().await; // from here to the next tick the gain does not change
            let angle = self.angle.recv().await?;
            self.duty.send(self.gain.get() * (0.5 - angle)).await?;
        }
        Ok(())
    }

    fn post_run(&mut self) {
        println!("off");
    }
}
// ANCHOR_END: component

// ANCHOR: system
fn main() -> luna::Result<()> {
    let mut system = System::new("machine");
    system.virtual_clock();
    // As on a command line: the program's own arguments, or a file, give it too.
    system.parameter_arguments(["--set", "axis/gain=6"].map(str::to_owned))?;
    let servo = system.executor("servo").policy(Policy::fifo(80)).build()?;
    let (measured, angle) = luna::channel();
    let (duty, driven) = luna::channel();
    let (measured, duty) = (measured.named("angle"), duty.named("duty"));

    let axis = servo.process("axis").priority(20);
    let gain = axis.parameter("axis/gain", 4.0).range(0.0..=50.0);
    let gain = gain.unit("1/rad").register()?;
    axis.spawn(Axis { angle, duty, gain })?;
    servo.process("motor").priority(10).spawn(async move {
        let mut place = 0.0;
        while measured.send(place).await.is_ok() {
            let Ok(duty) = driven.recv().await else { break };
            place += duty * PERIOD.as_secs_f64();
        }
        println!("at {place:.2} rad");
        Ok(())
    })?;
    system.run()?;
    Ok(())
}
// ANCHOR_END: system
