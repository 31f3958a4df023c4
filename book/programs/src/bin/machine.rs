//! An axis from its sensor to its safety functions, with a fault, on a virtual clock.
// ANCHOR: control
use luna::prelude::*;
use luna_plants::{Motor, PAN, PlantLink};
use luna_safety_blocks::{Blocked, Chain, EndStop, Limit, RateLimit, Reaction};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);

/// The controller: an angle comes, a duty goes. Whether a motor or a model of one is behind the two
/// channels is not its concern.
async fn control(angles: Receiver<f64>, duty: Sender<f64>) -> luna::Result<()> {
    let mut tick = luna::periodic("controller", PERIOD)?;
    let mut angle = 0.0;
    loop {
        let cycle = tick.next().await;
        if let Ok(new) = angles.try_recv() {
            angle = new;
        }
        let target = if cycle.number < 500 { 0.5 } else { -0.5 };
        duty.send(4.0 * (target - angle)).await?;
    }
}
// ANCHOR_END: control

// ANCHOR: sensor
/// The encoder's reader. After 600 values its cable is loose: it repeats the last one.
async fn encoder(
    raw: Receiver<f64>,
    to_control: Sender<f64>,
    to_safety: Sender<f64>,
) -> luna::Result<()> {
    let mut angle = 0.0;
    for n in 0.. {
        let new = raw.recv().await?;
        if n < 600 {
            angle = new;
        }
        to_control.send(angle).await?;
        to_safety.send(angle).await?;
    }
    Ok(())
}
// ANCHOR_END: sensor

// ANCHOR: blocks
/// What stands between the controller and the motor.
fn blocks() -> luna::Result<Chain> {
    let chain = Chain::new(0.0)? // neutral: off
        .then("limit", Limit::new(-0.7, 0.7)?, Reaction::Warn)?
        .then("slew", RateLimit::new(100.0)?.free_to(0.0)?, Reaction::Warn)?
        .then("stops", EndStop::new(-1.3, 1.3)?, Reaction::Warn)?
        .then(
            "motion",
            Blocked::new(0.3, 2e-3, 50 * PERIOD)?,
            Reaction::Emergency,
        )?;
    Ok(chain)
}
// ANCHOR_END: blocks

// ANCHOR: system
fn main() -> luna::Result<()> {
    let newest = |name: &str| {
        let (sender, receiver) = luna::buffered::<f64>(Buffer::overwrite_oldest(1));
        (sender.named(name), receiver)
    };
    let ((measured, raw), (safe, duties)) = (newest("measured"), newest("safe duty"));
    let ((to_control, angles), (to_safety, feedback)) = (newest("angle"), newest("feedback"));
    let (asked, wanted) = luna::channel();
    let asked = asked.named("wanted duty");

    let mut system = System::new("axis");
    system.virtual_clock();
    system.on_emergency("brake", || println!("the brake is closed"));
    let main = system.executor("main").policy(Policy::fifo(80)).build()?;

    let mut motor = PlantLink::new("motor", Motor::new(PAN));
    motor.actuator("duty", duties)?.sensor("angle", measured)?;
    motor.at_end(|motor| println!("the axis is at {:.1} rad", motor.state().angle));
    main.process("motor")
        .priority(31)
        .spawn(motor.periodic(PERIOD)?)?;

    let safety = blocks()?
        .process(wanted, safe)
        .feedback(feedback, 5 * PERIOD)?; // older than this it counts as none
    main.process("safety").priority(25).spawn(safety)?;
    main.process("encoder")
        .priority(22)
        .spawn(encoder(raw, to_control, to_safety))?;
    main.process("controller")
        .priority(20)
        .spawn(control(angles, asked))?;

    match system.run() {
        Ok(report) => println!("ended: {}", report.end),
        Err(cause) => println!("{cause}"),
    }
    let report = system.report().expect("it has run");
    println!("it ended after {:?}", report.elapsed);
    Ok(())
}
// ANCHOR_END: system
