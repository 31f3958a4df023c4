//! The processes of the head and their channels.
//!
//! ```text
//!            images                  sightings             set-points
//!  cameras ~~~~~~~~> vision ~~~~~~~~~~~~~~~~~~> motion ~~~~~~~~~~~~~~~> joints
//!     │                                             ^                   ^   │
//!     │                                             ~ seen              ~   │ duties
//!     │ the machine, simulated                      ~~~~~~~~~~~~~~~~~~~~~   v
//!     ╰────────── mechanics ~~~~~~~ readings ~~~~~~~~~~~~~~~~~~~~~~~~> safety
//!                     ^                                                 ~
//!                     ~~~~~~~~~~~~~~~~~~~~~ drive ~~~~~~~~~~~~~~~~~~~~~~~
//!
//!  ──> rendezvous     ~~> newest value: its sender never waits
//! ```
//!
//! | process | real time | level | runs |
//! | --- | --- | --- | --- |
//! | safety | hard | 20 | with each value that comes |
//! | joints | hard | 18 | each millisecond |
//! | mechanics | the simulated machine | 15 | each millisecond |
//! | motion | firm | 10 | 60 times a second |
//! | vision | non real-time | – | with each image |
//!
//! Only newest values come from vision and go to it. So motion control never waits for vision,
//! whatever it does. No value goes in a circle of rendezvous, so there is no deadlock.
//!
//! **The end.** The machine ends after its time. Each other process ends when its inputs are
//! closed.

mod apart;

pub use apart::serve_vision;

use crate::kinematics::Joints;
use crate::mechanics::{Mechanics, Trouble};
use crate::messages::{Drive, Image, Readings, Seen, SetPoint, Sighting};
use crate::motion::Motion;
use crate::outcome::Findings;
use crate::parameters::{AXES, DT, HEAD, MOTION_DT, MOTION_PERIOD, PERIOD, VISION_TIME};
use crate::pid::Pid;
use crate::safety::Safety;
use crate::vision;
use luna::prelude::*;
use luna::system::Executor;
use std::net::SocketAddr;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// The loops, as they are called in the report: the most urgent first.
pub const LOOPS: [&str; 3] = ["joints", "mechanics", "motion"];

/// Levels on the head's executor.
mod level {
    pub(super) const SAFETY: u8 = 20;
    pub(super) const JOINTS: u8 = 18;
    pub(super) const MECHANICS: u8 = 15;
    pub(super) const MOTION: u8 = 10;
    /// Where vision has no thread of its own.
    pub(super) const VISION: u8 = 2;
}

/// Where vision runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// On the head's executor, below all else.
    Executor,
    /// On a thread of its own, which is not real-time.
    Threads,
    /// In a program on this computer or another one: [`serve_vision`] at this address. It may end,
    /// and come back.
    Program(SocketAddr),
}

/// How a head is run.
#[derive(Debug, Clone)]
pub struct Settings {
    /// How long.
    pub time: Duration,
    /// What goes wrong.
    pub troubles: Vec<Trouble>,
    /// The scheduling policy of all but vision. Where it is refused, the thread is an ordinary one.
    pub policy: Policy,
    /// Where vision runs.
    pub place: Place,
}

/// A head that runs, or has run.
#[derive(Debug, Default)]
pub struct Head {
    findings: Arc<OnceLock<Findings>>,
    changed: Arc<OnceLock<u64>>,
}

impl Head {
    /// What became of it; none before its system has run to its end.
    pub fn findings(&self) -> Option<Findings> {
        let changed = self.changed.get().copied().unwrap_or(0);
        let findings = self.findings.get().cloned();
        findings.map(|findings| Findings {
            changed,
            ..findings
        })
    }
}

