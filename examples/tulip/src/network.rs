//! The modules of TUlip as processes, in layers from non to hard real-time.
//!
//! ```text
//!  non      operator (a thread, or a program on another computer)
//!              ~ requests   ^ shown
//!              v            ~
//!  soft     world model <~~~~~~~~~~~~ sights ~~~~~~~~~ the camera
//!              ~ wishes     ^
//!              v            ~ body
//!  firm      gait  <~~~~~~~~~
//!              ~ plans      ~
//!              v            ~
//!  hard     balance ~~~~~~~~~
//!              ~ set-points          ╭────── seen ~~~~> balance, joints
//!              v                     │
//!           joints ──── commands ──> safety <~~ readings ~~ mechanics
//!                                      ~~~~~~~~ drive ~~~~~~~> ^
//!
//!  ──> rendezvous     ~~> newest value: its sender never waits
//! ```
//!
//! | process | real time | level | runs |
//! | --- | --- | --- | --- |
//! | safety | hard | 20 | with each value that comes |
//! | joints | hard | 18 | each millisecond |
//! | balance | hard | 16 | each millisecond |
//! | mechanics | the simulated machine | 14 | each millisecond |
//! | gait | firm | 10 | 100 times a second |
//! | world model | soft | 4 | 10 times a second |
//! | operator | non real-time | 2 | 10 times a second |
//!
//! Between layers only newest values pass. So nothing that is slower makes a faster one wait.
//!
//! **The end.** The machine ends after its time. Each other process ends when its inputs are closed.

mod apart;

pub use crate::processes::Orders;
pub use apart::serve_operator;

use crate::controllers;
use crate::mechanics::{Fault, Mechanics, Trouble};
use crate::outcome::Findings;
use crate::parameters::{ROBOT, STEP_TIME};
use crate::processes::{
    JointControl, Left, Signals, control_joints, keep_balance, keep_safe, model_world, operate,
    simulate, walk,
};
use crate::safety::Safety;
use luna::channel::Receiver;
use luna::prelude::*;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

/// The loops, as they are called in the report: the most urgent first.
pub const LOOPS: [&str; 5] = ["joints", "balance", "mechanics", "gait", "world model"];

/// Levels.
mod level {
    pub(super) const SAFETY: u8 = 20;
    pub(super) const JOINTS: u8 = 18;
    pub(super) const BALANCE: u8 = 16;
    pub(super) const MECHANICS: u8 = 14;
    pub(super) const GAIT: u8 = 10;
    pub(super) const WORLD: u8 = 4;
    pub(super) const OPERATOR: u8 = 2;
}

/// How long the operator waits before the robot is to walk.
pub(crate) const BEFORE: Duration = Duration::from_millis(500);
/// How long the robot stands at the end of a run that is long enough.
const AFTER: Duration = Duration::from_millis(2_500);
/// From the order to walk to the first step, at most; in s.
const BEGINNING: f64 = 2.5;

/// Where the layers run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// All on one executor.
    Executor,
    /// The hard and firm layers on one, the world model on a thread that is not real-time, the
    /// operator on another one.
    Threads,
    /// As `Threads`, with the operator in a program on this computer or another one:
    /// [`serve_operator`] at this address. It may end, and come back.
    Program(SocketAddr),
}

/// How a robot is run.
#[derive(Debug, Clone)]
pub struct Settings {
    /// How long.
    pub time: Duration,
    /// The operator exchanges the joint controllers each such time while the robot walks.
    pub exchange: Duration,
    /// What goes wrong.
    pub troubles: Vec<Trouble>,
    /// The scheduling policy of the hard and firm layers. Where it is refused, the thread is an
    /// ordinary one.
    pub policy: Policy,
    /// Where the layers run.
    pub place: Place,
}

impl Settings {
    /// When the robot is to stand again, if the run is long enough for that.
    pub(crate) fn walks_until(&self) -> Duration {
        match self.time > 2 * AFTER {
            true => self.time - AFTER,
            false => self.time,
        }
    }

    /// What the operator of this run wants.
    pub fn orders(&self) -> Orders {
        Orders {
            walk_until: self.walks_until().as_secs_f64(),
            exchange: self.exchange.as_secs_f64(),
        }
    }

    /// The steps that are to be seen at least.
    fn steps_expected(&self) -> u32 {
        let stops = |trouble: &&Trouble| trouble.fault != Fault::Push;
        let broken = self.troubles.iter().find(stops).map(|trouble| trouble.at);
        let until = self.walks_until().min(broken.unwrap_or(Duration::MAX));
        let time = until.saturating_sub(BEFORE).as_secs_f64() - BEGINNING;
        // Less than one for each step's time: a foot may be late, by half of that.
        1 + (time / (1.5 * STEP_TIME)).max(0.0) as u32
    }
}

/// A robot that runs, or has run.
#[derive(Debug)]
pub struct Tulip {
    left: Arc<Left>,
    steps_expected: u32,
}

