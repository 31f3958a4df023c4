//! A motor axis, its possible faults, and what its safety blocks do about each. On virtual time, so
//! that each run is the same.

mod axis;

use axis::{TROUBLES, run};

fn main() -> luna::Result<()> {
    for trouble in TROUBLES {
        let outcome = run(trouble)?;
        println!(
            "{trouble:?}: at most {:.3} rad from the middle",
            outcome.furthest
        );
        for (after, cause) in &outcome.alarms {
            println!("  after {after:?}: {cause}");
        }
        match &outcome.emergency {
            Some((after, cause)) => println!("  after {after:?}, emergency: {cause}"),
            None if outcome.is_safe_state => {
                println!(
                    "  it ran to its end in a safe state, at {:.3} rad",
                    outcome.end.angle
                );
            }
            None => println!("  it ran to its end, at {:.3} rad", outcome.end.angle),
        }
        for (what, after) in [
            ("the encoders were too far apart", outcome.apart),
            ("the motor was driven hard", outcome.driven),
            ("the motor was off for good", outcome.off_since),
        ] {
            if let Some(after) = after {
                println!("  ({what} from {after:?} on)");
            }
        }
    }
    Ok(())
}
