//! The same axis on a virtual clock: seconds take moments, and each run is the same.

use super::*;

fn run(amplitude: f64) -> luna::Result<(std::sync::Arc<axis::Outcome>, luna::Report)> {
    let mut system = System::new("test");
    system.virtual_clock();
    let outcome = axis::describe(&mut system, amplitude, Duration::from_secs(8))?;
    Ok((outcome, system.run()?))
}

#[test]
fn the_axis_follows_its_reference() -> luna::Result<()> {
    let (outcome, report) = run(0.8)?;
    assert!(outcome.largest_error() < 0.1, "{outcome:?}");
    assert!(outcome.furthest() > 0.7, "{outcome:?}");
    assert_eq!(report.loops["axis"].missed, 0);
    Ok(())
}

/// Set-points beyond the stops: the safety layer keeps the axis off the mechanical ones.
#[test]
fn the_axis_stays_within_its_stops() -> luna::Result<()> {
    let (outcome, _) = run(3.0)?;
    assert!(outcome.furthest() > axis::STOP, "{outcome:?}");
    assert!(
        outcome.furthest() < luna_plants::PAN.end_stop,
        "{outcome:?}"
    );
    Ok(())
}

/// A name in it that the program lacks, or a value out of its range, fails here and not on the
/// machine.
#[test]
fn the_system_file_fits_the_program() -> luna::Result<()> {
    let mut system = System::new("test");
    system.virtual_clock();
    system.deployment_from("system.toml")?;
    axis::describe(&mut system, 0.8, Duration::from_secs(1))?;
    let report = system.run()?;
    // A loop of the file that the program lacks is no error: it is found here.
    let deployment = report.deployment.as_ref().expect("a file was named");
    let mut overrides = deployment.overrides.iter();
    assert!(overrides.all(|one| one.program.is_some()), "{deployment}");
    Ok(())
}
