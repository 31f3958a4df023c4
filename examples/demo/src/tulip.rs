//! `luna demo tulip`: the robot walks behind a ball.

use crate::failure::Failure;
use crate::machine::{self, Apart, heading};
use crate::{columns, report};
use clap::{Args, ValueEnum};
use luna::Report;
use luna::prelude::*;
use luna_command::alloc::Counting;
use luna_command::output::Measurement;
use luna_tulip::messages::Shown;
use luna_tulip::network::Orders;
use luna_tulip::parameters::{ROBOT, joint_named};
use luna_tulip::{Fault, Findings, PICTURE, Place, Settings, Trouble, network};
use serde::Serialize;
use std::io::Write;
use std::net::SocketAddr;
use std::process::ExitCode;
use std::time::Duration;

/// The executor of the hard and firm layers.
const EXECUTOR: &str = "tulip";

/// The options of `luna demo tulip`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
Exit codes: 0 it walked and did not fall, its controllers were exchanged, no actuator passed its limit, and safety stopped it
if and only if a joint failed; 1 not so, or it failed, 2 bad arguments or files.

JSON: deployment, faults, steps, steps_expected, distance (m), fallen_at, capture_margin (m), exchanges, exchanges_asked,
lost (slots of the joint loop missed right after an exchange), duty, changed, stopped_at, stopped_after, joints, shown, seconds; the loops and the rest of `luna demo`.")]
pub(crate) struct Arguments {
    /// Where the layers run: all on one executor, the world model and the operator on threads that
    /// are not real-time, or the operator as a program
    #[arg(long, value_name = "WHERE", default_value = "threads")]
    deploy: Deployment,
    /// Where the operator listens, on another computer: `luna demo tulip-operator --listen ADDR`
    /// there
    #[arg(long, value_name = "ADDR", conflicts_with_all = ["deploy", "on_virtual_clock"])]
    operator: Option<SocketAddr>,
    /// How long the robot runs, in seconds; it stands at the begin and at the end
    #[arg(long, value_name = "S", default_value = "10", value_parser = luna_command::values::seconds, allow_negative_numbers = true)]
    seconds: f64,
    /// Exchange all joint controllers each so many seconds
    #[arg(long, value_name = "S", default_value = "1", value_parser = luna_command::values::seconds, allow_negative_numbers = true)]
    exchange: f64,
    /// A fault after two fifths of the time: push (the robot is pushed), sensor-JOINT (the encoder
    /// stands) or controller-JOINT (its controller wants full duty). JOINT is left-shoulder,
    /// right-shoulder, or left- or right- with hip-yaw, hip-roll, hip-pitch, knee, ankle-pitch or
    /// ankle-roll
    #[arg(long, value_name = "FAULT", value_parser = fault)]
    fault: Vec<Fault>,
    /// The scheduling policy of the hard and firm layers: fifo:PRIORITY, rr:PRIORITY (1 to 97) or
    /// other
    #[arg(long, default_value = "fifo:80", value_parser = luna_command::values::policy)]
    policy: Policy,
    #[command(flatten)]
    common: machine::Options,
}

/// Where the layers run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Deployment {
    /// All on one executor
    Executor,
    /// The world model and the operator on threads of their own
    Threads,
    /// So, and the operator as a program of its own
    Programs,
}

/// The options of `luna demo tulip-operator`.
#[derive(Debug, Clone, Args)]
pub(crate) struct OperatorArguments {
    /// Where to listen for the robot; ADDR is host:port
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:0")]
    listen: SocketAddr,
    /// The robot is to walk until then by its own time, in seconds
    #[arg(long, value_name = "S", default_value = "7.5", value_parser = luna_command::values::seconds, allow_negative_numbers = true)]
    walk_until: f64,
    /// Exchange all joint controllers each so many seconds
    #[arg(long, value_name = "S", default_value = "1", value_parser = luna_command::values::seconds, allow_negative_numbers = true)]
    exchange: f64,
    /// End with the program that started it
    #[arg(long, hide = true)]
    child: bool,
}

