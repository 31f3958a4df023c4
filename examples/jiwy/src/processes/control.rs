//! From an axis' position and target to its motor's duty.

use super::readers::Position;
use crate::network::Findings;
use crate::parts::calibration::{Calibration, Step};
use crate::parts::faults::Fault;
use crate::parts::pid::{Gains, Pid};
use crate::parts::set_point::SetPoint;
use crate::parts::tracking::Tracking;
use luna::prelude::*;
use luna::system::ProcessBuilder;
use std::sync::Arc;
use std::time::Duration;

/// The target of an axis.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Goal {
    /// To be driven by this duty: it is being calibrated.
    Drive(f64),
    /// To be at this angle, in rad.
    Be(f64),
}

/// The target of an axis, and its position.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Demand {
    goal: Goal,
    /// In rad; from wherever its encoder counts, while it is being calibrated.
    angle: f64,
    /// Since the cycle before.
    elapsed: Duration,
}

/// A request to a motor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Command {
    /// Volts from the controller, then the part of the supply's.
    pub(crate) duty: f64,
    /// As measured, in rad; nothing while the axis is being calibrated.
    pub(crate) angle: Option<f64>,
    /// As measured, in rad, from wherever the encoder counts.
    pub(crate) raw: f64,
    /// Since the cycle before.
    pub(crate) elapsed: Duration,
}

/// Searches for the end stops, then sends the axis' position and passes on its target.
pub(crate) async fn calibrate(
    mut calibration: Calibration,
    positions: Receiver<Position>,
    targets: Receiver<f64>,
    demands: Sender<Demand>,
    axis: usize,
    faults: Sender<(usize, Fault)>,
) -> luna::Result<()> {
    while let Ok(Position { raw, elapsed, .. }) = positions.recv().await {
        let target = targets.recv().await?;
        let (goal, angle) = match calibration.step(raw, elapsed.as_secs_f64()) {
            Ok(Step::Drive(duty)) => (Goal::Drive(duty), raw),
            Ok(Step::At(angle)) => (Goal::Be(target), angle),
            Err(error) => {
                faults.send((axis, Fault::Calibration(error))).await?;
                (Goal::Drive(0.0), raw)
            }
        };
        demands
            .send(Demand {
                goal,
                angle,
                elapsed,
            })
            .await?;
    }
    Ok(())
}

/// Moves the set-point no faster than the axis can follow.
pub(crate) async fn lead(
    mut set_point: SetPoint,
    demands: Receiver<Demand>,
    led: Sender<Demand>,
) -> luna::Result<()> {
    let mut calibrated = false;
    while let Ok(mut demand) = demands.recv().await {
        if let Goal::Be(wanted) = demand.goal {
            if !calibrated {
                set_point.begin_at(demand.angle);
                calibrated = true;
            }
            demand.goal = Goal::Be(set_point.follow(wanted, demand.elapsed.as_secs_f64()));
        }
        led.send(demand).await?;
    }
    Ok(())
}

/// The controller of an axis, with gains that are parameters of the system.
pub(crate) struct Controller {
    pub(crate) gains: Gains,
    pub(crate) tunable: TunableGains,
    pub(crate) supply: f64,
    pub(crate) demands: Receiver<Demand>,
    pub(crate) errors: Sender<f64>,
    pub(crate) voltages: Sender<Command>,
}

/// What can be replaced of a controller's gains.
pub(crate) struct TunableGains {
    proportional: Parameter<f64>,
    integral: Parameter<f64>,
    derivative: Parameter<f64>,
    filter: Parameter<f64>,
}

impl TunableGains {
    /// Declares them for the process that is to be the controller.
    pub(crate) fn declare(
        controller: &ProcessBuilder,
        axis: &str,
        gains: Gains,
    ) -> luna::Result<Self> {
        let gain = |part: &str, default| controller.parameter(&format!("{axis}/{part}"), default);
        Ok(Self {
            proportional: gain("kp", gains.proportional)
                .unit("1/rad")
                .range(0.0..=1000.0)
                .description("duty by error")
                .register()?,
            integral: gain("ki", gains.integral)
                .unit("1/(rad·s)")
                .range(0.0..=10_000.0)
                .description("duty by the error's integral")
                .register()?,
            derivative: gain("kd", gains.derivative)
                .unit("s/rad")
                .range(0.0..=100.0)
                .description("duty by the measured speed")
                .register()?,
            filter: gain("filter", gains.filter)
                .unit("s")
                .range(1e-5..=1.0)
                .description("time constant of the measured speed")
                .register()?,
        })
    }

