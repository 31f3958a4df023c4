//! A motor axis with its safety blocks, on virtual time, and faults that it can have.
//!
//! ```text
//!  operator ──> set-points ~> controller ──> output ~> motor
//!                                 ^            ^         │ encoder, second encoder
//!                                 ~            ╰~~~~~~~~~┤
//!                              encoder <~~~~~~~~~~~~~~~~~╯
//!
//!  set-points: limit, rate limit
//!  encoder: largest rate, noise, disagreement
//!  output: timeout, limit, rate limit, end stop, motion
//!  ──> rendezvous   ~> register
//! ```
//!
//! Three processes of blocks: within each, the blocks are a chain without a switch between them.

use luna::Instant;
use luna::prelude::*;
use luna_plants::{Motor, MotorParameters, MotorState, PAN, Plant, PlantError, PlantLink, Port};
use luna_safety_blocks::{
    Blocked, Chain, Disagreement, EndStop, Finding, Limit, MaxRate, Noise, RateLimit, Reaction,
    Recovery, Response, Timeout,
};
use std::sync::{Arc, Mutex};
use std::time::Duration;

pub(crate) const MS: Duration = Duration::from_millis(1);

/// When it goes wrong, since the start.
pub(crate) const WHEN: Duration = Duration::from_millis(1_200);
/// How long a run is.
pub(crate) const LENGTH: Duration = Duration::from_secs(3);
/// Where the stops begin for the blocks, in rad; the mechanical stops are at 1.4.
pub(crate) const STOP: f64 = 1.3;

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Trouble {
    None,
    /// The encoder stays where it is; the axis does not.
    EncoderFrozen,
    /// The encoder has lost half a radian.
    EncoderJumps,
    /// Its shield is off.
    EncoderRustles,
    /// The axis does not move any more.
    Jammed,
    /// The operator's set-points are a million.
    SetPointRunsAway,
    /// They are no numbers.
    SetPointIsNan,
    /// The controller sends nothing any more.
    ControllerSilent,
    /// The controller drives one way, whatever it measures.
    ControllerMad,
}

pub(crate) const TROUBLES: [Trouble; 9] = [
    Trouble::None,
    Trouble::EncoderFrozen,
    Trouble::EncoderJumps,
    Trouble::EncoderRustles,
    Trouble::Jammed,
    Trouble::SetPointRunsAway,
    Trouble::SetPointIsNan,
    Trouble::ControllerSilent,
    Trouble::ControllerMad,
];

/// What came of a run.
#[derive(Debug)]
pub(crate) struct Outcome {
    /// What the blocks found, and how long after it went wrong.
    pub(crate) alarms: Vec<(Duration, Finding)>,
    /// When the functions of the emergency ran, if there was one, and the cause that ended the run.
    pub(crate) emergency: Option<(Duration, Finding)>,
    /// How long after the fault the encoders were further apart than tolerated, if they were.
    pub(crate) apart: Option<Duration>,
    /// How long after the fault the duty first was enough to move a free axis.
    pub(crate) driven: Option<Duration>,
    /// The beginning of the last time that the duty was 0, counted from the fault: the motor has
    /// been off since.
    pub(crate) off_since: Option<Duration>,
    /// Whether the system was in its safe state at the end.
    pub(crate) is_safe_state: bool,
    /// The furthest that the axis was from the middle, in rad.
    pub(crate) furthest: f64,
    /// Where it was at the end.
    pub(crate) end: MotorState,
}

/// What the plant sees of a run.
#[derive(Debug, Default)]
struct Seen {
    apart: Option<Duration>,
    driven: Option<Duration>,
    off_since: Option<Duration>,
    furthest: f64,
}

/// The axis with two encoders, of which one can break.
struct Axis {
    motor: Motor,
    trouble: Trouble,
    ports: [Port; 3],
    start: Option<Instant>,
    frozen: Option<f64>,
    steps: u32,
    duty: f64,
    seen: Seen,
}

impl Axis {
    fn new(trouble: Trouble) -> Self {
        Self {
            motor: Motor::new(PAN),
            trouble,
            ports: [
                Port::new("duty", "1").range(-1.0, 1.0),
                Port::new("encoder", "rad"),
                Port::new("second encoder", "rad"),
            ],
            start: None,
            frozen: None,
            steps: 0,
            duty: 0.0,
            seen: Seen::default(),
        }
    }

    /// How long it has been broken.
    fn broken(&mut self) -> Option<Duration> {
        let now = luna::now();
        let begins = *self.start.get_or_insert(now) + WHEN;
        (now >= begins && self.trouble != Trouble::None).then(|| now - begins)
    }
}

impl Plant for Axis {
    fn inputs(&self) -> &[Port] {
        &self.ports[..1]
    }

    fn outputs(&self) -> &[Port] {
        &self.ports[1..]
    }