impl Tulip {
    /// What became of it; none before its system has run to its end.
    pub fn findings(&self) -> Option<Findings> {
        let left = &self.left;
        let (exchanges, lost) = left.exchanges.get().copied()?;
        let (exchanges_asked, shown_times, shown) = left.operator.get().copied()?;
        Some(Findings {
            steps_expected: self.steps_expected,
            exchanges,
            // The last one may have come as the run ended.
            exchanges_asked: exchanges_asked.saturating_sub(1),
            lost,
            changed: left.changed.get().copied()?,
            shown: shown.map_or(vec![], |shown| shown.values.into()),
            shown_times,
            ..left.findings.get()?.clone()
        })
    }
}

/// Adds a robot to `system`. On a virtual clock, too.
///
/// # Errors
///
/// Those of building the system.
///
/// ```
/// use luna::prelude::*;
/// use luna_tulip::{Place, Settings, network};
/// use std::time::Duration;
///
/// let mut system = System::new("tulip");
/// system.virtual_clock();
/// let settings = Settings {
///     time: Duration::from_secs(5),
///     exchange: Duration::from_secs(1),
///     troubles: vec![],
///     policy: Policy::Other,
///     place: Place::Executor,
/// };
/// let tulip = network::build(&mut system, settings)?;
/// system.run()?;
/// assert!(tulip.findings().unwrap().is_good());
/// # Ok::<(), luna::Error>(())
/// ```
pub fn build(system: &mut System, settings: Settings) -> luna::Result<Tulip> {
    let tulip = Tulip {
        left: Arc::default(),
        steps_expected: settings.steps_expected(),
    };
    let left = || Arc::clone(&tulip.left);
    let main = system.executor("tulip").policy(settings.policy).build()?;
    let mut ordinary = |name: &str| system.executor(name).policy(Policy::Other).build();
    let others = match settings.place {
        Place::Executor => None,
        Place::Threads | Place::Program(_) => Some((ordinary("planning")?, ordinary("operator")?)),
    };
    let (planning, panel) = others.as_ref().map_or((&main, &main), |(a, b)| (a, b));

    let (read, readings) = newest("readings");
    let (see, seen_by_balance) = newest("seen by balance");
    let (show, seen_by_joints) = newest("seen by joints");
    let (drive, drives) = newest("drive");
    let (set, set_points) = newest("set-points");
    let (plan, plans) = newest("plans");
    let (body_to_gait, bodies) = newest("body to gait");
    let (body_to_world, bodies_of_world) = newest("body to world model");
    let (wish, wishes) = newest("wishes");
    let (sight, sights) = newest("sights");
    let (request, requests) = newest("requests");
    let (law, laws) = newest("laws");
    let (shown, shows) = newest("shown");
    let (command, commands) = luna::channel();

    let safety = main.process("safety").priority(level::SAFETY);
    let stopped = safety.signal("safety/stopped").register()?;
    let duties = safety.signal("motors/duties").unit("1").register()?;
    safety.spawn(keep_safe(
        Safety::new()?,
        (readings, commands),
        (see, show, drive),
        (stopped, duties),
        left(),
    ))?;
    let joints = main.process("joints").priority(level::JOINTS);
    let working = joints.signal("joints/law").register()?;
    let body = JointControl {
        laws: ROBOT.each_ref().map(controllers::of),
        working: 0,
        troubles: settings.troubles.clone(),
    };
    joints.spawn(control_joints(
        body,
        (seen_by_joints, set_points, laws),
        command.named("commands"),
        working,
        left(),
    ))?;
    main.process("balance")
        .priority(level::BALANCE)
        .spawn(keep_balance(
            (seen_by_balance, plans),
            (set, body_to_gait, body_to_world),
        ))?;
    main.process("gait")
        .priority(level::GAIT)
        .spawn(walk((bodies, wishes), plan))?;
    planning
        .process("world model")
        .priority(level::WORLD)
        .spawn(model_world(
            (bodies_of_world, sights, requests),
            (wish, law, shown),
            left(),
        ))?;
    match settings.place {
        Place::Program(address) => apart::connect(system, panel, address, (shows, request))?,
        _ => {
            let operator = panel.process("operator").priority(level::OPERATOR);
            operator.spawn(operate(settings.orders(), request, shows, |_| {}))?;
        }
    }

    let mechanics = main.process("mechanics").priority(level::MECHANICS);
    let signals = Signals {
        places: mechanics
            .signal("robot/places")
            .unit("m")
            .description(
                "capture point, pressure, left and right foot, from the body; x and y each",
            )
            .register()?,
        ahead: mechanics.signal("robot/ahead").unit("m").register()?,
        heights: mechanics.signal("robot/heights").unit("m").register()?,
        joints: mechanics.signal("robot/joints").unit("rad").register()?,
    };
    mechanics.spawn(simulate(
        Mechanics::new(settings.troubles),
        settings.time,
        drives,
        (read, sight),
        signals,
        left(),
    ))?;
    Ok(tulip)
}

fn newest<T: Send>(name: &str) -> (Sender<T>, Receiver<T>) {
    let (sender, receiver) = luna::buffered(Buffer::overwrite_oldest(1));
    (sender.named(name), receiver)
}
