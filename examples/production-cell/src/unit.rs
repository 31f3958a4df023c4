//! A unit of the cell: the one pattern that all six are built by.
//!
//! ```text
//!                          the operator
//!                       requests │ ^ reports
//!                                v │
//!                             command  <~~~~~~~~~~~~~ contents
//!                          orders │ ^                    ^
//!                                 v │ views              ~
//!  unit     status >~~~~~>  ╭──────────────╮  ~~~~~~> status      unit
//!  behind   <~~~~~~ status  │    safety    │  <~~~~~~ status      ahead
//!                           ╰──────────────╯             ~
//!                set-points  │ ^         │ ^             ~
//!                   readings v │ duty    v │ readings    ~
//!                         controller   mechanics ~~~~~~~~~
//!                                       ^     │
//!           blocks ─────────────────────╯     ╰─> giver ──────> blocks
//!
//!  ──> rendezvous     ~~> newest value: its sender never waits
//! ```
//!
//! | process | real time | level | runs |
//! | --- | --- | --- | --- |
//! | safety | hard | 20 | with each value that comes |
//! | controller | hard | 18 | each millisecond |
//! | mechanics, giver | the simulated machine | 15 | each millisecond, with each block |
//! | links | soft | 8 | with each value that crosses programs |
//! | command | soft | 5 | 200 times a second |
//!
//! All channels within a unit keep the newest value alone. So nothing that is soft makes safety or
//! the controller wait. Only blocks pass by rendezvous, and the giver waits for that, not the
//! mechanics.
//!
//! **The end.** The command process ends when the operator says so. Each other process ends when
//! its inputs are closed.

use crate::command;
use crate::laws::{self, Law};
use crate::links::{Links, Style};
use crate::messages::{
    Contents, Drive, Fault, Goal, Handed, Order, Report, Request, Sensors, Setpoint, Status, View,
};
use crate::parameters::{CYCLES_OF_COMMAND, CYCLES_OF_STATUS, PERIOD, Parameters, Unit};
use crate::safety::Safety;
use crate::simulation::{Simulation, World};
use luna::prelude::*;
use luna::system::Executor;
use std::path::Path;

/// Levels on the unit's executor.
mod level {
    pub(super) const SAFETY: u8 = 20;
    pub(super) const CONTROLLER: u8 = 18;
    pub(super) const MECHANICS: u8 = 15;
    pub(super) const COMMAND: u8 = 5;
}

/// The newest reports that are kept for an operator that looks seldom.
const REPORTS: Style = Style::Newest(64);
const NEWEST: Style = Style::Newest(1);
/// Commands between two reports without a change.
const COMMANDS_OF_REPORT: u32 = 4;

/// How a unit is made.
#[derive(Debug, Clone, Copy)]
pub struct Options<'a> {
    /// Whether the failures of neighbours are heeded: only a test says no.
    pub heeds_neighbours: bool,
    /// Where the mechanics' state stays when the program is killed; none: it ends with it.
    pub world: Option<&'a Path>,
}

/// The channels between a unit and the operator, at the operator's side.
#[derive(Debug)]
pub struct Panel {
    /// To the unit.
    pub requests: Sender<Request>,
    /// From the unit.
    pub reports: Receiver<Report>,
}

impl Panel {
    /// Of this unit.
    ///
    /// # Errors
    ///
    /// Those of the links.
    pub fn new(unit: Unit, links: &mut impl Links) -> luna::Result<Self> {
        let unit = unit.name();
        Ok(Self {
            requests: links.sender(&format!("operator/{unit}/requests"), NEWEST)?,
            reports: links.receiver(&format!("{unit}/operator/reports"), REPORTS)?,
        })
    }
}

