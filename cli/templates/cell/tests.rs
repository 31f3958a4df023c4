//! The same cell on a virtual clock: seconds take moments, and each run is the same.

use super::*;
use luna::End;

const DURATION: Duration = Duration::from_secs(5);

#[test]
fn all_blocks_are_stacked() -> luna::Result<()> {
    let mut system = System::new("test");
    system.virtual_clock();
    let cell = cell::describe(&mut system, DURATION, None)?;
    let report = system.run()?;
    assert_eq!(cell.stacked(), 100);
    assert!(!cell.press_is_open());
    assert_eq!(report.loops["feeder"].missed, 0);
    Ok(())
}

#[test]
fn a_jam_opens_the_press() -> luna::Result<()> {
    let mut system = System::new("test");
    system.virtual_clock();
    let cell = cell::describe(&mut system, DURATION, Some(7))?;
    let error = system.run().expect_err("the press is jammed");
    let expected = "process `watch`: the cell is jammed: the last block was Some(6)";
    assert_eq!(error.to_string(), expected);
    assert_eq!(cell.stacked(), 7);
    assert!(cell.press_is_open());
    let report = system.report().expect("the system has run");
    assert_eq!(report.end, End::Emergency);
    assert!(report.elapsed < 8 * cell::FEED + 2 * cell::PATIENCE);
    Ok(())
}

/// A name in it that the program lacks, or a value out of its range, fails here and not on the
/// machine.
#[test]
fn the_system_file_fits_the_program() -> luna::Result<()> {
    let mut system = System::new("test");
    system.virtual_clock();
    system.deployment_from("system.toml")?;
    cell::describe(&mut system, Duration::from_secs(1), None)?;
    let report = system.run()?;
    // A loop of the file that the program lacks is no error: it is found here.
    let deployment = report.deployment.as_ref().expect("a file was named");
    let mut overrides = deployment.overrides.iter();
    assert!(overrides.all(|one| one.program.is_some()), "{deployment}");
    Ok(())
}
