//! What the processes do between their channels. All but the operator and the world model are on the
//! real-time path: their cycles allocate nothing.

use crate::balance::Balance;
use crate::controllers::Controller;
use crate::gait::Gait;
use crate::mechanics::{Fault, Mechanics, Trouble, upright};
use crate::messages::{
    Body, Command, Drive, Internal, Plan, Readings, Request, Seen, SetPoint, Shown, Wish,
};
use crate::network::BEFORE;
use crate::outcome::Findings;
use crate::parameters::{DT, GAIT_PERIOD, JOINTS, PERIOD, WORLD_PERIOD};
use crate::safety::Safety;
use crate::world::World;
use luna::channel::Receiver;
use luna::prelude::*;
use nalgebra::Vector2;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// What the operator is shown.
const SHOW: [Internal; 3] = [Internal::BallDistance, Internal::Steps, Internal::Capture];

/// An operator that says nothing for so long is gone, in s.
const SILENT: f64 = 1.0;

/// What the processes leave behind.
#[derive(Debug, Default)]
pub(crate) struct Left {
    pub(crate) findings: OnceLock<Findings>,
    /// The duties that safety has changed.
    pub(crate) changed: OnceLock<u64>,
    /// Exchanges, and slots that were missed right after one.
    pub(crate) exchanges: OnceLock<(u32, u64)>,
    /// The exchanges that the operator asked for, how often it was shown values, and the last ones.
    pub(crate) operator: OnceLock<(u32, u32, Option<Shown>)>,
}

/// Takes the newest value, if there is one. Returns whether there may be others.
fn take<T>(receiver: &Receiver<T>, to: &mut T) -> bool
where
    T: Send,
{
    match receiver.try_recv() {
        Ok(value) => *to = value,
        Err(error) if error.is_empty() => {}
        Err(_) => return false,
    }
    true
}

/// When the operator wants what, by the robot's time.
#[derive(Debug, Clone, Copy)]
pub struct Orders {
    /// The robot is to walk until then, in s.
    pub walk_until: f64,
    /// The joint controllers are to be exchanged each so many seconds.
    pub exchange: f64,
}

/// The operator: not real-time, and not on the robot. It answers what it is shown, and calls `see`
/// with that.
pub(crate) async fn operate(
    orders: Orders,
    request: Sender<Request>,
    shows: Receiver<Shown>,
    mut see: impl FnMut(&Shown) + Send,
) -> luna::Result<()> {
    let begin = BEFORE.as_secs_f64();
    while let Ok(shown) = shows.recv().await {
        see(&shown);
        let time = shown.time.min(orders.walk_until);
        let exchanges = ((time - begin) / orders.exchange).max(0.0) as u32;
        let wanted = Request {
            walk: (begin..orders.walk_until).contains(&shown.time),
            law: (exchanges % 2) as u8,
            show: SHOW,
        };
        if request.send(wanted).await.is_err() {
            break;
        }
    }
    Ok(())
}

/// The world model: soft real-time. It ends with balance.
pub(crate) async fn model_world(
    (bodies, sights, requests): (Receiver<Body>, Receiver<Vector2<f64>>, Receiver<Request>),
    (wish, law, shown): (Sender<Wish>, Sender<u8>, Sender<Shown>),
    left: Arc<Left>,
) -> luna::Result<()> {
    let mut tick = luna::periodic("world model", WORLD_PERIOD)?;
    let mut world = World::default();
    let mut body = Body::default();
    let mut request = Request {
        walk: false,
        law: 0,
        show: SHOW,
    };
    let mut heard = body.time;
    let (mut exchanges, mut times, mut last) = (0, 0, None);
    loop {
        tick.next().await;
        if !take(&bodies, &mut body) {
            let _ = left.operator.set((exchanges, times, last));
            return Ok(());
        }
        world.body(body);
        if let Ok(ball) = sights.try_recv() {
            world.see(&ball);
        }
        let before = request;
        if let Ok(new) = requests.try_recv() {
            (request, heard) = (new, body.time);
        }
        // Without an operator the robot stands.
        request.walk &= body.time - heard < SILENT;
        if request.law != before.law {
            exchanges += 1;
            let _ = law.send(request.law).await;
        }
        let _ = wish.send(world.wish(&request)).await;
        let show = world.show(&request);
        if shown.send(show).await.is_ok() {
            (times, last) = (times + 1, Some(show));
        }
    }
}

