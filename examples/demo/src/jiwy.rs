//! `luna demo`: Jiwy, the thesis' pan-tilt camera, with a simulated mechanism.

use crate::failure::{Failure, failed, unusable};
use crate::output::{Axis, Demo, FinalState, TrackingError};
use crate::print::print;
use crate::{args, card, exit, output, place, replay, report, table, text};
use luna::Report;
use luna::log::{FileSink, Logging, Sink, Tee};
use luna::prelude::*;
use luna_command::alloc::Counting;
use luna_command::place::Placement;
use luna_jiwy::joystick::Recording;
use luna_jiwy::network::LOOP;
use luna_jiwy::{AXES, Executors, Findings, Settings, Start, network};
use luna_plants::MotorState;
use luna_scope::Scope;
use std::net::SocketAddr;
use std::path::Path;
use std::process::ExitCode;

const CONTROL: &str = "control";

/// Runs the demo, prints its results, and gives the exit code.
pub(crate) fn run(arguments: &args::Demo, allocator: &Counting) -> Result<ExitCode, Failure> {
    if let Some(path) = &arguments.replay {
        return replay::replay(path, arguments).map(exit::of_a_run);
    }
    let recording = match &arguments.joystick {
        Some(path) if !crate::joystick::is_device(path) => {
            let read = Recording::read(path);
            read.map_err(|error| unusable(format_args!("joystick {}", path.display()), error))?
        }
        _ => Recording::built_in(),
    };
    let settings = Settings {
        period: arguments.period(),
        cycles: arguments.cycles(),
        start: match arguments.calibrated {
            true => Start::Calibrated,
            false => Start::Calibrate,
        },
        joystick: recording.play(),
    };

    let mut system = System::new("jiwy");
    system.lock_memory();
    if arguments.on_virtual_clock {
        system.virtual_clock();
    }
    replay::record(&mut system, arguments);
    set_parameters(&mut system, arguments)?;
    let shown = Show {
        log: arguments.log.as_deref(),
        replaces: arguments.replace,
        scope: arguments.scope,
        scope_token: arguments.scope_token,
        picture: None,
        #[cfg(feature = "foxglove")]
        foxglove: arguments.foxglove,
    };
    let watched = watch(&mut system, shown)?;
    let executors = executors(&mut system, &arguments.place)?;
    if let Some(path) = &arguments.joystick
        && crate::joystick::is_device(path)
    {
        crate::joystick::follow(&mut system, &executors.operator, path)?;
    }
    let (registers, machine) = card::machine(
        arguments.card.as_ref(),
        &mut system,
        &executors.mechanism,
        settings.period,
        arguments.place.policy,
    )?;
    let findings = network::build(&executors, registers, settings)?;
    drop(executors);

    let report = system.run();
    watched.ended(&report);
    let mut report = report?;
    let demo = Demo {
        measurement: report::measurement(&report, CONTROL, &[LOOP], allocator.counts()),
        table_4: table::row(&report, arguments.rate, CONTROL),
        record: replay::recorded(arguments, report.record.as_ref()),
        axes: AXES
            .iter()
            .zip(findings.iter().zip(machine.states()))
            .map(|(axis, (findings, state))| found(axis.name, findings, state))
            .collect(),
    };

    print(arguments.place.json, &demo, || {
        let head = format!(
            "Jiwy, pan and tilt at {} Hz for {} s: ",
            arguments.rate, arguments.seconds
        );
        report::clear_shortfalls(&mut report);
        let table_4 = demo.table_4.as_ref().filter(|_| arguments.table_4);
        let table_4 =
            table_4.map(|row| table::text(row, arguments.on_virtual_clock, report.really_elapsed));
        let parts = [
            luna_jiwy::verdict(&report, LOOP),
            head + &text::header(&demo.measurement),
            report.to_string(),
        ];
        parts.into_iter().chain(table_4).chain([
            output::tracking(&demo.axes),
            text::latency(LOOP, report::latencies(&report, LOOP)),
            replay::text(demo.record.as_ref())
                + &text::memory(&demo.measurement)
                + &machine.card()
                + text::ending(&demo.measurement),
        ])
    })?;
    let has_missed = report.loops.get(LOOP).is_some_and(|timer| timer.missed > 0);
    let is_recorded = exit::is_recorded(&report);
    Ok(match demo.measurement.complete && is_recorded {
        true if arguments.strict && has_missed => ExitCode::from(args::SLOTS_MISSED),
        complete => exit::of_a_run(complete),
    })
}

/// The gains, where they are to be others than those that the controllers are made with.
fn set_parameters(system: &mut System, arguments: &args::Demo) -> luna::Result<()> {
    if let Some(file) = &arguments.parameters {
        system.parameters_from(file);
    }
    for assignment in &arguments.set {
        system.set_parameter_text(assignment)?;
    }
    Ok(())
}

