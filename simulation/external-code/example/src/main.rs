//! A controller generated as C positions a simulated motor.

use luna::prelude::*;
use luna_external_code::SubmodelProcess;
use luna_external_code_example::generated_pid;
use luna_plants::{Motor, PAN, PlantLink};
use std::time::Duration;

const STEP: Duration = Duration::from_millis(1);

fn main() -> luna::Result<()> {
    let mut system = System::new("external code");
    let control = system.executor("control").build()?;
    let (wanted, set_points) = luna::channel();
    let (angle, angles) = luna::channel();
    let (duty, duties) = luna::channel::<f64>();
    let (watched, watch) = luna::channel();

    control.process("pid").spawn(SubmodelProcess::new(
        generated_pid(),
        STEP,
        [set_points, angles],
        [duty],
    ))?;
    control.process("operator").spawn(async move {
        let mut reached = 0.0;
        for n in 0..2000 {
            let target = if n < 1000 { 0.8 } else { -0.4 };
            wanted.send(target).await?;
            reached = watch.recv().await?;
            if n % 250 == 249 {
                luna::realtime::off_path(|| println!("{n:4} ms: {reached:+.3} rad"));
            }
        }
        assert!(
            f64::abs(reached + 0.4) < 0.02,
            "it has not come to its target"
        );
        Ok(())
    })?;
    let mut motor = PlantLink::new("motor", Motor::new(PAN));
    motor.actuator("duty", duties)?;
    motor.sensor("angle", angle)?.sensor("angle", watched)?;
    control.process("motor").spawn(motor.lock_step(STEP)?)?;

    system.run()?;
    Ok(())
}