    fn apply(&mut self, inputs: &[f64]) -> Result<(), PlantError> {
        self.duty = inputs[0];
        if let Some(since) = self.broken() {
            if self.duty.abs() >= DRIVEN {
                self.seen.driven.get_or_insert(since);
            }
            match self.duty == 0.0 {
                true => _ = self.seen.off_since.get_or_insert(since),
                false => self.seen.off_since = None,
            }
        }
        Ok(())
    }

    fn step(&mut self, time: Duration) -> Result<(), PlantError> {
        self.steps += 1;
        if self.broken() == Some(Duration::ZERO) && self.trouble == Trouble::Jammed {
            let stuck = MotorParameters {
                coulomb_friction: 100.0,
                stiction: 100.0,
                ..PAN
            };
            self.motor = Motor::new(stuck).starting_at(MotorState {
                speed: 0.0,
                ..self.motor.state()
            });
        }
        self.motor.drive(self.duty, time.as_secs_f64());
        self.seen.furthest = self.seen.furthest.max(self.motor.state().angle.abs());
        Ok(())
    }

    fn measure(&mut self, outputs: &mut [f64]) -> Result<(), PlantError> {
        let angle = self.motor.state().angle;
        let broken = self.broken();
        let rustle = if self.steps.is_multiple_of(2) {
            0.005
        } else {
            -0.005
        };
        outputs[0] = match (broken, self.trouble) {
            (Some(_), Trouble::EncoderFrozen) => *self.frozen.get_or_insert(angle),
            (Some(_), Trouble::EncoderJumps) => angle + 0.5,
            (Some(_), Trouble::EncoderRustles) => angle + rustle,
            _ => angle,
        };
        outputs[1] = angle;
        if let Some(since) = broken
            && (outputs[0] - angle).abs() > TOLERANCE
        {
            self.seen.apart.get_or_insert(since);
        }
        Ok(())
    }
}

/// How far apart the encoders may be, in rad, and for how long.
const TOLERANCE: f64 = 0.02;
pub(crate) const APART: Duration = Duration::from_millis(5);
/// A duty that moves the axis if it is free, and how long it may take.
const DRIVEN: f64 = 0.3;
pub(crate) const BLOCKED: Duration = Duration::from_millis(50);
/// How long the controller may be silent.
pub(crate) const SILENT: Duration = Duration::from_millis(5);
/// How long the operator may demand too much, and the controller may drive into a stop.
pub(crate) const ASKED: Duration = Duration::from_millis(20);
pub(crate) const PRESSED: Duration = Duration::from_millis(40);
/// The number of samples for noise.
pub(crate) const NOISE: u32 = 20;

fn set_points() -> luna::Result<Chain> {
    let back = Response::new(Reaction::Neutral)
        .recovery(Recovery::After(100 * MS))
        .limited_for(ASKED);
    Ok(Chain::new(0.0)?
        .then("set-point limit", Limit::new(-1.2, 1.2)?, back)?
        // Behind the limit, so that its neutral is come to in steps too.
        .then("set-point rate", RateLimit::new(4.0)?, Reaction::Warn)?)
}

fn encoder() -> luna::Result<Chain> {
    // A fifth more than the motor can reach without any friction.
    let fastest = 1.2 * PAN.supply / PAN.joint_constant();
    Ok(Chain::new(0.0)?
        .then("encoder rate", MaxRate::new(fastest)?, Reaction::Emergency)?
        .then("encoder noise", Noise::new(5e-3, NOISE)?, Reaction::Warn)?
        .then(
            "encoders",
            Disagreement::new(TOLERANCE, APART)?,
            Reaction::Emergency,
        )?)
}

fn output() -> luna::Result<Chain> {
    let pressed = Response::new(Reaction::SafeState).limited_for(PRESSED);
    Ok(Chain::new(0.0)?
        .then("duty limit", Limit::new(-0.7, 0.7)?, Reaction::Neutral)?
        .then(
            "duty rate",
            RateLimit::new(200.0)?.free_to(0.0)?,
            Reaction::Warn,
        )?
        .then(
            "end stop",
            EndStop::new(-STOP, STOP)?.hysteresis(0.01)?,
            pressed,
        )?
        .then(
            "motion",
            Blocked::new(DRIVEN, 2e-3, BLOCKED)?,
            Reaction::Emergency,
        )?)
}

