//! `luna demo head`: the humanoid head follows a target.

use crate::failure::Failure;
use crate::machine::{self, Apart, heading};
use crate::{columns, report};
use clap::{Args, ValueEnum};
use luna::Report;
use luna::prelude::*;
use luna_command::alloc::Counting;
use luna_command::output::Measurement;
use luna_head::parameters::{HEAD, axis_named};
use luna_head::{Fault, Findings, PICTURE, Place, Settings, Trouble, network};
use serde::Serialize;
use std::net::SocketAddr;
use std::process::ExitCode;
use std::time::Duration;

/// The executor of all but vision.
const EXECUTOR: &str = "head";

/// The options of `luna demo head`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
Exit codes: 0 the gaze settled and held as it is to, and no limit was exceeded, 1 not so, or it failed, 2 bad arguments or files.

JSON: deployment, faults, gaze_rms and gaze_worst (degrees), held_drift, stopped_at, stopped_after, duty, changed, axes, seconds; the loops and the rest of `luna demo`.")]
pub(crate) struct Arguments {
    /// Where vision runs: on the head's executor below all else, on a thread that is not real-time,
    /// or as a program
    #[arg(long, value_name = "WHERE", default_value = "threads")]
    deploy: Deployment,
    /// Where vision listens, on another computer: `luna demo head-vision --listen ADDR` there
    #[arg(long, value_name = "ADDR", conflicts_with_all = ["deploy", "on_virtual_clock"])]
    vision: Option<SocketAddr>,
    /// How long the head runs, in seconds
    #[arg(long, value_name = "S", default_value = "10", value_parser = luna_command::values::seconds, allow_negative_numbers = true)]
    seconds: f64,
    /// A fault after two fifths of the time: vision (no image comes, for a fifth of the time),
    /// jump (the target jumps), or sensor-AXIS (the encoder stands). AXIS is neck-lower-tilt,
    /// neck-pan, neck-roll, neck-upper-tilt, eyes-tilt, left-eye-pan or right-eye-pan
    #[arg(long, value_name = "FAULT", value_parser = fault)]
    fault: Vec<Fault>,
    /// The scheduling policy of all but vision: fifo:PRIORITY, rr:PRIORITY (1 to 97) or other
    #[arg(long, default_value = "fifo:80", value_parser = luna_command::values::policy)]
    policy: Policy,
    #[command(flatten)]
    common: machine::Options,
}

/// Where vision runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Deployment {
    /// All on one executor
    Executor,
    /// Vision on a thread of its own
    Threads,
    /// Vision as a program of its own
    Programs,
}

/// The options of `luna demo head-vision`.
#[derive(Debug, Clone, Args)]
pub(crate) struct VisionArguments {
    /// Where to listen for the head; ADDR is host:port
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:0")]
    listen: SocketAddr,
    /// End with the program that started it
    #[arg(long, hide = true)]
    child: bool,
}

fn fault(text: &str) -> Result<Fault, String> {
    match text.split_once('-') {
        None if text == "vision" => Ok(Fault::Vision),
        None if text == "jump" => Ok(Fault::Jump),
        Some(("sensor", axis)) => axis_named(axis).map(Fault::Sensor).ok_or_else(|| {
            let names = HEAD.each_ref().map(|axis| axis.name).join(", ");
            format!("there is no axis {axis:?}; the axes are {names}")
        }),
        _ => Err("it must be vision, jump or sensor-AXIS".into()),
    }
}

/// What is printed.
#[derive(Debug, Serialize)]
struct Run {
    deployment: Deployment,
    #[serde(flatten)]
    findings: Findings,
    #[serde(flatten)]
    measurement: Measurement,
}

/// Runs the head, prints what became of it, and gives the exit code.
pub(crate) fn run(arguments: &Arguments, allocator: &Counting) -> Result<ExitCode, Failure> {
    let time = Duration::from_secs_f64(arguments.seconds);
    let troubles = arguments.fault.iter().map(|fault| Trouble {
        fault: *fault,
        at: time * 2 / 5,
        lasts: time / 5,
    });
    let mut program = None;
    let place = match (arguments.vision, arguments.deploy) {
        (Some(address), _) => Place::Program(address),
        (None, Deployment::Executor) => Place::Executor,
        (None, Deployment::Threads) => Place::Threads,
        (None, Deployment::Programs) => {
            arguments.common.needs_real_clock()?;
            let vision = Apart::start(&["head-vision", "--child"])?;
            Place::Program(program.insert(vision).address)
        }
    };
    let settings = Settings {
        time,
        troubles: troubles.collect(),
        policy: arguments.policy,
        place,
    };
    let (machine, report) = arguments.common.run("head", PICTURE, |system| {
        network::build(system, settings).map_err(Failure::Luna)
    })?;
    drop(program);
    let findings = machine.findings();
    let findings = findings.ok_or_else(|| machine::too_early(&report))?;
    let run = Run {
        deployment: match arguments.vision {
            Some(_) => Deployment::Programs,
            None => arguments.deploy,
        },
        findings,
        measurement: report::measurement(&report, EXECUTOR, &network::LOOPS, allocator.counts()),
    };
    let is_good = run.findings.is_good();
    let text = || text(&run, &report);
    arguments.common.print(&run, &report, text, is_good)
}

/// Runs vision until it is asked to end.
pub(crate) fn run_vision(arguments: &VisionArguments) -> Result<ExitCode, Failure> {
    let system = machine::system_of_a_part("vision", arguments.child);
    let listens = |address| machine::print_address("vision", address);
    let served = network::serve_vision(system, arguments.listen, listens);
    served.map(|()| ExitCode::SUCCESS).map_err(Failure::Luna)
}

fn text(run: &Run, report: &Report) -> [String; 3] {
    let findings = &run.findings;
    let mut verdict = match &findings.gaze_rms.zip(findings.gaze_worst) {
        Some((rms, worst)) => format!("gaze error {rms:.2} degrees rms, {worst:.2} at most"),
        None => format!(
            "too short to settle: {:.1} s are needed",
            luna_head::parameters::SETTLE
        ),
    };
    if let Some(drift) = findings.held_drift {
        verdict += &format!("; held within {drift:.2} degrees without images");
    }
    match (findings.stopped_after, findings.stopped_at) {
        (Some(after), _) => verdict += &format!("; stopped {after:.2} s after the sensor's fault"),
        (None, Some(at)) => verdict += &format!("; stopped at {at:.2} s without cause"),
        (None, None) => {}
    }
    let head = heading(
        "Humanoid head",
        findings.seconds,
        &findings.faults,
        findings.is_good(),
    );
    let rows = findings.axes.iter().map(|axis| {
        [
            axis.name.to_owned(),
            format!("{:.1}°", axis.furthest),
            format!("{:.1}°", axis.end_stop),
        ]
    });
    let axes = columns::of_numbers(["axis", "furthest", "stop"], rows);
    [head + &verdict + "\n", axes, report.to_string()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_head::outcome;

    #[test]
    fn faults_are_named_as_they_are_reported() {
        for text in ["vision", "jump", "sensor-neck-roll", "sensor-eyes-tilt"] {
            assert_eq!(outcome::name(fault(text).unwrap()), text);
        }
        for (text, says) in [("sensor-nose", "neck-pan"), ("deaf", "sensor-AXIS")] {
            let error = fault(text).unwrap_err();
            assert!(error.contains(says), "{text}: {error}");
        }
    }
}
