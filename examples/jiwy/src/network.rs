//! Jiwy's model: its processes and their channels. After the thesis' figures A.2 and H.1.
//!
//! ```text
//!                                  one axis (pan; tilt is the same)
//!
//!                        ╭──> position in ──> position scaling ──┬──────────────> encoder watch ──────╮
//!                        │        ~ count                        ╰─╮                                  │
//!  timer ──> timer in ───┤                                         v                                  │
//!                        │                                    calibration ──> set-point ──> controller ──> tracking
//!                        │        ~ stick                          ^                            │     │
//!                        ╰──> joystick in ──> joystick scaling ────╯                            v     │
//!                                                                                        output scaling
//!                                                                                               │     │
//!   ╭─────────────────────────────────────────── command out <──────────────────────────────────╯     │
//!   v                                                                                                 v
//!  command in ──> limit ──> slew ──> end-stop guard ──> gate ──> motor out ──┬──> enable out ~      safety
//!                                                      ~ │                   ╰──> pwm out ~           │
//!                                                      | ╰──> motion watch ──> (safety)               │
//!                                                      ╰~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~╯
//!
//!                                   the machine, simulated                           the operator
//!
//!                     pwm, enable ~> bridge ──> joint ──> counter ~> count           joystick ~> stick, stick
//!
//!  ──> rendezvous channel      ~> register: a buffer of one that forgets the older value, never waited for
//! ```
//!
//! 51 processes: 21 of each axis, the timer, safety, the joystick, and 3 of the machine for each
//! axis; one more than the picture shows, since each axis has a `timer in` that starts its readers.
//! There is **one loop**, as in the thesis: `timer` delays the whole model until the next period,
//! and all other processes are woken by values that they receive. A cycle is 44 rendezvous. (The
//! machine has its own time, and the joystick is sampled at 100 Hz.)
//!
//! **Levels.** All processes of an axis have one level, pan's is above tilt's, both are above the
//! timer's: so a cycle of pan is complete, from its encoder to its motor, before tilt's begins.
//! Safety has the highest level.
//!
//! **No deadlock.** Within a cycle values flow one way, from the timer to the writers. Where paths
//! part and join again (timer in to calibration, position scaling to calibration and its watch), a
//! sender sends in one order, and a receiver of two receives the position first, then the target:
//! so the wait-for relation has no cycle. Values that go back, from safety to the gates and through
//! the machine to the counters, go through registers, which never block.
//!
//! **The end.** The timer returns after its number of cycles and drops its ends. Each process
//! returns when its input is closed; the last of an axis write that the bridge is off. The same
//! follows if any of them fails.
//!
//! **No allocation** after the start: values are `Copy`, state is in the processes, results are
//! passed on in `post_run`.

use crate::hardware::{self, Registers};
use crate::joystick::{Playback, Sticks};
use crate::parts::calibration::Calibration;
use crate::parts::faults::{self, Fault};
use crate::parts::pid::Gains;
use crate::parts::sanity::{Interventions, Sanity};
use crate::parts::set_point::SetPoint;
use crate::parts::tracking::Tracking;
use crate::processes::control::{
    Controller, ScaleOutput, Track, TunableGains, calibrate, lead, pass_on,
};
use crate::processes::operator::Joystick;
use crate::processes::readers::{read_joystick, read_position, scale_joystick, scale_position};
use crate::processes::safety::{keep_safe, watch_encoder, watch_motion};
use crate::processes::sanity::{Checking, gate, write_motor, write_register};
use crate::processes::timer::{Tick, read_timer, write_timer};
use crate::{AXES, Axis};
use luna::Executor;
use luna::prelude::*;
use luna::process::IntoProcess;
use luna::system::ProcessBuilder;
use luna_plants::{Decoder, MotorParameters};
use luna_safety_blocks::{EndStop, Limit, RateLimit};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// What the loop is called in reports.
pub const LOOP: &str = "timer";

const JOYSTICK: &str = "joystick";

/// Levels on the control executor.
mod level {
    pub(super) const SAFETY: u8 = 20;
    pub(super) const AXES: [u8; 2] = [12, 11];
    pub(super) const TIMER: u8 = 10;
}

/// What a run is.
#[derive(Debug)]
pub struct Settings {
    /// From one cycle to the next.
    pub period: Duration,
    /// How many there are.
    pub cycles: u64,
    /// How the axes begin.
    pub start: Start,
    /// What moves them.
    pub joystick: Playback,
}

/// How the axes begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// They look for their end stops first: some seconds.
    Calibrate,
    /// Their encoders count from [`Axis::count_at_zero`](crate::Axis::count_at_zero).
    Calibrated,
}

/// Whether the process called `name` is one of the control processes, on [`Executors::control`]:
/// all but the joystick and the simulated machine.
///
/// ```
/// use luna_jiwy::network::controls;
///
/// assert!(controls("timer") && controls("pan limit"));
/// assert!(!controls("joystick") && !controls("tilt bridge"));
/// ```
pub fn controls(name: &str) -> bool {
    name != JOYSTICK && !hardware::simulates(name)
}

