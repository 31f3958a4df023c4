//! The machine on the other side of the card's pins.

use crate::card::{Card, ENCODERS, PWMS};
use luna_plants::{Checked, Plant, PlantError};
use std::time::Duration;

/// A machine that the card is wired to.
pub trait World: Send {
    /// Advances time to `now` (ns): takes the card's outputs, and turns its encoders. Called before
    /// each packet and about each half millisecond, possibly with the time of the last call.
    fn advance(&mut self, now: u64, card: &mut Card);
}

/// Nothing is wired.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoWorld;

impl World for NoWorld {
    fn advance(&mut self, _: u64, _: &mut Card) {}
}

impl<F: FnMut(u64, &mut Card) + Send> World for F {
    fn advance(&mut self, now: u64, card: &mut Card) {
        self(now, card);
    }
}

/// The shortest step: computing the plant must not delay the card's answers.
const SHORTEST: u64 = 200_000;
/// The longest step: if this computer stops the simulation for a while, the machine stands still,
/// instead of jumping.
const LONGEST: u64 = 5_000_000;

/// A plant with duties, −1 to 1, as inputs and counts as outputs.
///
/// After a failure it stands still, and returns the error.
pub struct PlantWorld<P> {
    plant: Checked<P>,
    /// Which PWM generator drives which input.
    drives: Vec<(usize, usize)>,
    /// Which encoder counts which output.
    counts: Vec<(usize, usize)>,
    last: Option<u64>,
    failure: Option<PlantError>,
    watch: Option<Watch<P>>,
}

type Watch<P> = Box<dyn FnMut(&P) + Send>;

impl<P: Plant> PlantWorld<P> {
    /// PWM generator n drives the plant's input n, encoder n counts its output n, for all n that
    /// both have.
    pub fn new(plant: P) -> Self {
        let (inputs, outputs) = (plant.inputs().len(), plant.outputs().len());
        Self {
            plant: Checked::new(plant),
            drives: (0..inputs.min(PWMS)).map(|n| (n, n)).collect(),
            counts: (0..outputs.min(ENCODERS)).map(|n| (n, n)).collect(),
            last: None,
            failure: None,
            watch: None,
        }
    }

    /// Calls `watch` with the plant after each step.
    #[must_use]
    pub fn watched(mut self, watch: impl FnMut(&P) + Send + 'static) -> Self {
        self.watch = Some(Box::new(watch));
        self
    }

    fn step(&mut self, time: Duration, now: u64, card: &mut Card) -> Result<(), PlantError> {
        for (pwm, input) in &self.drives {
            self.plant.set_input(*input, card.duty(*pwm))?;
        }
        if !time.is_zero() {
            self.plant.step(time)?;
        }
        let outputs = self.plant.outputs()?;
        for (encoder, output) in &self.counts {
            // A cast saturates.
            card.turn_encoder(*encoder, outputs[*output].floor() as i64, now);
        }
        Ok(())
    }
}

impl<P: Plant + Send> World for PlantWorld<P> {
    fn advance(&mut self, now: u64, card: &mut Card) {
        if self.failure.is_some() {
            return;
        }
        let elapsed = match self.last {
            None => 0,
            Some(last) => match now.saturating_sub(last) {
                0..SHORTEST => return,
                elapsed => elapsed.min(LONGEST),
            },
        };
        self.last = Some(now);
        if let Err(error) = self.step(Duration::from_nanos(elapsed), now, card) {
            eprintln!("mesa-sim: the plant has failed and stands still: {error}");
            self.failure = Some(error);
        }
        if let Some(watch) = &mut self.watch {
            watch(self.plant.plant());
        }
    }
}

luna_platform::debug_fields!(
    impl[P] PlantWorld<P>, |world|
    drives: world.drives,
    counts: world.counts,
    failure: world.failure
);
