//! `luna doctor`: whether this machine is fit for hard real time, and what to do about what is not.

mod checks;
mod diagnosis;
mod facts;
mod finding;
mod machine;
mod measure;
mod self_test;
mod table;
#[cfg(test)]
mod tests;

use crate::args;
use crate::failure::{Failure, unusable};
use crate::print::print;
use crate::progress::Progress;
use diagnosis::Diagnosis;
use facts::cpu_time::{CpuTime, cpu_time};
use finding::Finding;
use luna_machine::facts::Source;
use luna_machine::facts::parse::write_core_list;
use machine::Machine;
use std::process::ExitCode;
use std::time::Duration;

/// The time for each measurement: five of them, in about a second and a half.
const EACH: Duration = Duration::from_millis(300);
/// The same with `--quick`.
const EACH_QUICK: Duration = Duration::from_millis(40);

/// Examines, prints, and gives the exit code.
pub(crate) fn run(arguments: &args::Doctor) -> Result<ExitCode, Failure> {
    let source = match &arguments.root {
        // With a missing folder everything would be unknown: it is a mistake of the user.
        Some(root) if !root.is_dir() => {
            let root = root.display();
            return Err(unusable(
                format_args!("--root {root}"),
                "there is no such folder",
            ));
        }
        Some(root) => Source::folder(root),
        None => Source::machine(),
    };
    let machine = Machine::new(source, arguments.core);
    if let (Some(core), Ok(online)) = (arguments.core, machine.online())
        && !online.contains(&core)
    {
        let why = format!("the machine has the cores {}", write_core_list(&online));
        return Err(unusable(format_args!("--core {core}"), why));
    }

    let mut findings = look(&machine);
    // Another machine's files do not show how fast this one is.
    if machine.source.is_machine() {
        let mut progress = Progress::new();
        if !arguments.no_measure {
            progress.say("measuring this machine");
            let measured = measure(&machine, arguments.quick, &mut findings);
            findings.extend(measured);
        }
        if !arguments.no_self_test {
            progress.say("testing the library on this machine");
            findings.extend(self_test::run_all());
        }
    }
    let diagnosis = Diagnosis::of(findings, &machine);

    let text = || [table::draw(&diagnosis, arguments.explain)];
    print(arguments.json, &diagnosis, text)?;
    Ok(ExitCode::from(diagnosis.exit_code))
}

/// The findings of all files.
fn look(machine: &Machine) -> Vec<Finding> {
    checks::all().map(|check| check.find(machine)).collect()
}

/// All that is measured. The steal meanwhile replaces that since the start.
fn measure(machine: &Machine, quick: bool, looked: &mut [Finding]) -> Vec<Finding> {
    let time = || machine.source.parse("/proc/stat", cpu_time).ok();
    let before = time();
    let measured = measure::all(machine, if quick { EACH_QUICK } else { EACH });
    if let (Some(before), Some(after)) = (before, time()) {
        note_steal(looked, after.since(before));
    }
    measured
}

fn note_steal(looked: &mut [Finding], meanwhile: CpuTime) {
    let steal = looked.iter_mut().find(|finding| finding.name == "steal");
    // No tick has passed in a very short measurement.
    if let (Some(finding), Some(share)) = (steal, meanwhile.stolen_share()) {
        let seen = checks::steal_seen(share, "while it was measured");
        finding.read = format!("{}; {}", seen.read, finding.read);
        // The worse of both: now, or at other times.
        if seen.verdict > finding.verdict {
            finding.verdict = seen.verdict;
            finding.advice = seen.advice;
        }
    }
}
