//! The base on a virtual clock, without ROS 2: seconds take moments, and each run is the same.

use super::*;
use base::{Command, PERIOD, SILENCE};

#[test]
fn the_base_moves_as_long_as_commands_come() -> luna::Result<()> {
    let mut system = System::new("test");
    system.virtual_clock();
    let ends = base::describe(&mut system, Duration::from_secs(3))?;
    let operator = system.executor("operator").build()?;
    operator.process("operator").spawn(async move {
        let command = Command {
            ahead: 0.5,
            turn: 0.0,
        };
        let mut tick = luna::periodic("operator", Duration::from_millis(100))?;
        for _ in 0..10 {
            tick.next().await;
            ends.commands.send(command).await?;
        }
        luna::after(Duration::from_millis(100)).await;
        assert_eq!(ends.wheels.recv().await?.speeds, [10.0, 10.0]);
        luna::after(SILENCE).await;
        let wheels = ends.wheels.recv().await?;
        assert_eq!(wheels.speeds, [0.0, 0.0]);
        assert!((10.9..11.1).contains(&wheels.angles[0]), "{wheels:?}");
        Ok(())
    })?;
    system.run()?;
    Ok(())
}

/// As the program is without a bridge.
#[test]
fn the_base_stands_still_without_commands() -> luna::Result<()> {
    let mut system = System::new("test");
    system.virtual_clock();
    let duration = Duration::from_secs(1);
    let ends = base::describe(&mut system, duration)?;
    let base::Ends { commands, wheels } = ends;
    drop(commands);
    let operator = system.executor("operator").build()?;
    operator.process("operator").spawn(async move {
        let mut last = base::Wheels::default();
        while let Ok(state) = wheels.recv().await {
            last = state;
        }
        assert_eq!(last, base::Wheels::default());
        Ok(())
    })?;
    let report = system.run()?;
    let slots = (duration.as_nanos() / PERIOD.as_nanos()) as u64;
    assert_eq!(report.loops["drive"].cycles, slots);
    Ok(())
}

/// A name in it that the program lacks, or a value out of its range, fails here and not on the
/// machine.
#[test]
fn the_system_file_fits_the_program() -> luna::Result<()> {
    let mut system = System::new("test");
    system.virtual_clock();
    system.deployment_from("system.toml")?;
    base::describe(&mut system, Duration::from_secs(1))?;
    let report = system.run()?;
    // A loop of the file that the program lacks is no error: it is found here.
    let deployment = report.deployment.as_ref().expect("a file was named");
    let mut overrides = deployment.overrides.iter();
    assert!(overrides.all(|one| one.program.is_some()), "{deployment}");
    Ok(())
}