/// Where a run is to be shown.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Show<'a> {
    pub(crate) log: Option<&'a Path>,
    /// The log may replace a file.
    pub(crate) replaces: bool,
    pub(crate) scope: Option<SocketAddr>,
    pub(crate) scope_token: bool,
    /// What the scope shows beside the signals.
    pub(crate) picture: Option<&'static str>,
    #[cfg(feature = "foxglove")]
    pub(crate) foxglove: Option<SocketAddr>,
}

/// What shows a run while it lasts.
#[derive(Default)]
pub(crate) struct Watched {
    scope: Option<Scope>,
    #[cfg(feature = "foxglove")]
    _foxglove: Option<luna_foxglove::Foxglove>,
}

impl Watched {
    /// The run has ended so.
    pub(crate) fn ended(&self, report: &luna::Result<Report>) {
        if let Some(scope) = &self.scope {
            scope.ended(match report {
                Ok(report) => format!("{} after {:.1} s", report.end, report.elapsed.as_secs_f64()),
                Err(error) => error.to_string(),
            });
        }
    }
}

/// Records the run to a file, and shows it in the browser and in Foxglove, on request.
pub(crate) fn watch(system: &mut System, show: Show<'_>) -> Result<Watched, Failure> {
    let mut watched = Watched::default();
    system.announce();
    // The file is the first, so that it decides what is recorded.
    let mut sinks = None;
    if let Some(path) = show.log {
        let file = match show.replaces {
            true => FileSink::replace(path),
            false => FileSink::create(path),
        };
        sinks = Some(and(sinks, file.map_err(failed(path))?));
    }
    if let Some(address) = show.scope {
        let parameters = system.parameters();
        let scope = crate::scope::of_demo(address, parameters, show)?;
        // Without the token, which is for the viewer that was given it.
        let url = scope.url();
        let open = url.split(['?', '#']).next().unwrap_or(&url);
        system.announce_address("scope", open);
        let sink = scope.sink();
        sinks = Some(and(sinks, sink.map_err(crate::scope::unserved(address))?));
        watched.scope = Some(scope);
    }
    #[cfg(feature = "foxglove")]
    if let Some(address) = show.foxglove {
        let foxglove = luna_foxglove::Foxglove::open(address)
            .map_err(|error| unusable(format_args!("--foxglove {address}"), error))?;
        use std::io::Write;
        let _ = writeln!(std::io::stderr(), "foxglove: {}", foxglove.url());
        sinks = Some(and(sinks, foxglove.sink()));
        watched._foxglove = Some(foxglove);
    }
    if let Some(sinks) = sinks {
        // Some 400 events a cycle: room for half a second in which the recorder does not get to
        // run.
        system.log(Logging::to_sink(sinks).room_for_events(1 << 18));
    }
    Ok(watched)
}

fn and(sinks: Option<Tee>, sink: impl Sink + 'static) -> Tee {
    match sinks {
        None => Tee::new(sink),
        Some(sinks) => sinks.and(sink),
    }
}

/// The control executor as asked for; the hardware below it, where the system likes; the operator
/// with no promise at all.
pub(crate) fn executors(system: &mut System, arguments: &Placement) -> luna::Result<Executors> {
    let control = place::executor(system, CONTROL, arguments)?;
    // Real hardware is never late, but it must not make the measured loops late either.
    let below = |priority: u8| priority.saturating_sub(1).max(1);
    let policy = match arguments.policy {
        Policy::Fifo(priority) => Policy::Fifo(below(priority)),
        Policy::RoundRobin(priority) => Policy::RoundRobin(below(priority)),
        other => other,
    };
    let mechanism = system.executor("mechanism").policy(policy).build()?;
    let operator = system.executor("operator").policy(Policy::Other).build()?;
    Ok(Executors {
        control,
        mechanism,
        operator,
    })
}

/// What the processes of an axis left behind. There is no tracking error where none was measured:
/// the run may end before the calibration does.
fn found(name: &'static str, findings: &Findings, state: MotorState) -> Axis {
    let tracking = findings.tracking.get();
    let measured = tracking.filter(|tracking| tracking.samples() > 0);
    Axis {
        name,
        tracking_error_deg: measured.map(|tracking| TrackingError {
            rms: tracking.rms().to_degrees(),
            max: tracking.max().to_degrees(),
        }),
        final_state: FinalState {
            angle_deg: state.angle.to_degrees(),
            speed_deg_per_s: state.speed.to_degrees(),
            current_a: state.current,
        },
        sanity: findings.interventions().into(),
    }
}
