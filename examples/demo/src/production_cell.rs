//! `luna demo production-cell`: six units in a circle, in the deployment that is asked for.

use crate::columns;
use crate::failure::Failure;
use crate::machine;
use clap::{Args, ValueEnum};
use luna::Report;
use luna::prelude::*;
use luna_command::result_file;
use luna_production_cell::deploy::{self, Place, Program};
use luna_production_cell::{Breakage, Drill, Outcome, Plan, Settings, Unit, picture};
use serde::Serialize;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

/// The options of `luna demo production-cell`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
Exit codes: 0 no block was lost or doubled and nothing collided, 1 something was, or it failed, 2 bad arguments or files.

JSON: deployment, faults, blocks (rounds that blocks have completed), lost, doubled, collisions, at_rest, seconds, units, marks.")]
pub(crate) struct Arguments {
    /// Where the units run
    #[arg(long, value_name = "WHERE", default_value = "executor")]
    deploy: Deployment,
    /// How long the line runs, in seconds
    #[arg(long, value_name = "S", default_value = "20", value_parser = luna_command::values::seconds, allow_negative_numbers = true)]
    seconds: f64,
    /// A fault after two fifths of the time, repaired after a fifth: stuck-UNIT (the axis does not
    /// move), sensor-UNIT (its position sensor is broken) or kill-UNIT (its program is killed and
    /// started again; where it has no program of its own, it is dead as if it were). UNIT is
    /// feeder-belt, feeder, moulder-door, extractor, extraction-belt or robot. Several --fault
    /// share the time
    #[arg(long, value_name = "FAULT", value_parser = fault)]
    fault: Vec<Fault>,
    /// Exchange the control laws of all units each so many seconds
    #[arg(long, value_name = "S", default_value = "5", value_parser = luna_command::values::seconds, allow_negative_numbers = true)]
    exchange: f64,
    /// Draw the time line of the units (SVG)
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// The scheduling policy of the units: fifo:PRIORITY, rr:PRIORITY (1 to 97) or other
    #[arg(long, default_value = "fifo:80", value_parser = luna_command::values::policy)]
    policy: Policy,
    #[command(flatten)]
    common: machine::Options,
}

/// Where the units run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Deployment {
    /// On one executor
    Executor,
    /// On six threads
    Threads,
    /// As six programs
    Programs,
    /// On six hosts: network namespaces of this computer. Needs root, and the feature hosts
    Hosts,
}

/// One unit as a program.
#[derive(Debug, Clone, Args)]
pub(crate) struct UnitArguments {
    #[arg(long, value_parser = luna_command::values::policy)]
    policy: Policy,
    #[arg(value_parser = unit)]
    unit: Unit,
    /// The cell's name; on a host, its network's number
    cell: String,
    world: PathBuf,
    /// On a host of its own
    #[cfg(feature = "hosts")]
    #[arg(long)]
    host: bool,
}

/// What breaks where.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
struct Fault {
    breakage: Breakage,
    unit: Unit,
}

fn unit(text: &str) -> Result<Unit, String> {
    Unit::named(text).ok_or_else(|| {
        let names = Unit::ALL.map(Unit::name).join(", ");
        format!("there is no unit {text:?}; the units are {names}")
    })
}

fn fault(text: &str) -> Result<Fault, String> {
    let (breakage, of) = text.split_once('-').unwrap_or((text, ""));
    let breakage = match breakage {
        "stuck" => Breakage::Stuck,
        "sensor" => Breakage::Sensor,
        "kill" => Breakage::Kill,
        _ => return Err("it must be stuck-UNIT, sensor-UNIT or kill-UNIT".into()),
    };
    let unit = unit(of)?;
    Ok(Fault { breakage, unit })
}

/// What is printed.
#[derive(Debug, Serialize)]
struct Run {
    deployment: Deployment,
    faults: Vec<Fault>,
    #[serde(flatten)]
    outcome: Outcome,
}

