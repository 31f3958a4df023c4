//! `lab exact`: wake-up latencies in instructions, held against recorded ones.

mod gate;
mod measure;
mod recorded;
mod rows;
mod table;

use crate::arch::Arch;
use crate::place::Place;
use gate::Verdict;
use recorded::Recorded;

const USAGE: &str =
    "lab exact: what is to be done? show (default), gate or record; then --seed SEED, if any";

/// Runs the command. Returns its exit code: 1 when `gate` found a latency that is too high.
///
/// # Errors
///
/// The arguments are wrong, a program cannot be built, or a guest or a row does not give figures.
pub(crate) fn command(place: &Place, arguments: &[String]) -> Result<u8, String> {
    let (words, seed) = match arguments {
        [words @ .., option, seed] if option == "--seed" => {
            let seed = seed
                .parse()
                .map_err(|_| format!("lab exact: --seed {seed}: no number"));
            (words, seed?)
        }
        words => (words, 1),
    };
    let what = match words {
        [] => "show",
        [what] if matches!(what.as_str(), "show" | "gate" | "record") => what.as_str(),
        _ => return Err(USAGE.to_owned()),
    };
    if let Some(reason) = hindrance(place) {
        println!("skipped: exact latencies: {reason}");
        return Ok(u8::from(what != "gate"));
    }
    let recorded = Recorded::load()?;
    let measured = measure::all(place, seed)?;
    table::print(&measured, &recorded);
    println!();
    match what {
        "record" => {
            measured.save()?;
            println!("recorded in {}", recorded::path().display());
            Ok(0)
        }
        "gate" => Ok(u8::from(!is_passed(&measured, &recorded))),
        _ => Ok(0),
    }
}

/// Why there are no figures on this machine.
fn hindrance(place: &Place) -> Option<String> {
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        return Some(
            "the figures are those of x86-64 programs, which this machine does not build"
                .to_owned(),
        );
    }
    place.hindrance(Arch::Amd64)
}

fn is_passed(measured: &Recorded, recorded: &Recorded) -> bool {
    if let Some(reason) = recorded.is_of_another(measured) {
        println!("not judged: {reason}");
        return true;
    }
    let rows = rows::all();
    let verdict = |row: &rows::Row| {
        let now = measured.figures.get(row.name)?;
        let old = recorded.figures.get(row.name).copied();
        Some(Verdict::of(old, *now, row.longest))
    };
    let verdicts: Vec<_> = rows.rows().filter_map(verdict).collect();
    let failures = verdicts
        .iter()
        .filter(|verdict| verdict.is_failure())
        .count();
    if failures > 0 {
        println!(
            "{failures} rows changed. If that is meant: cargo run -p luna-lab -- exact record"
        );
    }
    println!("{} passed, {failures} failed", verdicts.len() - failures);
    failures == 0
}