/// The gait: firm real-time. It ends with balance.
pub(crate) async fn walk(
    (bodies, wishes): (Receiver<Body>, Receiver<Wish>),
    plan: Sender<Plan>,
) -> luna::Result<()> {
    let mut tick = luna::periodic("gait", GAIT_PERIOD)?;
    let mut gait = Gait::default();
    let mut body = Balance::default().body();
    let mut wish = Wish::default();
    loop {
        tick.next().await;
        if !take(&bodies, &mut body) {
            return Ok(());
        }
        // Without a world model the robot does what was wanted last.
        take(&wishes, &mut wish);
        if plan.send(gait.step(&body, &wish)).await.is_err() {
            return Ok(());
        }
    }
}

/// Balance: hard real-time. It ends with safety.
pub(crate) async fn keep_balance(
    (seen, plans): (Receiver<Seen>, Receiver<Plan>),
    (set, to_gait, to_world): (Sender<SetPoint>, Sender<Body>, Sender<Body>),
) -> luna::Result<()> {
    let mut tick = luna::periodic("balance", PERIOD)?;
    let mut balance = Balance::default();
    let mut plan = Plan::Stand(Vector2::zeros());
    let mut latest = Seen::default();
    loop {
        tick.next().await;
        if !take(&seen, &mut latest) {
            return Ok(());
        }
        if latest.time == 0.0 {
            // Nothing was sensed yet.
            continue;
        }
        take(&plans, &mut plan);
        balance.see(&latest, &plan);
        let _ = to_gait.send(balance.body()).await;
        let _ = to_world.send(balance.body()).await;
        if set.send(balance.step(&plan)).await.is_err() {
            return Ok(());
        }
    }
}

/// All joints' controllers, and which of them works.
pub(crate) struct JointControl {
    pub(crate) laws: [[Box<dyn Controller + Send>; 2]; JOINTS],
    pub(crate) working: usize,
    pub(crate) troubles: Vec<Trouble>,
}

impl JointControl {
    /// Between two cycles, the other controllers take over. Allocates nothing.
    fn exchange(&mut self, law: usize, angles: &[f64; JOINTS]) {
        for (laws, angle) in self.laws.iter_mut().zip(angles) {
            let (speed, slow) = laws[self.working].hand_over();
            laws[law].take_over(*angle, speed, slow);
        }
        self.working = law;
    }

    fn step(&mut self, set: &SetPoint, seen: &Seen) -> [f64; JOINTS] {
        std::array::from_fn(|n| {
            let law = &mut self.laws[n][self.working];
            let duty = law.step(set.joints[n], set.rates[n], seen.joints[n]);
            let is_broken = |trouble: &Trouble| {
                trouble.fault == Fault::Controller(n) && seen.time >= trouble.at.as_secs_f64()
            };
            match self.troubles.iter().any(is_broken) {
                true => 1.0,
                false => duty,
            }
        })
    }
}

