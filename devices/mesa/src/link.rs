//! From channels to a card.

use crate::process::{Actuators, CardProcess, Sensors};
use crate::{Actuator, Bucket, Card, Reading, Sample};
use hostmot2::{ClientError, Layout, LayoutError, OutputPin, Selection};
use luna::{Receiver, Sender};
use std::any::Any;
use std::io;
use std::time::Duration;

/// A card, and its ends of the channels by which processes reach it. Made by [`Card::link`]; for an
/// example see the [crate](crate).
///
/// Use registers as channels ([`Buffer::overwrite_oldest(1)`](luna::Buffer::overwrite_oldest)): the
/// link never waits for a process. Each encoder, generator and pin may be connected once.
#[derive(Debug)]
pub struct Link {
    card: Card,
    pub(crate) name: String,
    pub(crate) period: Duration,
    pub(crate) patience: f64,
    pub(crate) bucket: Bucket,
    pub(crate) checks_quadrature: bool,
    selection: Selection,
    pub(crate) sensors: Sensors,
    pub(crate) actuators: Actuators,
    ages: Vec<(Actuator, Option<Duration>)>,
    kept: Vec<Box<dyn Any + Send>>,
}

/// Why a link cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// The card cannot do it.
    #[error("{0}")]
    Layout(#[source] LayoutError),
    /// The card does not answer any more.
    #[error("{0}")]
    Client(#[source] ClientError),
    /// The system refuses what the socket needs.
    #[error("no socket to the card: {0}")]
    Socket(#[source] io::Error),
    /// A setting is invalid.
    #[error("{0}")]
    Setting(&'static str),
    /// The card's emergency function cannot be registered.
    #[error("{0}")]
    Emergency(#[source] luna::Error),
}

impl Link {
    pub(crate) fn new(card: Card, name: &str, period: Duration) -> Self {
        Self {
            card,
            name: name.to_owned(),
            period,
            patience: 0.8,
            bucket: Bucket::new(10, 1, 301),
            checks_quadrature: true,
            selection: Selection::default(),
            sensors: Sensors::default(),
            actuators: Actuators::default(),
            ages: Vec::new(),
            kept: Vec::new(),
        }
    }

    /// Sends the values of encoder `number` to `channel` in each cycle: counts since the first
    /// answer, and counts a second. The encoder makes at most `fastest` counts a second. The link
    /// ends if a position moves further than that allows, or was not read for so long that its
    /// 16-bit counter may have wrapped.
    pub fn encoder(
        &mut self,
        number: u8,
        fastest: f64,
        channel: Sender<Sample<Reading>>,
    ) -> &mut Self {
        let count = number.saturating_add(1);
        self.selection.encoders = self.selection.encoders.max(count);
        self.sensors.add_encoder(number.into(), fastest, channel);
        self
    }

    /// Makes the card latch the count at the first index of this encoder from now on:
    /// [`Reading::index`](hostmot2::encoder::Encoder::index).
    pub fn latch_index(&mut self, encoder: u8) -> &mut Self {
        self.selection.latch_index |= 1_u64.checked_shl(encoder.into()).unwrap_or(0);
        self
    }

    /// Continues when both lines of an encoder have changed at once, which means that counts were
    /// lost; by default that ends the link.
    pub fn ignore_quadrature_errors(&mut self) -> &mut Self {
        self.checks_quadrature = false;
        self
    }

    /// Uses the values from `channel` as the duty of PWM generator `number`: −1 to 1, in steps of
    /// 1/4096. Values outside saturate (at 4095/4096); NaN is 0, and counted. The generator is
    /// enabled from the first duty on. Before that, and when all senders are gone, the duty is 0.
    pub fn pwm(&mut self, number: u8, channel: Receiver<f64>) -> &mut Self {
        self.add_pwm(number, channel, None)
    }

    /// As [`pwm`](Self::pwm), with the enable output controlled by `enable`: off before its first
    /// value, and when its senders are gone. The duty of a disabled generator is 0.
    pub fn pwm_with_enable(
        &mut self,
        number: u8,
        channel: Receiver<f64>,
        enable: Receiver<bool>,
    ) -> &mut Self {
        self.add_pwm(number, channel, Some(enable))
    }

    fn add_pwm(
        &mut self,
        number: u8,
        channel: Receiver<f64>,
        enable: Option<Receiver<bool>>,
    ) -> &mut Self {
        let count = number.saturating_add(1);
        self.selection.pwms = self.selection.pwms.max(count);
        self.actuators.add_pwm(number.into(), channel, enable);
        self
    }

    /// Sends the level of pin `number` to `channel` in each cycle.
    pub fn input(&mut self, number: u8, channel: Sender<Sample<bool>>) -> &mut Self {
        self.sensors.add_input(number, channel);
        self
    }

    /// Uses the values from `channel` as the level of pin `number`. They must be repeated: for a
    /// level that is set once, turn its [`greatest_age`](Self::greatest_age) off. The level is
    /// `neutral` before the first value, and when all senders are gone. At the end and in an
    /// emergency the pin becomes an input with a pull-up: wire it so that this is harmless.
    pub fn output(&mut self, number: u8, neutral: bool, channel: Receiver<bool>) -> &mut Self {
        self.actuators
            .add_output(self.selection.outputs.len(), number, neutral, channel);
        self.selection.outputs.push(OutputPin {
            pin: number,
            neutral,
        });
        self
    }

    /// The frequency of all PWM generators (Hz); 20 kHz if not stated.
    pub fn pwm_frequency(&mut self, frequency: f64) -> &mut Self {
        self.selection.pwm_frequency = frequency;
        self
    }

    /// The time of the card's watchdog: if no write packet has come for this long, the card's pins
    /// become inputs. Default 50 ms; more than two periods.
    pub fn watchdog(&mut self, time: Duration) -> &mut Self {
        self.selection.watchdog_ns = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        self
    }

    /// How long a set-point of `actuator` is held when no new one comes. After that its writer
    /// counts as hanging: the link ends with [`Fault::Overdue`](crate::Fault::Overdue), an
    /// emergency, and the outputs are off. Counted in whole periods, from the card's start on.
    /// `None` holds it as long as there is a sender, for set-points that are sent once.
    ///
    /// The default for duties and pins is the time of the [watchdog](Self::watchdog), so that a
    /// controller that hangs drives the machine no longer than a program that hangs. The default
    /// for enables is `None`, since a generator is driven by its duty too. May be called before the
    /// actuator is connected; the last call for each counts.
    ///
    /// ```
    /// # fn set(link: &mut luna_mesa::Link) {
    /// use luna_mesa::Actuator;
    /// use std::time::Duration;
    ///
    /// link.greatest_age(Actuator::Pwm(0), Some(Duration::from_millis(5)))
    ///     .greatest_age(Actuator::Output(12), None); // a relay that is switched on once
    /// # }
    /// ```
    pub fn greatest_age(&mut self, actuator: Actuator, age: Option<Duration>) -> &mut Self {
        self.ages.push((actuator, age));
        self
    }

    /// How long to wait for an answer, as a part of the period; default 0.8.
    pub fn patience(&mut self, part: f64) -> &mut Self {
        self.patience = part;
        self
    }

    /// The limit of errors. The default is 31 cycles in a row without an answer, or more than one
    /// in 11 for long.
    pub fn tolerance(&mut self, bucket: Bucket) -> &mut Self {
        self.bucket = bucket;
        self
    }

    /// Keeps `what` until the process has ended and the outputs are off, such as the handle of a
    /// power supply. The card's own handle is kept if the card was opened by [`open`](crate::open).
    pub fn keep(&mut self, what: impl Send + 'static) -> &mut Self {
        self.kept.push(Box::new(what));
        self
    }

    /// Sets the actuators' ages, in periods. Returns an error's text for an invalid setting.
    fn set_ages(&mut self, watchdog: Duration) -> Option<&'static str> {
        let period = self.period.as_nanos();
        let cycles = |age: Duration| u32::try_from(age.as_nanos() / period).unwrap_or(u32::MAX);
        self.actuators.set_all_greatest_ages(cycles(watchdog));
        for (actuator, age) in &self.ages {
            if age.is_some_and(|age| age < self.period) {
                return Some("the greatest age of set-points is a period of the link or more");
            }
            if !self.actuators.set_greatest_age(*actuator, age.map(cycles)) {
                return Some("an actuator has a greatest age, but is not connected");
            }
        }
        None
    }

    /// Puts the card into the link's initial state (no outputs yet), and makes the process. For
    /// set-up: blocks, and allocates.
    ///
    /// # Errors
    ///
    /// The card does not have what is connected, a unit is used twice, a setting is invalid, or the
    /// card is silent.
    pub fn process(mut self) -> Result<CardProcess, LinkError> {
        let watchdog = Duration::from_nanos(self.selection.watchdog_ns);
        let wrong = if self.period.is_zero() {
            Some("a link's period is more than 0")
        } else if !(self.patience > 0.0 && self.patience < 1.0) {
            Some(
                "the part of the period for which an answer is awaited is more than 0 and less than 1",
            )
        } else if watchdog <= self.period.saturating_mul(2) {
            Some("the card's watchdog is to wait for more than two periods of the link")
        } else if self.selection.pwm_frequency.is_nan() || self.selection.pwm_frequency <= 0.0 {
            Some("a PWM frequency is more than 0")
        } else {
            let wrong = self.sensors.wrong().or(self.actuators.wrong());
            wrong.or_else(|| self.set_ages(watchdog))
        };
        if let Some(wrong) = wrong {
            return Err(LinkError::Setting(wrong));
        }
        let width = self.card.description.idrom.width;
        if let Some(pin) = self.sensors.pin_beyond(width) {
            return Err(LinkError::Layout(LayoutError::NoPin { pin }));
        }
        let layout =
            Layout::new(&self.card.description, &self.selection).map_err(LinkError::Layout)?;
        let packets = layout
            .set_up()
            .map_err(|error| LinkError::Layout(error.into()))?;
        for packet in &packets {
            self.card
                .client
                .confirmed(packet)
                .map_err(LinkError::Client)?;
        }
        let port_width = self.card.description.idrom.port_width;
        let sequence = self.card.client.sequence();
        let Card { client, device, .. } = self.card;
        let parts = crate::process::Parts {
            name: self.name,
            period: self.period,
            patience: self.patience,
            bucket: self.bucket,
            checks_quadrature: self.checks_quadrature,
            sensors: self.sensors,
            actuators: self.actuators,
            device,
            kept: self.kept,
        };
        CardProcess::new(parts, layout, client.into_socket(), sequence, port_width)
    }
}