/// Runs the axis with `trouble` for three seconds of virtual time. Each run is the same.
pub(crate) fn run(trouble: Trouble) -> luna::Result<Outcome> {
    let mut system = System::new("safe axis");
    system.virtual_clock();
    let main = system.executor("main").build()?;
    let register = || luna::buffered::<f64>(Buffer::overwrite_oldest(1));
    let (measured, encoder_readings) = register();
    let (second, second_readings) = register();
    let (second_again, positions) = register();
    let (checked, angles) = register();
    let (limited, targets) = register();
    let (safe, duties) = register();
    let (wanted, asked) = luna::channel();
    let (duty, computed) = luna::channel();
    let (reports, causes) = luna::buffered::<Finding>(Buffer::overwrite_oldest(64));

    // The blocks.
    let feedback_within = 3 * MS;
    main.process("set-points").priority(14).spawn(
        set_points()?
            .process(asked, limited)
            .report_to(reports.clone()),
    )?;
    let of_encoder = encoder()?.process(encoder_readings, checked);
    main.process("encoder").priority(18).spawn(
        of_encoder
            .feedback(second_readings, feedback_within)?
            .report_to(reports.clone())
            .of_sensor(),
    )?;
    let silence = Response::new(Reaction::Neutral).recovery(Recovery::After(Duration::ZERO));
    let (of_motor, _) = output()?.process(computed, safe).timeout(
        "controller",
        Timeout::new(SILENT, 0.0)?,
        silence,
    )?;
    main.process("output").priority(16).spawn(
        of_motor
            .feedback(positions, feedback_within)?
            .report_to(reports),
    )?;

    // The processes around the blocks.
    let start = Arc::new(Mutex::new(None));
    let at_start = start.clone();
    main.process("operator").priority(13).spawn(async move {
        let mut tick = luna::periodic("operator", 10 * MS)?;
        let begun = luna::now();
        luna::realtime::off_path(|| *at_start.lock().unwrap() = Some(begun));
        loop {
            let cycle = tick.next().await;
            let time = cycle.deadline - begun;
            if time > LENGTH {
                return Ok(());
            }
            let angle = (3.0 * time.as_secs_f64()).sin();
            wanted
                .send(match trouble {
                    Trouble::SetPointRunsAway if time >= WHEN => 1e6,
                    Trouble::SetPointIsNan if time >= WHEN => f64::NAN,
                    _ => angle,
                })
                .await?;
        }
    })?;
    main.process("controller").priority(15).spawn(async move {
        let begun = luna::now();
        let mut tick = luna::periodic("controller", MS)?;
        let (mut target, mut angle) = (0.0, 0.0);
        loop {
            let time = tick.next().await.deadline - begun;
            if time > LENGTH {
                return Ok(());
            }
            target = targets.try_recv().unwrap_or(target);
            angle = angles.try_recv().unwrap_or(angle);
            match trouble {
                Trouble::ControllerSilent if time >= WHEN => continue,
                Trouble::ControllerMad if time >= WHEN => duty.send(0.2).await?,
                _ => duty.send(4.0 * (target - angle)).await?,
            }
        }
    })?;
    let mut motor = PlantLink::new("motor", Axis::new(trouble));
    motor.actuator("duty", duties)?;
    motor.sensor("encoder", measured)?;
    motor.sensor("second encoder", second)?;
    motor.sensor("second encoder", second_again)?;
    let line = motor.enable_line();
    let seen = Arc::new(Mutex::new(None));
    let at_end = seen.clone();
    motor.at_end(move |axis| {
        let Seen {
            apart,
            driven,
            off_since,
            furthest,
        } = axis.seen;
        *at_end.lock().unwrap() = Some((apart, driven, off_since, furthest, axis.motor.state()));
    });
    main.process("motor")
        .priority(20)
        .spawn(motor.periodic(MS)?)?;

    // The alarms that were recorded.
    let alarms = Arc::new(Mutex::new(Vec::new()));
    let notes = alarms.clone();
    main.process("notes").priority(25).spawn(async move {
        while let Ok(cause) = causes.recv().await {
            let now = luna::now();
            luna::realtime::off_path(|| notes.lock().unwrap().push((now, cause)));
        }
        Ok(())
    })?;
    let stopped = Arc::new(Mutex::new(None));
    let at_emergency = stopped.clone();
    system.on_emergency("motor off", move || {
        line.cut();
        *at_emergency.lock().unwrap() = Some(luna::now());
    });

    let safety = system.safety();
    let ended = system.run();
    let is_safe_state = safety.degree() == luna::safety::Degree::SafeState;
    let begun: Instant = start.lock().unwrap().expect("the operator has begun");
    let since = |instant: Instant| instant - (begun + WHEN);
    let emergency = match ended {
        Ok(_) => None,
        Err(error) => {
            let stopped: Instant = stopped.lock().unwrap().expect("it was an emergency");
            Some((since(stopped), cause_of(&error).ok_or(error)?))
        }
    };
    let (apart, driven, off_since, furthest, end) =
        seen.lock().unwrap().take().expect("the motor has ended");
    let alarms = alarms.lock().unwrap();
    Ok(Outcome {
        alarms: alarms
            .iter()
            .map(|(at, cause)| (since(*at), cause.clone()))
            .collect(),
        emergency,
        apart,
        driven,
        off_since,
        is_safe_state,
        furthest,
        end,
    })
}

/// What a block raised the emergency with.
fn cause_of(error: &luna::Error) -> Option<Finding> {
    match error {
        luna::Error::Process { source, .. } => cause_of(source),
        luna::Error::Other(other) => other.get().downcast_ref().cloned(),
        _ => None,
    }
}
