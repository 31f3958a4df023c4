//! The process that a plant is.

use super::ends::{Gone, Pump, Slot};
use super::{Actuator, PlantLink, Sensor};
use crate::error::{PlantFailure, Side};
use crate::{Checked, Plant, PlantError};
use luna::{Error, Process};
use std::fmt;
use std::future::{Future, poll_fn};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

/// When a plant is stepped.
#[derive(Debug, Clone, Copy)]
pub(super) enum Pace {
    /// In each slot of a loop of this period, by what has gone by.
    Periodic(Duration),
    /// By this, in each exchange.
    LockStep(Duration),
}

impl Pace {
    pub(super) fn time(self) -> Duration {
        match self {
            Pace::Periodic(time) | Pace::LockStep(time) => time,
        }
    }
}

/// A plant as a process: see [`PlantLink::periodic`] and [`PlantLink::lock_step`].
#[must_use = "a plant is a process: spawn it"]
pub struct PlantProcess<P> {
    link: PlantLink<P>,
    pace: Pace,
    /// The last value of each actuator, and whether its writer still exists.
    latched: Box<[Latch]>,
    /// The same numbers as the sensors'.
    is_read: Box<[bool]>,
    /// Of the actuators, then of the sensors. For exchanges.
    slots: Box<[Slot]>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Latch {
    value: Option<f64>,
    has_ended: bool,
}

impl<P: Plant> PlantProcess<P> {
    pub(super) fn new(link: PlantLink<P>, pace: Pace) -> Self {
        Self {
            latched: vec![Latch::default(); link.actuators.len()].into(),
            is_read: vec![true; link.sensors.len()].into(),
            slots: vec![Slot::new(None); link.actuators.len() + link.sensors.len()].into(),
            link,
            pace,
        }
    }
}

impl<P: Plant + Send> Process for PlantProcess<P> {
    fn run(&mut self) -> impl Future<Output = luna::Result<()>> {
        let PlantLink {
            name,
            plant,
            actuators,
            sensors,
            enabled,
            ..
        } = &mut self.link;
        let (actuators, sensors) = (&**actuators, &**sensors);
        let body = Body {
            plant,
            actuators,
            sensors,
            enabled,
            latched: &mut self.latched,
            is_read: &mut self.is_read,
        };
        let (of_actuators, of_sensors) = self.slots.split_at(actuators.len());
        // Now, while the body is made: this allocates.
        let pumps = match self.pace {
            Pace::Periodic(_) => Pumps::default(),
            Pace::LockStep(_) => Pumps::of(actuators, of_actuators, sensors, of_sensors),
        };
        let pace = self.pace;
        async move {
            let ended = match pace {
                Pace::Periodic(period) => body.go_on(name, period).await,
                Pace::LockStep(step) => body.exchange(step, pumps, of_actuators, of_sensors).await,
            };
            match ended {
                Ok(()) => Ok(()),
                Err(Stop::Luna(error)) => Err(error),
                Err(Stop::Failed(error)) => Err(fail(name, error, actuators, sensors)),
            }
        }
    }

    fn post_run(&mut self) {
        if let Some(at_end) = self.link.at_end.take() {
            at_end(self.link.plant.plant());
        }
    }
}

/// Fails the plant. First its channels are poisoned, so that no process that runs for the emergency
/// receives an old value. That delays the emergency by O(ports).
fn fail(name: &Arc<str>, error: PlantError, actuators: &[Actuator], sensors: &[Sensor]) -> Error {
    for sensor in sensors {
        sensor.end.poison();
    }
    for actuator in actuators {
        actuator.end.poison();
    }
    // It allocates; there is nothing left to be in time for.
    luna::realtime::off_path(|| {
        luna::emergency(Error::other(PlantFailure {
            plant: name.clone(),
            error,
        }))
    })
}

enum Stop {
    Luna(Error),
    Failed(PlantError),
}

impl From<PlantError> for Stop {
    fn from(error: PlantError) -> Stop {
        Stop::Failed(error)
    }
}

struct Body<'a, P> {
    plant: &'a mut Checked<P>,
    actuators: &'a [Actuator],
    sensors: &'a [Sensor],
    enabled: &'a AtomicBool,
    latched: &'a mut [Latch],
    is_read: &'a mut [bool],
}

