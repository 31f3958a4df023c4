//! The same system on a virtual clock: time jumps to the next slot as soon as nothing can run. So
//! an hour takes seconds, and each run is the same.

use super::*;

const MINUTE: Duration = Duration::from_secs(60);

#[test]
fn each_slot_has_its_cycle() -> luna::Result<()> {
    let mut system = System::new("test");
    system.virtual_clock();
    describe(&mut system, MINUTE)?;
    let report = system.run()?;
    let control = &report.loops["control"];
    let slots = (MINUTE.as_nanos() / PERIOD.as_nanos()) as u64;
    assert_eq!((control.cycles, control.missed), (slots, 0));
    assert_eq!(report.elapsed, MINUTE);
    Ok(())
}

/// A name in it that the program lacks, or a value out of its range, fails here and not on the
/// machine.
#[test]
fn the_system_file_fits_the_program() -> luna::Result<()> {
    let mut system = System::new("test");
    system.virtual_clock();
    system.deployment_from("system.toml")?;
    describe(&mut system, Duration::from_secs(1))?;
    let report = system.run()?;
    // A loop of the file that the program lacks is no error: it is found here.
    let deployment = report.deployment.as_ref().expect("a file was named");
    let mut overrides = deployment.overrides.iter();
    assert!(overrides.all(|one| one.program.is_some()), "{deployment}");
    assert!(report.loops["control"].cycles > 0);
    Ok(())
}