/// Runs the cell, prints its outcome, and gives the exit code.
pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let place = match arguments.deploy {
        Deployment::Executor => Some(Place::Executor),
        Deployment::Threads => Some(Place::Threads),
        Deployment::Programs => None,
        Deployment::Hosts if cfg!(feature = "hosts") => None,
        Deployment::Hosts => {
            return Err(Failure::Options(
                "--deploy hosts: `luna-demo` was built without the feature `hosts`, which brings a \
                 network library: `cargo run --release -p luna-demo --features hosts -- production-cell \
                 --deploy hosts`; --deploy programs runs the same units as six programs",
            ));
        }
    };
    let common = &arguments.common;
    let of_one_program = common.on_virtual_clock || common.log.is_some() || common.scope.is_some();
    if place.is_none() && of_one_program {
        return Err(Failure::Options(
            "--deploy programs and hosts: --virtual, --log and --scope are for units within this program; \
             use --deploy executor or threads",
        ));
    }
    let time = Duration::from_secs_f64(arguments.seconds);
    let share = time / arguments.fault.len().max(1) as u32;
    let drills = arguments.fault.iter().zip(0..).map(|(fault, n)| Drill {
        unit: fault.unit,
        fault: fault.breakage,
        at: share * n + share * 2 / 5,
        lasts: share / 5,
    });
    let settings = Settings {
        plan: Plan {
            time,
            exchange: Some(Duration::from_secs_f64(arguments.exchange)),
            drills: drills.collect(),
        },
        policy: arguments.policy,
        heeds_neighbours: true,
    };
    let (cell, report) = arguments
        .common
        .run("production cell", picture::CELL, |system| {
            let cell = match (place, arguments.deploy) {
                (Some(place), _) => deploy::in_one_program(system, place, settings),
                #[cfg(feature = "hosts")]
                (None, Deployment::Hosts) => {
                    deploy::on_six_hosts(system, this_program(arguments)?, settings)
                }
                (None, _) => deploy::in_six_programs(system, this_program(arguments)?, settings),
            };
            cell.map_err(Failure::Luna)
        })?;
    let run = Run {
        deployment: arguments.deploy,
        faults: arguments.fault.clone(),
        outcome: cell.outcome(),
    };
    if let Some(path) = &arguments.picture {
        let svg = picture::svg(&run.outcome, &title(&run));
        result_file::write(path, &svg, arguments.common.replace)?;
    }
    let is_good = run.outcome.is_good();
    let text = || text(&run, &report);
    arguments.common.print(&run, &report, text, is_good)
}

/// Runs one unit.
pub(crate) fn run_unit(arguments: &UnitArguments) -> Result<ExitCode, Failure> {
    let UnitArguments {
        policy,
        unit,
        cell,
        world,
        ..
    } = arguments;
    #[cfg(feature = "hosts")]
    if arguments.host {
        let subnet = cell.parse().map_err(luna::Error::other)?;
        let ran = deploy::run_unit_on_host(*unit, subnet, world, *policy);
        return ran.map(|()| ExitCode::SUCCESS).map_err(Failure::Luna);
    }
    deploy::run_unit(*unit, cell, world, *policy)?;
    Ok(ExitCode::SUCCESS)
}

fn this_program(arguments: &Arguments) -> Result<Program, Failure> {
    let file = std::env::current_exe().map_err(luna::Error::from)?;
    let policy = arguments.policy.to_string();
    let mut words = vec!["production-cell-unit", "--policy", &policy];
    if let Deployment::Hosts = arguments.deploy {
        words.push("--host");
    }
    let arguments = words.into_iter().map(str::to_owned).collect();
    Ok(Program { file, arguments })
}

fn title(run: &Run) -> String {
    let place = match run.deployment {
        Deployment::Executor => "on one executor",
        Deployment::Threads => "on six threads",
        Deployment::Programs => "as six programs",
        Deployment::Hosts => "on six hosts",
    };
    let faults = run.faults.iter().map(|Fault { breakage, unit }| {
        let unit = unit.name().replace('-', " ");
        match breakage {
            Breakage::Stuck => format!("the {unit} is stuck"),
            Breakage::Sensor => format!("the position sensor of the {unit} is broken"),
            Breakage::Kill => format!("the {unit} is killed"),
        }
    });
    let faults: Vec<String> = faults.collect();
    let colon = if faults.is_empty() { "" } else { ": " };
    format!("Production Cell, {place}{colon}{}", faults.join(", "))
}

fn text(run: &Run, report: &Report) -> [String; 3] {
    let outcome = &run.outcome;
    let Outcome {
        blocks,
        lost,
        doubled,
        collisions,
        ..
    } = outcome;
    let verdict = format!(
        "{}: blocks completed {blocks} rounds, {lost} lost, {doubled} doubled, {collisions} collisions\n{}",
        title(run),
        if outcome.at_rest {
            ""
        } else {
            "not all units came to rest\n"
        },
    );
    let rows = outcome.units.iter().map(|unit| {
        [
            unit.name.name().to_owned(),
            unit.taken.to_string(),
            unit.given.to_string(),
            unit.blocks.len().to_string(),
            unit.stops.to_string(),
        ]
    });
    let units = columns::of_numbers(["unit", "taken", "given", "blocks", "stops"], rows);
    [verdict, units, report.to_string()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_named_by_kind_and_unit() {
        let breakage = Breakage::Kill;
        let unit = Unit::ExtractionBelt;
        assert_eq!(fault("kill-extraction-belt"), Ok(Fault { breakage, unit }));
        for (text, says) in [
            ("stuck", "feeder-belt"),
            ("burn-feeder", "stuck-UNIT"),
            ("", "kill-UNIT"),
        ] {
            let error = fault(text).unwrap_err();
            assert!(error.contains(says), "{text}: {error}");
        }
    }
}
