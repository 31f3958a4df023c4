//! The far ends of the channels.

use crate::{Health, Reading, Sample};
use hostmot2::{Layout, Outputs};
use luna::{Receiver, Sender, TryRecvError};

/// How many values are taken of one channel at a time: a register has one.
const MOST_AT_ONCE: usize = 16;

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

    /// What makes no sense, in words.
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
    duty: Input<f64>,
    /// Without one it is enabled by a duty.
    enable: Option<Input<bool>>,
}

#[derive(Debug)]
struct OutputEnd {
    number: usize,
    neutral: bool,
    level: Input<bool>,
}

/// What has come from a channel last.
#[derive(Debug)]
struct Input<T> {
    channel: Receiver<T>,
    newest: Option<T>,
    has_ended: bool,
}

impl<T: Copy> Input<T> {
    fn new(channel: Receiver<T>) -> Self {
        Self {
            channel,
            newest: None,
            has_ended: false,
        }
    }

    /// The newest value, while there is somebody who writes it.
    fn take(&mut self) -> Option<T> {
        for _ in 0..MOST_AT_ONCE {
            match self.channel.try_recv() {
                Ok(value) => self.newest = Some(value),
                Err(TryRecvError::Closed | TryRecvError::Poisoned) => {
                    self.has_ended = true;
                    self.newest = None;
                }
                Err(_) => {}
            }
            if self.has_ended {
                break;
            }
        }
        self.newest
    }
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
            duty: Input::new(duty),
            enable: enable.map(Input::new),
        });
    }

    pub(crate) fn add_output(&mut self, number: usize, neutral: bool, level: Receiver<bool>) {
        self.outputs.push(OutputEnd {
            number,
            neutral,
            level: Input::new(level),
        });
    }

    /// What makes no sense, in words.
    pub(crate) fn wrong(&self) -> Option<&'static str> {
        is_doubled(self.pwms.iter().map(|end| end.number))
            .then_some("a PWM generator is connected twice")
    }

    pub(super) fn are_none(&self) -> bool {
        self.pwms.is_empty() && self.outputs.is_empty()
    }

    /// Takes the newest values; says whether all who write have gone.
    pub(super) fn take(&mut self, layout: &Layout, to: &mut Outputs, health: &Health) -> bool {
        let mut have_ended = !self.are_none();
        for end in &mut self.pwms {
            let duty = end.duty.take();
            let is_enabled = match &mut end.enable {
                Some(enable) => enable.take().unwrap_or(false) && duty.is_some(),
                None => duty.is_some(),
            };
            let duty = duty.unwrap_or(0.0);
            if duty.is_nan() {
                health.not_finite.add();
            }
            to.set_duty(end.number, if duty.is_nan() { 0.0 } else { duty });
            to.set_enabled(end.number, is_enabled);
            have_ended &= end.duty.has_ended;
        }
        for end in &mut self.outputs {
            let level = end.level.take().unwrap_or(end.neutral);
            layout.set_output(to, end.number, level);
            have_ended &= end.level.has_ended;
        }
        have_ended
    }

    pub(super) fn poison(&self) {
        for end in &self.pwms {
            end.duty.channel.poison();
            if let Some(enable) = &end.enable {
                enable.channel.poison();
            }
        }
        for end in &self.outputs {
            end.level.channel.poison();
        }
    }
}

fn is_doubled(numbers: impl Iterator<Item = usize> + Clone) -> bool {
    numbers
        .clone()
        .any(|number| numbers.clone().filter(|other| *other == number).count() > 1)
}