    /// The gains from here to the next call: all of one set.
    fn take(&self, limit: f64) -> Gains {
        self.proportional.latch();
        Gains {
            proportional: self.proportional.get(),
            integral: self.integral.get(),
            derivative: self.derivative.get(),
            filter: self.filter.get(),
            limit,
        }
    }
}

impl Controller {
    pub(crate) async fn run(self) -> luna::Result<()> {
        let mut pid = Pid::new(self.gains);
        while let Ok(demand) = self.demands.recv().await {
            let Demand {
                goal,
                angle,
                elapsed,
            } = demand;
            pid.set_gains(self.tunable.take(self.gains.limit));
            let (duty, angle, raw) = match goal {
                Goal::Drive(duty) => (duty, None, angle),
                Goal::Be(target) => {
                    self.errors.send(target - angle).await?;
                    let duty = pid.update(target, angle, elapsed.as_secs_f64());
                    (duty, Some(angle), angle)
                }
            };
            self.voltages
                .send(Command {
                    duty: duty * self.supply,
                    angle,
                    raw,
                    elapsed,
                })
                .await?;
        }
        Ok(())
    }
}

/// Sums up how far the axis was from its set-point.
pub(crate) struct Track {
    pub(crate) axis: &'static str,
    pub(crate) error: Option<Signal<f64>>,
    pub(crate) tracking: Tracking,
    pub(crate) errors: Receiver<f64>,
    pub(crate) findings: Arc<Findings>,
}

impl Process for Track {
    fn pre_run(&mut self) -> luna::Result<()> {
        let signal = Signal::with_unit(&format!("{}/error", self.axis), "deg");
        self.error = Some(signal.description("set-point less angle").register()?);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        while let Ok(error) = self.errors.recv().await {
            if let Some(signal) = &self.error {
                signal.record(error.to_degrees());
            }
            self.tracking.add(error);
        }
        Ok(())
    }

    fn post_run(&mut self) {
        let _ = self.findings.tracking.set(self.tracking);
    }
}

/// Converts volts to a fraction of the supply for the bridge. Records the axis' signals for
/// recordings and the scope.
pub(crate) struct ScaleOutput {
    pub(crate) axis: &'static str,
    pub(crate) supply: f64,
    pub(crate) voltages: Receiver<Command>,
    pub(crate) duties: Sender<Command>,
    pub(crate) seen: Option<Seen>,
}

/// The signals of an axis.
pub(crate) struct Seen {
    angle: Signal<f64>,
    voltage: Signal<f64>,
}

impl Process for ScaleOutput {
    fn pre_run(&mut self) -> luna::Result<()> {
        let name = |what: &str| format!("{}/{what}", self.axis);
        self.seen = Some(Seen {
            angle: Signal::with_unit(&name("angle"), "deg")
                .description("as measured")
                .register()?,
            voltage: Signal::with_unit(&name("voltage"), "V")
                .description("the controller's output")
                .register()?,
        });
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        while let Ok(mut command) = self.voltages.recv().await {
            if let Some(seen) = &self.seen {
                if let Some(angle) = command.angle {
                    seen.angle.record(angle.to_degrees());
                }
                seen.voltage.record(command.duty);
            }
            command.duty /= self.supply;
            self.duties.send(command).await?;
        }
        Ok(())
    }
}

/// A process that only passes values on: the writer of one sub-model, or the reader of the next, as
/// generated by a model's editor.
pub(crate) async fn pass_on<T>(from: Receiver<T>, to: Sender<T>) -> luna::Result<()> {
    while let Ok(value) = from.recv().await {
        to.send(value).await?;
    }
    Ok(())
}