/// Adds the processes of a unit to `executor`, connected by `links`.
///
/// # Errors
///
/// Those of the links, of [`spawn`](luna::system::ProcessBuilder::spawn), and of the file that the
/// mechanics' state is kept in.
pub fn build(
    unit: Unit,
    executor: &Executor,
    links: &mut impl Links,
    options: Options<'_>,
) -> luna::Result<()> {
    let name = unit.name();
    let (ahead, behind) = (unit.ahead().name(), unit.behind().name());
    let to_ahead = links.sender(&format!("{name}/{ahead}/status"), NEWEST)?;
    let to_behind = links.sender(&format!("{name}/{behind}/status"), NEWEST)?;
    let from_ahead = links.receiver(&format!("{ahead}/{name}/status"), NEWEST)?;
    let from_behind = links.receiver(&format!("{behind}/{name}/status"), NEWEST)?;
    let give = links.sender(&format!("{name}/{ahead}/blocks"), Style::Rendezvous)?;
    let take = links.receiver(&format!("{behind}/{name}/blocks"), Style::Rendezvous)?;
    let requests = links.receiver(&format!("operator/{name}/requests"), NEWEST)?;
    let reports = links.sender(&format!("{name}/operator/reports"), REPORTS)?;

    let (read, readings) = newest(name, "readings");
    let (seen, seen_readings) = newest(name, "seen readings");
    let (set, setpoints) = newest(name, "set-point");
    let (duty, duties) = newest(name, "duty");
    let (drive, drives) = newest(name, "drive");
    let (order, orders) = newest(name, "order");
    let (view, views) = newest(name, "view");
    let (show, contents) = newest(name, "contents");
    let (break_it, faults) = newest(name, "fault");
    let (offer, offers) = newest(name, "offer");
    let (given, gone) = newest(name, "given");

    let process = |part: &str, level| executor.process(format!("{name} {part}")).priority(level);
    let safety = process("safety", level::SAFETY);
    let state = safety.signal(&format!("{name}/state"));
    let state = state.description(crate::messages::CONDITIONS).register()?;
    let duty_signal = safety.signal(&format!("{name}/duty")).register()?;
    safety.spawn(keep_safe(
        Safety::new(unit, options.heeds_neighbours)?,
        (from_behind, from_ahead, readings, duties, orders),
        (to_behind, to_ahead, seen, drive, set, view),
        (state, duty_signal),
    ))?;
    process("controller", level::CONTROLLER).spawn(control(
        format!("{name} controller"),
        laws::all(unit.parameters()),
        seen_readings,
        setpoints,
        duty,
    ))?;
    let mechanics = process("mechanics", level::MECHANICS);
    let position = mechanics.signal(&format!("{name}/position"));
    let position = position.unit("m").register()?;
    let blocks = mechanics.signal(&format!("{name}/blocks")).register()?;
    let places = mechanics.signal(&format!("{name}/places"));
    let places = places.unit("m").description("where each block is");
    let places = places.register()?;
    let (world, mechanics_now) = World::open(options.world, unit)?;
    mechanics.spawn(
        Simulation {
            mechanics: mechanics_now,
            world,
            drive: Drive::default(),
            inputs: (take, drives, faults, gone),
            outputs: (read, show, offer),
            signals: (position, blocks, places),
        }
        .run(),
    )?;
    process("giver", level::MECHANICS).spawn(give_blocks(offers, give, given))?;
    process("command", level::COMMAND).spawn(command(
        unit.parameters(),
        (requests, views, contents),
        (order, break_it, reports),
    ))?;
    Ok(())
}

fn newest<T: Send>(unit: &str, name: &str) -> (Sender<T>, Receiver<T>) {
    let (sender, receiver) = luna::buffered(Buffer::overwrite_oldest(1));
    (sender.named(&format!("{unit} {name}")), receiver)
}

type SafetyInputs = (
    Receiver<Status>,
    Receiver<Status>,
    Receiver<Sensors>,
    Receiver<f64>,
    Receiver<Order>,
);
type SafetyOutputs = (
    Sender<Status>,
    Sender<Status>,
    Sender<Sensors>,
    Sender<Drive>,
    Sender<Setpoint>,
    Sender<View>,
);