impl<P: Plant> Body<'_, P> {
    async fn go_on(mut self, name: &str, period: Duration) -> Result<(), Stop> {
        let began = luna::now();
        let mut tick = luna::periodic(name, period).map_err(Stop::Luna)?;
        self.send_outputs()?;
        let mut last = None;
        while !self.has_ended() {
            let cycle = tick.next().await;
            let slot = cycle.deadline;
            // First what was applied until now, then what was written meanwhile.
            self.set_inputs()?;
            // A missed slot is part of the time.
            match last.replace(slot) {
                Some(last) => self.plant.step(slot - last)?,
                None => self.step_to_first(slot - began, period, cycle.number)?,
            }
            self.listen()?;
            self.send_outputs()?;
        }
        Ok(())
    }

    /// The time from the loop's creation to its first served slot, which is number `slots` of its
    /// grid and begins `elapsed` after the clock was read.
    fn step_to_first(
        &mut self,
        elapsed: Duration,
        period: Duration,
        slots: u64,
    ) -> Result<(), PlantError> {
        let nanos = period.as_nanos().saturating_mul(slots.into());
        let on_grid = Duration::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX));
        // A grid of the loop's own begins just after that reading. A common one is older, and its
        // first slot comes earlier.
        let elapsed = elapsed.min(on_grid);
        // A period first, also if slots were missed: an FMU with steps of one length uses the
        // length of its first step.
        let first = elapsed.min(period);
        self.plant.step(first)?;
        match elapsed - first {
            Duration::ZERO => Ok(()),
            rest => self.plant.step(rest),
        }
    }

    async fn exchange(
        mut self,
        step: Duration,
        mut pumps: Pumps<'_>,
        of_actuators: &[Slot],
        of_sensors: &[Slot],
    ) -> Result<(), Stop> {
        loop {
            let outputs = checked(self.plant, self.sensors)?;
            for ((sensor, slot), is_read) in self.sensors.iter().zip(of_sensors).zip(&*self.is_read)
            {
                slot.set(is_read.then_some(outputs[sensor.output]));
            }
            poll_fn(|cx| self.poll_exchange(cx, &mut pumps, of_actuators, of_sensors)).await?;
            if self.has_ended() || self.latched.iter().any(|latch| latch.has_ended) {
                return Ok(());
            }
            for (latch, slot) in self.latched.iter_mut().zip(of_actuators) {
                latch.value = slot.take();
            }
            self.set_inputs()?;
            self.plant.step(step)?;
        }
    }

    /// Ready when each sensor's value is sent and one value of each actuator has come, or when an
    /// actuator's writers are gone.
    fn poll_exchange(
        &mut self,
        cx: &mut Context<'_>,
        pumps: &mut Pumps<'_>,
        of_actuators: &[Slot],
        of_sensors: &[Slot],
    ) -> Poll<Result<(), Stop>> {
        let mut is_complete = true;
        let sensors = pumps.sensors.iter_mut().zip(of_sensors);
        for ((pump, slot), is_read) in sensors.zip(&mut *self.is_read) {
            if slot.get().is_none() {
                continue;
            }
            match pump.as_mut().poll(cx) {
                Poll::Ready(Gone::Poisoned) => {
                    return Poll::Ready(Err(Stop::Luna(Error::Poisoned)));
                }
                Poll::Ready(Gone::Closed) => {
                    *is_read = false;
                    slot.set(None);
                }
                Poll::Pending => is_complete &= slot.get().is_none(),
            }
        }
        let actuators = pumps.actuators.iter_mut().zip(of_actuators);
        for ((pump, slot), latch) in actuators.zip(&mut *self.latched) {
            if slot.get().is_some() {
                continue;
            }
            match pump.as_mut().poll(cx) {
                Poll::Ready(Gone::Poisoned) => {
                    return Poll::Ready(Err(Stop::Luna(Error::Poisoned)));
                }
                Poll::Ready(Gone::Closed) => {
                    latch.has_ended = true;
                    return Poll::Ready(Ok(()));
                }
                Poll::Pending => is_complete &= slot.get().is_some(),
            }
        }
        if is_complete {
            Poll::Ready(Ok(()))
        } else {
            Poll::Pending
        }
    }

    /// Applies the actuators' values to the plant.
    fn set_inputs(&mut self) -> Result<(), PlantError> {
        let is_enabled = self.enabled.load(Ordering::Relaxed);
        for (actuator, latch) in self.actuators.iter().zip(&*self.latched) {
            match latch.value {
                Some(value) if is_enabled => self.plant.set_input(actuator.input, value)?,
                _ => self.plant.set_neutral(actuator.input),
            }
        }
        Ok(())
    }

    fn listen(&mut self) -> Result<(), Stop> {
        for (actuator, latch) in self.actuators.iter().zip(&mut *self.latched) {
            if latch.has_ended {
                continue;
            }
            match actuator.end.newest() {
                Ok(Some(value)) => latch.value = Some(value),
                Ok(None) => {}
                Err(Gone::Closed) => latch.has_ended = true,
                Err(Gone::Poisoned) => return Err(Stop::Luna(Error::Poisoned)),
            }
        }
        Ok(())
    }

    fn send_outputs(&mut self) -> Result<(), Stop> {
        let outputs = checked(self.plant, self.sensors)?;
        for (sensor, is_read) in self.sensors.iter().zip(&mut *self.is_read) {
            if !*is_read {
                continue;
            }
            match sensor.end.offer(outputs[sensor.output]) {
                Ok(()) => {}
                Err(Gone::Closed) => *is_read = false,
                Err(Gone::Poisoned) => return Err(Stop::Luna(Error::Poisoned)),
            }
        }
        Ok(())
    }

    fn has_ended(&self) -> bool {
        if self.latched.is_empty() {
            self.is_read.iter().all(|is_read| !is_read)
        } else {
            self.latched.iter().all(|latch| latch.has_ended)
        }
    }
}

