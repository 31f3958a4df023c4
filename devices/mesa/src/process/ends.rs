//! The far ends of the channels.

use crate::{Actuator, Fault, Health, Reading, Sample};
use hostmot2::{Layout, Outputs};
use luna::devices::SetPoints;
use luna::{Receiver, Sender};

/// What the card measures.
#[derive(Debug, Default)]
pub(crate) struct Sensors {
    pub(super) encoders: Vec<EncoderEnd>,
    pub(super) inputs: Vec<InputEnd>,
}

#[derive(Debug)]
pub(super) struct EncoderEnd {
    pub(super) number: usize,
    pub(super) fastest: f64,
    pub(super) channel: Sender<Sample<Reading>>,
}

#[derive(Debug)]
pub(super) struct InputEnd {
    pub(super) pin: u8,
    pub(super) channel: Sender<Sample<bool>>,
}

impl Sensors {
    pub(crate) fn add_encoder(
        &mut self,
        number: usize,
        fastest: f64,
        channel: Sender<Sample<Reading>>,
    ) {
        self.encoders.push(EncoderEnd {
            number,
            fastest,
            channel,
        });
    }

    pub(crate) fn add_input(&mut self, pin: u8, channel: Sender<Sample<bool>>) {
        self.inputs.push(InputEnd { pin, channel });
    }

    /// Returns an error's text for an invalid setting.
    pub(crate) fn wrong(&self) -> Option<&'static str> {
        let is_positive = |end: &EncoderEnd| end.fastest > 0.0 && end.fastest.is_finite();
        if !self.encoders.iter().all(is_positive) {
            return Some("an encoder's greatest speed is a finite number of counts a second");
        }
        is_doubled(self.encoders.iter().map(|end| end.number))
            .then_some("an encoder is connected twice")
    }

    pub(crate) fn pin_beyond(&self, width: u32) -> Option<u8> {
        let mut pins = self.inputs.iter().map(|end| end.pin);
        pins.find(|pin| u32::from(*pin) >= width)
    }

    pub(super) fn poison(&self) {
        for end in &self.encoders {
            end.channel.poison();
        }
        for end in &self.inputs {
            end.channel.poison();
        }
    }
}

/// What the card puts out.
#[derive(Debug, Default)]
pub(crate) struct Actuators {
    pwms: Vec<PwmEnd>,
    outputs: Vec<OutputEnd>,
}

#[derive(Debug)]
struct PwmEnd {
    number: usize,
    duty: SetPoints<f64>,
    /// Without one it is enabled by a duty.
    enable: Option<SetPoints<bool>>,
}

#[derive(Debug)]
struct OutputEnd {
    number: usize,
    pin: u8,
    neutral: bool,
    level: SetPoints<bool>,
}

impl Actuators {
    pub(crate) fn add_pwm(
        &mut self,
        number: usize,
        duty: Receiver<f64>,
        enable: Option<Receiver<bool>>,
    ) {
        self.pwms.push(PwmEnd {
            number,
            duty: SetPoints::new(duty),
            enable: enable.map(SetPoints::new),
        });
    }

    pub(crate) fn add_output(
        &mut self,
        number: usize,
        pin: u8,
        neutral: bool,
        level: Receiver<bool>,
    ) {
        self.outputs.push(OutputEnd {
            number,
            pin,
            neutral,
            level: SetPoints::new(level),
        });
    }