/// What the processes of one axis leave behind when they end.
#[derive(Debug, Default)]
pub struct Findings {
    /// How far it was from its set-point.
    pub tracking: OnceLock<Tracking>,
    pub(crate) limit: OnceLock<Sanity<Limit>>,
    pub(crate) slew: OnceLock<Sanity<RateLimit>>,
    pub(crate) guard: OnceLock<Sanity<EndStop>>,
}

impl Findings {
    /// How often the safety layer changed a duty, counted by the processes that have ended.
    pub fn interventions(&self) -> Interventions {
        Interventions {
            not_finite: self.limit.get().map_or(0, |limit| limit.not_finite),
            limited: self.limit.get().map_or(0, |limit| limit.changed),
            slewed: self.slew.get().map_or(0, |slew| slew.changed),
            guarded: self.guard.get().map_or(0, |guard| guard.changed),
        }
    }
}

/// Where the processes run.
#[derive(Debug)]
pub struct Executors {
    /// All that controls.
    pub control: Executor,
    /// The simulated machine.
    pub mechanism: Executor,
    /// The joystick.
    pub operator: Executor,
}

/// Adds the model's processes, which control the machine behind `registers`. Returns handles to the
/// results of pan and of tilt.
///
/// # Errors
///
/// Those of [`spawn`](luna::system::ProcessBuilder::spawn).
pub fn build(
    executors: &Executors,
    registers: [Registers; 2],
    settings: Settings,
) -> luna::Result<[Arc<Findings>; 2]> {
    let Settings {
        period,
        cycles,
        start,
        joystick,
    } = settings;
    let control = &executors.control;
    let (fault, faults) = luna::channel();
    let fault = fault.named("faults");
    let build_axis = |index: usize, registers: Registers| {
        let (stick, joystick) = luna::buffered(Buffer::overwrite_oldest(1));
        let (stop, stopped) = luna::buffered(Buffer::overwrite_oldest(1));
        let (tick, ticks) = luna::channel();
        let name = |what: &str| format!("{} {what}", AXES[index].name);
        let stick = stick.named(&name("joystick"));
        let stop = stop.named(&name("stop"));
        let tick = tick.named(&name("tick"));
        let model = AxisModel {
            executor: control,
            axis: &AXES[index],
            index,
            period,
            start,
        };
        let findings = model.build(registers, ticks, joystick, stopped, &fault)?;
        Ok::<_, luna::Error>((findings, tick, stick, stop))
    };
    let [pan, tilt] = registers;
    let (pan, pan_tick, pan_stick, pan_stop) = build_axis(0, pan)?;
    let (tilt, tilt_tick, tilt_stick, tilt_stop) = build_axis(1, tilt)?;
    // The last sender must be one that watches.
    drop(fault);

    control
        .process(LOOP)
        .priority(level::TIMER)
        .spawn(write_timer(period, cycles, [pan_tick, tilt_tick]))?;
    control
        .process("safety")
        .priority(level::SAFETY)
        .spawn(keep_safe(faults, [pan_stop, tilt_stop]))?;
    // A set-up may replace it by a real one.
    executors.operator.process(JOYSTICK).replaceable(
        Sticks([pan_stick, tilt_stick]),
        |Sticks(sticks)| Joystick {
            playback: joystick,
            sticks,
        },
    )?;
    Ok([pan, tilt])
}

/// An upper limit of the joint's speed, in rad/s: that of the motor without friction at full duty,
/// and a fifth more.
fn fastest(motor: &MotorParameters) -> f64 {
    1.2 * motor.supply / motor.joint_constant()
}

/// One axis' part of the model.
struct AxisModel<'a> {
    executor: &'a Executor,
    axis: &'static Axis,
    index: usize,
    period: Duration,
    start: Start,
}

