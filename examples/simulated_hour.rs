//! Measures a network on a virtual clock: 50 processes pass a value along in each cycle of a 1 kHz
//! loop, about 100 context switches.
//!
//! `cargo run --release --example simulated_hour -- 3600 1` simulates an hour on one executor;
//! without arguments it is a minute on two.
use luna::prelude::*;
use std::time::Duration;

const STAGES: usize = 49;

fn main() -> luna::Result<()> {
    let mut arguments = std::env::args().skip(1).map(|text| text.parse());
    let mut next = |default: u64| arguments.next().unwrap_or(Ok(default));
    let seconds = next(60).map_err(luna::Error::other)?;
    let executors = next(2).map_err(luna::Error::other)?.max(1) as usize;

    let mut system = System::new("simulated hour");
    system.virtual_clock();
    let executors: Vec<_> = (0..executors)
        .map(|number| system.executor(format!("executor {number}")).build())
        .collect::<luna::Result<_>>()?;
    let (first, mut input) = luna::channel::<usize>();
    for stage in 0..STAGES {
        let (output, next) = luna::channel();
        let own = std::mem::replace(&mut input, next);
        let process = executors[stage * executors.len() / STAGES].process(format!("stage {stage}"));
        process.spawn(async move {
            while let Ok(value) = own.recv().await {
                output.send(value + 1).await?;
            }
            Ok(())
        })?;
    }
    executors[0]
        .process("loop")
        .priority(20)
        .spawn(async move {
            let mut tick = luna::periodic("loop", Duration::from_millis(1))?;
            for number in 1..=seconds * 1000 {
                assert_eq!(tick.next().await.number, number);
                first.send(0).await?;
                assert_eq!(input.recv().await?, STAGES);
            }
            Ok(())
        })?;
    let report = system.run()?;
    assert_eq!(report.elapsed, Duration::from_secs(seconds));
    let cycles = seconds as f64 * 1000.0;
    let polls: u64 = report.processes.iter().map(|process| process.polls).sum();
    println!(
        "{seconds} s in {:.3} s: {:.2} µs a cycle, {:.1} polls each",
        report.really_elapsed.as_secs_f64(),
        report.really_elapsed.as_secs_f64() * 1e6 / cycles,
        polls as f64 / cycles
    );
    Ok(())
}