/// The safety block: all signals of the unit pass here. It ends when the command block has ended.
async fn keep_safe(
    mut safety: Safety,
    (behind, ahead, readings, duties, orders): SafetyInputs,
    (to_behind, to_ahead, seen, drive, set, view): SafetyOutputs,
    (state, duty_signal): (Signal<f32>, Signal<f32>),
) -> luna::Result<()> {
    let mut cycle = 0;
    let mut reported = safety.status();
    let (mut has_ahead, mut has_behind) = (true, true);
    // A neighbour with a channel that has ended is silent from now on.
    loop {
        pri_alt! {
            status = ahead.recv(), if has_ahead => match status {
                Ok(status) => safety.ahead(status),
                Err(_) => has_ahead = false,
            },
            status = behind.recv(), if has_behind => match status {
                Ok(status) => safety.behind(status),
                Err(_) => has_behind = false,
            },
            duty = duties.recv() => {
                let Ok(duty) = duty else { return Ok(()) };
                let allowed = safety.drive(duty);
                duty_signal.record(allowed.duty as f32);
                let _ = drive.send(allowed).await;
            },
            order = orders.recv() => {
                let Ok(order) = order else { return Ok(()) };
                let _ = set.send(safety.order(order)).await;
            },
            readings = readings.recv() => {
                let Ok(readings) = readings else { return Ok(()) };
                let _ = seen.send(safety.sensors(readings)).await;
                state.record(safety.condition() as u8 as f32);
                if cycle % CYCLES_OF_COMMAND == 0 {
                    let _ = view.send(safety.view()).await;
                }
                let status = safety.status();
                if cycle % CYCLES_OF_STATUS == 0 || status != reported {
                    reported = status;
                    let _ = to_ahead.send(status).await;
                    let _ = to_behind.send(status).await;
                }
                cycle += 1;
            },
        }
    }
}

/// The controller: hard real-time, periodic. It ends when the safety block has ended.
async fn control(
    name: String,
    mut laws: [Box<dyn Law + Send>; 2],
    readings: Receiver<Sensors>,
    setpoints: Receiver<Setpoint>,
    duty: Sender<f64>,
) -> luna::Result<()> {
    let mut tick = luna::periodic(name, PERIOD)?;
    let mut position = 0.0;
    let mut law = 0;
    let mut goal = Goal::Speed(0.0);
    loop {
        tick.next().await;
        match readings.try_recv() {
            Ok(readings) => position = readings.position,
            Err(error) if error.is_empty() => {}
            Err(_) => return Ok(()),
        }
        if let Ok(setpoint) = setpoints.try_recv() {
            goal = setpoint.goal;
            let wanted = usize::from(setpoint.law) % laws.len();
            if wanted != law {
                law = wanted;
                laws[law].take_over(position);
            }
        }
        if duty.send(laws[law].step(goal, position)).await.is_err() {
            return Ok(());
        }
    }
}

/// The command block: soft real-time. It ends when the operator says so.
async fn command(
    parameters: &'static Parameters,
    (requests, views, contents): (Receiver<Request>, Receiver<View>, Receiver<Contents>),
    (order, break_it, reports): (Sender<Order>, Sender<Fault>, Sender<Report>),
) -> luna::Result<()> {
    let mut plan = command::of(parameters);
    let mut request = Request::default();
    let mut reported = Report::default();
    let mut silent = 0;
    loop {
        pri_alt! {
            new = requests.recv() => {
                let Ok(new) = new else { return Ok(()) };
                if new.end {
                    return Ok(());
                }
                if new.fault != request.fault {
                    let _ = break_it.send(new.fault).await;
                }
                request = new;
            },
            view = views.recv() => {
                let Ok(view) = view else { return Ok(()) };
                let step = plan.step(&view);
                let _ = order.send(Order {
                    run: request.run,
                    goal: step.goal,
                    release: step.release,
                    ready: step.ready,
                    law: request.law,
                    repairs: request.repairs,
                }).await;
                let report = Report {
                    condition: view.condition,
                    waits: step.waits,
                    law: request.law,
                    position: view.sensors.position,
                    contents: contents.try_recv().unwrap_or(reported.contents),
                };
                silent += 1;
                let is_new = (report.condition, report.waits, report.contents)
                    != (reported.condition, reported.waits, reported.contents);
                if is_new || silent >= COMMANDS_OF_REPORT {
                    (reported, silent) = (report, 0);
                    let _ = reports.send(report).await;
                }
            },
        }
    }
}

/// Waits for the next unit to take a block, which the mechanics do not.
async fn give_blocks(
    offers: Receiver<Handed>,
    give: Sender<Handed>,
    given: Sender<()>,
) -> luna::Result<()> {
    while let Ok(handed) = offers.recv().await {
        let over = async {
            offers.ended().await;
        };
        if give.send_unless(handed, over).await.is_err() || given.send(()).await.is_err() {
            break;
        }
    }
    Ok(())
}