fn fault(text: &str) -> Result<Fault, String> {
    let joint = |name: &str| {
        joint_named(name).ok_or_else(|| {
            let names = ROBOT.each_ref().map(|joint| joint.name).join(", ");
            format!("there is no joint {name:?}; the joints are {names}")
        })
    };
    match text.split_once('-') {
        None if text == "push" => Ok(Fault::Push),
        Some(("sensor", name)) => joint(name).map(Fault::Sensor),
        Some(("controller", name)) => joint(name).map(Fault::Controller),
        _ => Err("it must be push, sensor-JOINT or controller-JOINT".into()),
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

/// Runs the robot, prints what became of it, and gives the exit code.
pub(crate) fn run(arguments: &Arguments, allocator: &Counting) -> Result<ExitCode, Failure> {
    let time = Duration::from_secs_f64(arguments.seconds);
    let at = time * 2 / 5;
    let troubles = arguments.fault.iter().copied();
    let mut settings = Settings {
        time,
        exchange: Duration::from_secs_f64(arguments.exchange),
        troubles: troubles.map(|fault| Trouble { fault, at }).collect(),
        policy: arguments.policy,
        place: Place::Threads,
    };
    let mut program = None;
    settings.place = match (arguments.operator, arguments.deploy) {
        (Some(address), _) => Place::Program(address),
        (None, Deployment::Executor) => Place::Executor,
        (None, Deployment::Threads) => Place::Threads,
        (None, Deployment::Programs) => {
            arguments.common.needs_real_clock()?;
            let Orders {
                walk_until,
                exchange,
            } = settings.orders();
            let [until, each] = [walk_until, exchange].map(|seconds| seconds.to_string());
            let words = ["tulip-operator", "--child", "--walk-until", &until];
            let operator = Apart::start(&[&words[..], &["--exchange", &each]].concat())?;
            Place::Program(program.insert(operator).address)
        }
    };
    let (machine, report) = arguments.common.run("tulip", PICTURE, |system| {
        network::build(system, settings).map_err(Failure::Luna)
    })?;
    drop(program);
    let findings = machine.findings();
    let findings = findings.ok_or_else(|| machine::too_early(&report))?;
    let run = Run {
        deployment: match arguments.operator {
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

/// Runs the operator until it is asked to end.
pub(crate) fn run_operator(arguments: &OperatorArguments) -> Result<ExitCode, Failure> {
    let system = machine::system_of_a_part("operator", arguments.child);
    let orders = Orders {
        walk_until: arguments.walk_until,
        exchange: arguments.exchange,
    };
    let is_child = arguments.child;
    let see = move |shown: &Shown| {
        if !is_child {
            print_shown(shown);
        }
    };
    let listens = |address| machine::print_address("operator", address);
    let served = network::serve_operator(system, arguments.listen, orders, listens, see);
    served.map(|()| ExitCode::SUCCESS).map_err(Failure::Luna)
}

/// One line of what the robot shows.
fn print_shown(shown: &Shown) {
    let values = shown.values.map(|(what, value)| {
        let name = serde_json::to_value(what).unwrap_or_default();
        format!("{} {value:.3}", name.as_str().unwrap_or_default())
    });
    let mut out = std::io::stdout().lock();
    // The reader may be gone.
    let _ = writeln!(out, "{:6.1} s  {}", shown.time, values.join("  "));
}

fn text(run: &Run, report: &Report) -> [String; 3] {
    let findings = &run.findings;
    let Findings {
        seconds,
        steps,
        distance,
        exchanges,
        lost,
        ..
    } = findings;
    let mut verdict = heading("TUlip", *seconds, &findings.faults, findings.is_good());
    verdict += &format!("{steps} steps, {distance:.2} m");
    if *steps < findings.steps_expected {
        verdict += &format!(" ({} steps were to be seen)", findings.steps_expected);
    }
    if let Some(margin) = findings.capture_margin {
        let millimetres = margin * 1e3;
        verdict += &format!("; capture point {millimetres:.0} mm within its support as steps end");
    }
    verdict += &match findings.fallen_at {
        Some(at) => format!("; fallen at {at:.2} s"),
        None => "; not fallen".into(),
    };
    verdict += &format!(
        "\ncontrollers exchanged {exchanges} times, {lost} slots lost; safety changed {} duties",
        findings.changed
    );
    match (findings.stopped_after, findings.stopped_at) {
        (Some(after), _) => verdict += &format!(", and stopped {after:.2} s after the fault"),
        (None, Some(at)) => verdict += &format!(", and stopped at {at:.2} s without cause"),
        (None, None) => {}
    }
    verdict.push('\n');
    let rows = findings.joints.iter().map(|joint| {
        let [least, greatest] = joint.range.map(|angle| format!("{angle:.1}°"));
        let [low, high] = joint.stops;
        let stops = format!("{low:.0}° to {high:.0}°");
        [joint.name.to_owned(), least, greatest, stops]
    });
    let joints = columns::of_numbers(["joint", "least", "greatest", "stops"], rows);
    [verdict, joints, report.to_string()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_tulip::outcome;

    #[test]
    fn faults_are_named_as_they_are_reported() {
        for text in ["push", "sensor-left-knee", "controller-right-shoulder"] {
            assert_eq!(outcome::name(fault(text).unwrap()), text);
        }
        for (text, says) in [("sensor-tail", "left-knee"), ("trip", "sensor-JOINT")] {
            let error = fault(text).unwrap_err();
            assert!(error.contains(says), "{text}: {error}");
        }
    }
}
