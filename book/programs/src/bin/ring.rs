//! Three processes in a ring end in order when one of them has done its work.
// ANCHOR: ring
use luna::prelude::*;
use std::time::Duration;

async fn motor(torques: Receiver<f64>, speeds: Sender<f64>) -> luna::Result<()> {
    let mut speed = 0.0;
    loop {
        speeds.send(speed).await?; // one process of a ring has to send first
        speed += 0.1 * torques.recv().await?;
    }
}

async fn observer(speeds: Receiver<f64>, estimates: Sender<f64>) -> luna::Result<()> {
    let mut estimate = 0.0;
    loop {
        estimate += 0.5 * (speeds.recv().await? - estimate);
        estimates.send(estimate).await?;
    }
}

async fn controller(estimates: Receiver<f64>, torques: Sender<f64>) -> luna::Result<()> {
    let mut tick = luna::periodic("controller", Duration::from_millis(1))?;
    let mut speed = 0.0;
    for _ in 0..100 {
        tick.next().await;
        speed = estimates.recv().await?;
        torques.send(10.0 - speed).await?;
    }
    println!("the motor turns at {speed:.1} rad/s");
    Ok(()) // drops both ends: the neighbours' operations fail as closed
}
// ANCHOR_END: ring

// ANCHOR: system
fn channel(name: &str) -> (Sender<f64>, Receiver<f64>) {
    let (sender, receiver) = luna::channel();
    (sender.named(name), receiver)
}

fn main() -> luna::Result<()> {
    let mut system = System::new("ring");
    system.virtual_clock();
    let main = system.executor("main").build()?;
    let (speeds, measured) = channel("speed");
    let (estimates, estimated) = channel("estimate");
    let (torques, driven) = channel("torque");
    main.process("motor").spawn(motor(driven, speeds))?;
    main.process("observer")
        .spawn(observer(measured, estimates))?;
    main.process("controller")
        .spawn(controller(estimated, torques))?;

    let report = system.run()?;
    println!("ended: {}", report.end);
    for end in &report.ended_at {
        println!("{end}");
    }
    Ok(())
}
// ANCHOR_END: system