/// All outputs, converted for their channels: all of them are sent, or none.
fn checked<'p, P: Plant>(
    plant: &'p mut Checked<P>,
    sensors: &[Sensor],
) -> Result<&'p [f64], PlantError> {
    let refused = {
        let outputs = plant.outputs()?;
        sensors.iter().find_map(|sensor| {
            let value = outputs[sensor.output];
            let into = sensor.end.refuses(value)?;
            Some((sensor.output, value, into))
        })
    };
    if let Some((output, value, into)) = refused {
        return Err(PlantError::DoesNotFit {
            side: Side::Output,
            port: plant.plant().outputs()[output].shared_name(),
            value,
            into,
        });
    }
    plant.outputs()
}

/// The pending operations, one for each channel.
#[derive(Default)]
struct Pumps<'a> {
    actuators: Vec<Pump<'a>>,
    sensors: Vec<Pump<'a>>,
}

impl<'a> Pumps<'a> {
    fn of(
        actuators: &'a [Actuator],
        of_actuators: &'a [Slot],
        sensors: &'a [Sensor],
        of_sensors: &'a [Slot],
    ) -> Self {
        Self {
            actuators: actuators
                .iter()
                .zip(of_actuators)
                .map(|(actuator, slot)| actuator.end.pump(slot))
                .collect(),
            sensors: sensors
                .iter()
                .zip(of_sensors)
                .map(|(sensor, slot)| sensor.end.pump(slot))
                .collect(),
        }
    }
}

impl Drop for Pumps<'_> {
    /// Freeing memory on the real-time path is accepted here: it happens once, at the end of the
    /// body, when no deadline is left.
    fn drop(&mut self) {
        luna::realtime::off_path(|| {
            self.actuators = Vec::new();
            self.sensors = Vec::new();
        });
    }
}

impl<P> fmt::Debug for PlantProcess<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PlantProcess")
            .field("name", &self.link.name)
            .field("pace", &self.pace)
            .finish_non_exhaustive()
    }
}
