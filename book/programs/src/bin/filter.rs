//! Two filters between a sensor and its user.
// ANCHOR: filter
use luna::prelude::*;
use std::f64::consts::TAU;
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);

/// A filter as a process: one value comes, one goes. `step` has the filter's state.
async fn filter(
    input: Receiver<f64>,
    output: Sender<f64>,
    mut step: impl FnMut(f64) -> f64,
) -> luna::Result<()> {
    loop {
        output.send(step(input.recv().await?)).await?;
    }
}

/// Low pass of first order, for one value each `period`. It begins at its first value.
fn low_pass(cutoff_hz: f64, period: Duration) -> impl FnMut(f64) -> f64 {
    let share = 1.0 - (-TAU * cutoff_hz * period.as_secs_f64()).exp();
    let mut state = None;
    move |new| {
        let last = state.unwrap_or(new);
        *state.insert(last + share * (new - last))
    }
}

/// The median of three values: takes out a spike of one value, and delays by one.
fn median() -> impl FnMut(f64) -> f64 {
    let mut before: Option<[f64; 2]> = None;
    move |new| {
        let [a, b] = before.unwrap_or([new; 2]);
        before = Some([b, new]);
        a.min(b).max(a.max(b).min(new))
    }
}
// ANCHOR_END: filter

// ANCHOR: system
fn channel(name: &str) -> (Sender<f64>, Receiver<f64>) {
    let (sender, receiver) = luna::channel();
    (sender.named(name), receiver)
}

fn main() -> luna::Result<()> {
    let mut system = System::new("force");
    system.virtual_clock();
    let main = system.executor("main").build()?;
    let (raw, measured) = channel("raw");
    let (without_spikes, clean) = channel("without spikes");
    let (smooth, forces) = channel("force");

    main.process("sensor").priority(20).spawn(async move {
        let mut tick = luna::periodic("sensor", PERIOD)?;
        for n in 0..1_000 {
            tick.next().await;
            let noise = if n % 2 == 0 { 0.1 } else { -0.1 };
            let spike = if n % 100 == 50 { 30.0 } else { 0.0 };
            raw.send(5.0 + noise + spike).await?;
        }
        Ok(())
    })?;
    main.process("median")
        .priority(21)
        .spawn(filter(measured, without_spikes, median()))?;
    main.process("low pass")
        .priority(22)
        .spawn(filter(clean, smooth, low_pass(20.0, PERIOD)))?;
    main.process("user").priority(23).spawn(async move {
        let (mut least, mut most) = (f64::MAX, f64::MIN);
        while let Ok(force) = forces.recv().await {
            (least, most) = (least.min(force), most.max(force));
        }
        println!("between {least:.2} and {most:.2} N");
        Ok(())
    })?;
    system.run()?;
    Ok(())
}
// ANCHOR_END: system
