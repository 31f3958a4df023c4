//! The camera for ten seconds: 51 processes at 1 kHz, with simulated motors, and how late their
//! loop was. `luna demo` runs the same processes with options.

use luna::prelude::*;
use luna_jiwy::joystick::Recording;
use luna_jiwy::network::{self, LOOP};
use luna_jiwy::{AXES, Executors, Settings, Start, hardware, verdict};
use std::process::ExitCode;
use std::time::Duration;

const CYCLES: u64 = 10_000;
const PERIOD: Duration = Duration::from_millis(1);

fn main() -> ExitCode {
    if std::env::args_os().len() > 1 {
        eprintln!(
            "jiwy: it takes no options; `luna demo` runs the same with options: cargo run --release -p luna-demo -- --help"
        );
        return ExitCode::from(2);
    }
    match run() {
        Ok(text) => {
            print!("{text}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("jiwy: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> luna::Result<String> {
    let mut system = System::new("jiwy");
    system.lock_memory();
    let control = system.executor("control").policy(Policy::fifo(80));
    // Interrupts tend to go to the first core.
    let control = match luna_platform::thread::available_cores().last() {
        Some(core) => control.core(*core),
        None => control,
    };
    let executors = Executors {
        control: control.build()?,
        // Real hardware is never late, but it must not make the loop late either.
        mechanism: system
            .executor("mechanism")
            .policy(Policy::fifo(79))
            .build()?,
        operator: system.executor("operator").build()?,
    };
    let settings = Settings {
        period: PERIOD,
        cycles: CYCLES,
        start: Start::Calibrate,
        joystick: Recording::built_in().play(),
    };
    let machine = hardware::simulated(&mut system, &executors.mechanism, settings.period)?;
    let findings = network::build(&executors, machine.registers, settings)?;
    drop(executors);
    let report = system.run()?;
    let mut text = format!("{}\n{report}\n", verdict(&report, LOOP));
    for (axis, findings) in AXES.iter().zip(&findings) {
        // The run may end before the calibration does.
        if let Some(tracking) = findings.tracking.get() {
            let [rms, max] = [tracking.rms(), tracking.max()].map(f64::to_degrees);
            text += &format!(
                "{}: {rms:.2}° rms beside its set-point, {max:.2}° at most\n",
                axis.name
            );
        }
    }
    Ok(text)
}