/// The joint controllers: hard real-time. They end with safety.
pub(crate) async fn control_joints(
    mut control: JointControl,
    (seen, set_points, laws): (Receiver<Seen>, Receiver<SetPoint>, Receiver<u8>),
    command: Sender<Command>,
    working: Signal<f32>,
    left: Arc<Left>,
) -> luna::Result<()> {
    let mut tick = luna::periodic("joints", PERIOD)?;
    let upright = upright();
    let mut set = SetPoint {
        joints: upright,
        rates: [0.0; JOINTS],
    };
    let mut latest = Seen {
        joints: upright,
        ..Seen::default()
    };
    let (mut exchanges, mut lost, mut has_exchanged) = (0, 0, false);
    loop {
        let cycle = tick.next().await;
        if has_exchanged {
            lost += cycle.missed;
            has_exchanged = false;
        }
        if !take(&seen, &mut latest) {
            break;
        }
        take(&set_points, &mut set);
        if let Ok(law) = laws.try_recv() {
            let law = usize::from(law) % 2;
            has_exchanged = law != control.working;
            exchanges += u32::from(has_exchanged);
            control.exchange(law, &latest.joints);
        }
        working.record(control.working as f32);
        let next = Command {
            duties: control.step(&set, &latest),
            set: set.joints,
        };
        if command.send(next).await.is_err() {
            break;
        }
    }
    let _ = left.exchanges.set((exchanges, lost));
    Ok(())
}

/// All motors off.
const OFF: Drive = Drive {
    duties: [0.0; JOINTS],
    is_stopped: true,
};

/// The safety module. It ends with the machine, and with the joint controllers: then the motors are
/// off.
pub(crate) async fn keep_safe(
    mut safety: Safety,
    (readings, commands): (Receiver<Readings>, Receiver<Command>),
    (see, show, drive): (Sender<Seen>, Sender<Seen>, Sender<Drive>),
    (stopped, duties): (Signal<f32>, Signal<[f32; JOINTS]>),
    left: Arc<Left>,
) -> luna::Result<()> {
    let mut has_read = false;
    loop {
        pri_alt! {
            command = commands.recv(), if has_read => {
                let Ok(command) = command else { break };
                let allowed = safety.command(&command);
                stopped.record(f32::from(u8::from(allowed.is_stopped)));
                duties.record(allowed.duties.map(|duty| duty as f32));
                let _ = drive.send(allowed).await;
            },
            readings = readings.recv() => {
                let Ok(readings) = readings else { break };
                has_read = true;
                let seen = safety.readings(&readings);
                if safety.is_stopped() {
                    // Not with the next command: none may come.
                    stopped.record(1.0);
                    let _ = drive.send(OFF).await;
                }
                let _ = see.send(seen).await;
                let _ = show.send(seen).await;
            },
        }
    }
    let _ = drive.send(OFF).await;
    let _ = left.changed.set(safety.changed());
    Ok(())
}

/// What the machine shows of itself.
pub(crate) struct Signals {
    pub(crate) places: Signal<[f32; 8]>,
    pub(crate) ahead: Signal<f32>,
    pub(crate) heights: Signal<[f32; 2]>,
    pub(crate) joints: Signal<[f32; JOINTS]>,
}

/// The simulated robot. It ends after `time`.
pub(crate) async fn simulate(
    mut mechanics: Mechanics,
    time: Duration,
    drives: Receiver<Drive>,
    (read, sight): (Sender<Readings>, Sender<Vector2<f64>>),
    signals: Signals,
    left: Arc<Left>,
) -> luna::Result<()> {
    let mut tick = luna::periodic("mechanics", PERIOD)?;
    let mut drive = Drive::default();
    let mut cycle = 0_u32;
    while mechanics.time() + DT / 2.0 < time.as_secs_f64() {
        tick.next().await;
        take(&drives, &mut drive);
        mechanics.step(&drive);
        let [mass, places @ ..] = mechanics.places();
        let both = |n: usize| places[n / 2][n % 2] as f32;
        signals.places.record(std::array::from_fn(both));
        signals.ahead.record(mass.x as f32);
        signals
            .heights
            .record(mechanics.heights().map(|height| height as f32));
        signals
            .joints
            .record(mechanics.joints().map(|angle| angle as f32));
        if cycle.is_multiple_of(100) {
            let _ = sight.send(mechanics.ball()).await;
        }
        cycle += 1;
        if read.send(mechanics.readings()).await.is_err() {
            break;
        }
    }
    let _ = left.findings.set(mechanics.findings());
    Ok(())
}

#[cfg(test)]
mod tests;