/// Adds a head to `system`. On a virtual clock, too.
///
/// # Errors
///
/// Those of building the system.
///
/// ```
/// use luna::prelude::*;
/// use luna_head::{Place, Settings, network};
/// use std::time::Duration;
///
/// let mut system = System::new("head");
/// system.virtual_clock();
/// let settings = Settings {
///     time: Duration::from_secs(3),
///     troubles: vec![],
///     policy: Policy::Other,
///     place: Place::Executor,
/// };
/// let head = network::build(&mut system, settings)?;
/// system.run()?;
/// assert!(head.findings().unwrap().is_good());
/// # Ok::<(), luna::Error>(())
/// ```
pub fn build(system: &mut System, settings: Settings) -> luna::Result<Head> {
    let head = system.executor("head").policy(settings.policy).build()?;
    let (image, images) = newest("images");
    let (sighting, sightings) = newest("sightings");
    let mut ordinary = |name| system.executor(name).policy(Policy::Other).build();
    match settings.place {
        Place::Executor => vision_on(&head, images, sighting)?,
        Place::Threads => vision_on(&ordinary("vision")?, images, sighting)?,
        Place::Program(address) => {
            let executor = ordinary("vision's link")?;
            apart::connect(system, &executor, address, (images, sighting))?;
        }
    }
    build_head(&head, (image, sightings), settings)
}

fn vision_on(
    executor: &Executor,
    images: Receiver<Image>,
    sighting: Sender<Sighting>,
) -> luna::Result<()> {
    let vision = executor.process("vision").priority(level::VISION);
    vision.spawn(look(images, sighting))?;
    Ok(())
}

fn newest<T: Send>(name: &str) -> (Sender<T>, Receiver<T>) {
    let (sender, receiver) = luna::buffered(Buffer::overwrite_oldest(1));
    (sender.named(name), receiver)
}

/// All but vision.
fn build_head(
    executor: &Executor,
    (image, sightings): (Sender<Image>, Receiver<Sighting>),
    settings: Settings,
) -> luna::Result<Head> {
    let head = Head::default();
    let (read, readings) = newest("readings");
    let (see, seen) = newest("seen by joints");
    let (show, shown) = newest("seen by motion");
    let (set, set_points) = newest("set-points");
    let (drive, drives) = newest("drive");
    let (duty, duties) = luna::channel();
    let process = |name: &str, level| executor.process(name).priority(level);

    let safety = process("safety", level::SAFETY);
    let state = safety.signal("safety/stopped");
    let state = state.description("0 moves; 1 stopped").register()?;
    let duty_signal = safety.signal("motors/duties").unit("1").register()?;
    safety.spawn(keep_safe(
        Safety::new()?,
        (readings, duties),
        (see, show, drive),
        (state, duty_signal),
        Arc::clone(&head.changed),
    ))?;
    process("joints", level::JOINTS).spawn(control_joints(
        seen,
        set_points,
        duty.named("duties"),
    ))?;
    let motion = process("motion", level::MOTION);
    let sees = motion.signal("motion/sees").register()?;
    motion.spawn(control_motion((shown, sightings), set, sees))?;

    let mechanics = process("mechanics", level::MECHANICS);
    let angles = mechanics.signal("head/angles").unit("rad");
    let angles = angles.description("the joints, from the base to the eyes");
    let signals = Signals {
        angles: angles.register()?,
        target: mechanics.signal("target/position").unit("m").register()?,
        error: mechanics.signal("gaze/error").unit("deg").register()?,
    };
    mechanics.spawn(simulate(
        Mechanics::new(settings.troubles),
        settings.time,
        drives,
        (read, image),
        signals,
        Arc::clone(&head.findings),
    ))?;
    Ok(head)
}

/// Vision: not real-time. It ends with the cameras.
async fn look(images: Receiver<Image>, sighting: Sender<Sighting>) -> luna::Result<()> {
    while let Ok(image) = images.recv().await {
        let found = vision::find(&image);
        // What a real algorithm takes longer for.
        luna::after(VISION_TIME).await;
        if let Some(found) = found
            && sighting.send(found).await.is_err()
        {
            break;
        }
    }
    Ok(())
}

/// Motion control. It ends with safety.
async fn control_motion(
    (seen, sightings): (Receiver<Seen>, Receiver<Sighting>),
    set: Sender<SetPoint>,
    sees: Signal<f32>,
) -> luna::Result<()> {
    let mut tick = luna::periodic("motion", MOTION_PERIOD)?;
    let mut motion = Motion::default();
    let mut latest = Seen::default();
    loop {
        tick.next().await;
        match seen.try_recv() {
            Ok(seen) => latest = seen,
            Err(error) if error.is_empty() => {}
            Err(_) => return Ok(()),
        }
        // Vision that has ended is silent from now on.
        if let Ok(sighting) = sightings.try_recv() {
            motion.sighting(&sighting, &latest);
        }
        sees.record(f32::from(u8::from(motion.has_target(latest.time))));
        if set.send(motion.step(latest.time)).await.is_err() {
            return Ok(());
        }
    }
}