    /// The text of an error for an invalid setting.
    pub(crate) fn wrong(&self) -> Option<&'static str> {
        is_doubled(self.pwms.iter().map(|end| end.number))
            .then_some("a PWM generator is connected twice")
    }

    pub(super) fn are_none(&self) -> bool {
        self.pwms.is_empty() && self.outputs.is_empty()
    }

    /// Sets the limit of cycles for set-points of `actuator`. False if it does not exist.
    pub(crate) fn set_greatest_age(&mut self, actuator: Actuator, cycles: Option<u32>) -> bool {
        let pwm = |number: u8| move |end: &&mut PwmEnd| end.number == usize::from(number);
        let pwms = &mut self.pwms;
        let set_age = match actuator {
            Actuator::Pwm(number) => {
                let end = pwms.iter_mut().find(pwm(number));
                end.map(|end| end.duty.greatest_age(cycles))
            }
            Actuator::Enable(number) => {
                let end = pwms.iter_mut().find(pwm(number));
                let enable = end.and_then(|end| end.enable.as_mut());
                enable.map(|enable| enable.greatest_age(cycles))
            }
            Actuator::Output(pin) => {
                let end = self.outputs.iter_mut().find(|end| end.pin == pin);
                end.map(|end| end.level.greatest_age(cycles))
            }
        };
        set_age.is_some()
    }

    /// Lets those of all duties and pins be so old; an enable may stay.
    pub(crate) fn set_all_greatest_ages(&mut self, cycles: u32) {
        for end in &mut self.pwms {
            end.duty.greatest_age(Some(cycles));
        }
        for end in &mut self.outputs {
            end.level.greatest_age(Some(cycles));
        }
    }

    /// An overdue actuator, and its number of cycles without a new value.
    pub(super) fn overdue(&self) -> Option<(Actuator, u32)> {
        let of_pwms = self.pwms.iter().find_map(|end| {
            let number = end.number as u8;
            let duty = end.duty.overdue();
            let duty = duty.map(|cycles| (Actuator::Pwm(number), cycles));
            let enable = || end.enable.as_ref().and_then(SetPoints::overdue);
            // Without a duty it is off, whatever its enable is.
            let is_late = || enable().filter(|_| !end.duty.has_ended());
            duty.or_else(|| is_late().map(|cycles| (Actuator::Enable(number), cycles)))
        });
        let of_output = |end: &OutputEnd| {
            let overdue = end.level.overdue();
            overdue.map(|cycles| (Actuator::Output(end.pin), cycles))
        };
        of_pwms.or_else(|| self.outputs.iter().find_map(of_output))
    }

    /// Takes the newest values. Returns whether all writers have gone.
    ///
    /// # Errors
    ///
    /// A writer exists but sends nothing any more while the link `is_driving`.
    pub(super) fn take(
        &mut self,
        layout: &Layout,
        to: &mut Outputs,
        health: &Health,
        is_driving: bool,
    ) -> Result<bool, Fault> {
        let mut have_ended = !self.are_none();
        for end in &mut self.pwms {
            let duty = end.duty.take(is_driving);
            let is_enabled = match &mut end.enable {
                Some(enable) => enable.take(is_driving).unwrap_or(false) && duty.is_some(),
                None => duty.is_some(),
            };
            let duty = duty.unwrap_or(0.0);
            if duty.is_nan() {
                health.not_finite.add();
            }
            to.set_duty(end.number, if duty.is_nan() { 0.0 } else { duty });
            to.set_enabled(end.number, is_enabled);
            have_ended &= end.duty.has_ended();
        }
        for end in &mut self.outputs {
            let level = end.level.take(is_driving).unwrap_or(end.neutral);
            layout.set_output(to, end.number, level);
            have_ended &= end.level.has_ended();
        }
        match self.overdue() {
            Some((actuator, cycles)) if !have_ended => Err(Fault::Overdue { actuator, cycles }),
            _ => Ok(have_ended),
        }
    }

    pub(super) fn poison(&self) {
        for end in &self.pwms {
            end.duty.poison();
            if let Some(enable) = &end.enable {
                enable.poison();
            }
        }
        for end in &self.outputs {
            end.level.poison();
        }
    }
}

fn is_doubled(numbers: impl Iterator<Item = usize> + Clone) -> bool {
    numbers
        .clone()
        .any(|number| numbers.clone().filter(|other| *other == number).count() > 1)
}