impl AxisModel<'_> {
    fn build(
        &self,
        registers: Registers,
        ticks: Receiver<Tick>,
        joystick: Receiver<f64>,
        stopped: Receiver<()>,
        fault: &Sender<(usize, Fault)>,
    ) -> luna::Result<Arc<Findings>> {
        let (axis, index) = (self.axis, self.index);
        let findings = Arc::new(Findings::default());
        let Registers { count, pwm, enable } = registers;

        // The readers.
        let (read_position_now, position_ticks) = self.channel("position tick");
        let (read_joystick_now, joystick_ticks) = self.channel("joystick tick");
        let (to_scale, counts) = self.channel("count read");
        let (to_joystick_scaling, deflections) = self.channel("deflection");
        let (to_calibration, positions) = self.channel("position");
        let (to_encoder_watch, watched_positions) = self.channel("watched position");
        let (target, targets) = self.channel("target");
        let decoder = Decoder::new(axis.plant.gear_ratio, axis.count_at_zero);
        self.add(
            "timer in",
            read_timer(ticks, read_position_now, read_joystick_now),
        )?;
        self.add(
            "position in",
            read_position(axis.count_at_zero, position_ticks, count, to_scale),
        )?;
        self.add(
            "joystick in",
            read_joystick(joystick_ticks, joystick, to_joystick_scaling),
        )?;
        self.add(
            "position scaling",
            scale_position(decoder, counts, [to_calibration, to_encoder_watch]),
        )?;
        self.add(
            "joystick scaling",
            scale_joystick(axis, deflections, target),
        )?;

        // The control.
        let (demand, demands) = self.channel("demand");
        let (led, followed) = self.channel("led demand");
        let (error, errors) = self.channel("error");
        let (voltage, voltages) = self.channel("voltage");
        let (duty, duties) = self.channel("duty");
        let gains = Gains::place(&axis.plant, axis.tuning, self.period.as_secs_f64());
        let calibration = match self.start {
            Start::Calibrate => Calibration::new(2.0 * axis.plant.end_stop),
            Start::Calibrated => Calibration::known(0.0),
        };
        self.add(
            "calibration",
            calibrate(
                calibration,
                positions,
                targets,
                demand,
                index,
                fault.clone(),
            ),
        )?;
        self.add(
            "set-point",
            lead(SetPoint::new(axis.max_speed), demands, led),
        )?;
        let controller = self.process("controller");
        let tunable = TunableGains::declare(&controller, axis.name, gains)?;
        let body = Controller {
            gains,
            tunable,
            supply: axis.plant.supply,
            demands: followed,
            errors: error,
            voltages: voltage,
        };
        controller.spawn(body.run())?;
        self.add(
            "tracking",
            Track {
                axis: axis.name,
                error: None,
                tracking: Tracking::default(),
                errors,
                findings: Arc::clone(&findings),
            },
        )?;
        self.add(
            "output scaling",
            ScaleOutput {
                axis: axis.name,
                supply: axis.plant.supply,
                voltages,
                duties: duty,
                seen: None,
            },
        )?;

        // The safety layer.
        let (out, received) = self.channel("command");
        let (to_limit, commands) = self.channel("received");
        let (limited, to_slew) = self.channel("limited");
        let (slewed, to_guard) = self.channel("slewed");
        let (guarded, to_gate) = self.channel("guarded");
        let (seen, applied) = self.channel("applied");
        self.add("command out", pass_on(duties, out))?;
        self.add("command in", pass_on(received, to_limit))?;
        self.add(
            "limit",
            Checking {
                sanity: axis.limits.limit()?,
                angle: |command| Some(command.raw),
                commands,
                checked: limited,
                findings: Arc::clone(&findings),
                left: |findings| &findings.limit,
            },
        )?;
        self.add(
            "slew",
            Checking {
                sanity: axis.limits.slew()?,
                angle: |command| Some(command.raw),
                commands: to_slew,
                checked: slewed,
                findings: Arc::clone(&findings),
                left: |findings| &findings.slew,
            },
        )?;
        self.add(
            "end-stop guard",
            Checking {
                sanity: axis.limits.guard()?,
                // There is none during calibration.
                angle: |command| command.angle,
                commands: to_guard,
                checked: guarded,
                findings: Arc::clone(&findings),
                left: |findings| &findings.guard,
            },
        )?;
        let (drive, drives) = self.channel("drive");
        self.add("gate", gate(to_gate, stopped, seen, drive))?;
        self.add(
            "encoder watch",
            watch_encoder(
                faults::encoder(fastest(&axis.plant))?,
                index,
                watched_positions,
                fault.clone(),
            ),
        )?;
        self.add(
            "motion watch",
            watch_motion(faults::motion()?, index, applied, fault.clone()),
        )?;

        // The writers.
        let (enable_out, enables) = self.channel("enable out");
        let (pwm_out, pwms) = self.channel("pwm out");
        self.add("motor out", write_motor(drives, enable_out, pwm_out))?;
        self.add("enable out", write_register(false, enables, enable))?;
        self.add("pwm out", write_register(0.0, pwms, pwm))?;
        Ok(findings)
    }

    /// A channel of this axis, with a name for the scope and for reports.
    fn channel<T: Send>(&self, name: &str) -> (Sender<T>, Receiver<T>) {
        let (sender, receiver) = luna::channel();
        (
            sender.named(&format!("{} {name}", self.axis.name)),
            receiver,
        )
    }

    fn add<M>(&self, part: &str, process: impl IntoProcess<M>) -> luna::Result<()> {
        self.process(part).spawn(process)?;
        Ok(())
    }

    fn process(&self, part: &str) -> ProcessBuilder {
        let name = format!("{} {part}", self.axis.name);
        self.executor
            .process(name)
            .priority(level::AXES[self.index])
    }
}