/// The joint controllers: hard real-time. They end with safety.
async fn control_joints(
    seen: Receiver<Seen>,
    set_points: Receiver<SetPoint>,
    duty: Sender<[f64; AXES]>,
) -> luna::Result<()> {
    let mut tick = luna::periodic("joints", PERIOD)?;
    let mut controllers: [Pid; AXES] = std::array::from_fn(|n| Pid::new(&HEAD[n]));
    let mut set = SetPoint::default();
    let mut latest = Seen::default();
    loop {
        tick.next().await;
        match seen.try_recv() {
            Ok(seen) => latest = seen,
            Err(error) if error.is_empty() => {}
            Err(_) => return Ok(()),
        }
        if let Ok(new) = set_points.try_recv() {
            set = new;
        }
        // If motion control does not go on, the joints do not either.
        let since = latest.time - set.time;
        let is_fresh = since < 2.0 * MOTION_DT;
        let since = since.clamp(0.0, MOTION_DT);
        let duties = std::array::from_fn(|n| {
            let rate = if is_fresh { set.rates[n] } else { 0.0 };
            controllers[n].step(set.angles[n] + set.rates[n] * since, rate, latest.angles[n])
        });
        if duty.send(duties).await.is_err() {
            return Ok(());
        }
    }
}

/// All motors off.
const OFF: Drive = Drive {
    duties: [0.0; AXES],
    is_stopped: true,
};

/// The safety layer. It ends with the machine, and with the joint controllers: then the motors are
/// off.
async fn keep_safe(
    mut safety: Safety,
    (readings, duties): (Receiver<Readings>, Receiver<[f64; AXES]>),
    (see, show, drive): (Sender<Seen>, Sender<Seen>, Sender<Drive>),
    (state, duty_signal): (Signal<f32>, Signal<[f32; AXES]>),
    changed: Arc<OnceLock<u64>>,
) -> luna::Result<()> {
    let mut has_read = false;
    loop {
        pri_alt! {
            duties = duties.recv(), if has_read => {
                let Ok(duties) = duties else { break };
                let allowed = safety.duties(&duties);
                state.record(f32::from(u8::from(allowed.is_stopped)));
                duty_signal.record(allowed.duties.map(|duty| duty as f32));
                let _ = drive.send(allowed).await;
            },
            readings = readings.recv() => {
                let Ok(readings) = readings else { break };
                has_read = true;
                let seen = safety.readings(&readings);
                if safety.is_stopped() {
                    // Not with the next duties: none may come.
                    state.record(1.0);
                    let _ = drive.send(OFF).await;
                }
                let _ = see.send(seen).await;
                let _ = show.send(seen).await;
            },
        }
    }
    let _ = drive.send(OFF).await;
    let _ = changed.set(safety.changed());
    Ok(())
}

/// What the machine shows of itself.
struct Signals {
    angles: Signal<[f32; AXES]>,
    target: Signal<[f32; 3]>,
    error: Signal<f32>,
}

/// The simulated machine. It ends after `time`.
async fn simulate(
    mut mechanics: Mechanics,
    time: Duration,
    drives: Receiver<Drive>,
    (read, image): (Sender<Readings>, Sender<Image>),
    signals: Signals,
    findings: Arc<OnceLock<Findings>>,
) -> luna::Result<()> {
    let mut tick = luna::periodic("mechanics", PERIOD)?;
    let mut drive = Drive::default();
    while mechanics.time() + DT / 2.0 < time.as_secs_f64() {
        tick.next().await;
        if let Ok(new) = drives.try_recv() {
            drive = new;
        }
        mechanics.step(&drive);
        let joints = Joints::from(mechanics.angles());
        signals.angles.record(joints.cast::<f32>().into());
        signals
            .target
            .record(mechanics.target().cast::<f32>().into());
        signals
            .error
            .record(mechanics.gaze_error().to_degrees() as f32);
        if let Some(exposed) = mechanics.image() {
            let _ = image.send(exposed).await;
        }
        if read.send(mechanics.readings()).await.is_err() {
            break;
        }
    }
    let _ = findings.set(mechanics.findings());
    Ok(())
}

#[cfg(test)]
mod tests;
