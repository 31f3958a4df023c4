//! The process that a link is.

mod ends;
mod exchange;
mod readings;

pub(crate) use ends::{Actuators, Sensors};

use crate::socket::Socket;
use crate::{Bucket, CardDevice, Fault, Health, LinkError, Neutral};
use exchange::{Exchange, Outcome};
use hostmot2::lbp16::Packet;
use hostmot2::{EchoState, Layout, Outputs, SequenceWindow};
use luna::devices::Device;
use luna::{Error, Instant, Process};
use luna_platform::clock::Clock;
use readings::Readings;
use std::any::Any;
use std::future::Future;
use std::net::UdpSocket;
use std::sync::Arc;
use std::time::Duration;

/// A link as a process: see [`Link::process`](crate::Link::process).
///
/// It ends, with the card's outputs off, when all writers of its actuators are gone; without
/// actuators, when all readers of its sensors are. Real-time path: yes, all of a cycle; O(connected
/// units), no allocation; two system calls to send, one to receive each datagram that has come, and
/// those of [`readable`](luna::external::readable) to wait.
#[must_use = "a link is a process: spawn it"]
pub struct CardProcess {
    parts: Parts,
    state: State,
    neutral: Neutral,
    health: Arc<Health>,
    is_run: bool,
}

/// What the link was given.
pub(crate) struct Parts {
    pub(crate) name: String,
    pub(crate) period: Duration,
    pub(crate) patience: f64,
    pub(crate) bucket: Bucket,
    pub(crate) checks_quadrature: bool,
    pub(crate) sensors: Sensors,
    pub(crate) actuators: Actuators,
    /// Until the outputs are off at the end.
    pub(crate) device: Option<Device<CardDevice>>,
    pub(crate) kept: Vec<Box<dyn Any + Send>>,
}

/// What a cycle works on.
struct State {
    layout: Layout,
    exchange: Exchange,
    readings: Readings,
    outputs: Outputs,
    packet: Packet,
    writes: SequenceWindow,
    /// The time of the first start packet.
    begun: Option<Instant>,
    /// Whether the card has confirmed its start.
    has_started: bool,
    in_a_row: u32,
}

impl CardProcess {
    pub(crate) fn new(
        parts: Parts,
        layout: Layout,
        socket: UdpSocket,
        sequence: u32,
        port_width: u32,
    ) -> Result<Self, LinkError> {
        let too_long = |error: hostmot2::lbp16::PacketError| LinkError::Layout(error.into());
        let mut packet = Packet::new();
        layout.neutral_request(&mut packet).map_err(too_long)?;
        let other = socket.try_clone().map_err(LinkError::Socket)?;
        let neutral = Neutral::new(other, packet.bytes().to_vec());
        // Now, so that no cycle finds that it does not fit.
        let outputs = layout.outputs_at_rest();
        layout
            .write_request(0, &outputs, &mut packet)
            .map_err(too_long)?;
        layout.start_request(0, &mut packet).map_err(too_long)?;
        layout.read_request(0, &mut packet).map_err(too_long)?;
        if let Some(device) = &parts.device {
            let neutral = neutral.clone();
            device
                .on_emergency("outputs off", move |_| neutral.engage())
                .map_err(LinkError::Emergency)?;
        }
        let health = Arc::new(Health::default());
        let socket = Socket::new(socket).map_err(LinkError::Socket)?;
        // Neither a number that the card has from an earlier link, nor that of a restarted card.
        let first = sequence.rotate_left(16).max(1);
        let state = State {
            exchange: Exchange::new(socket, layout.answer_len(), sequence, health.clone()),
            readings: Readings::new(&parts, &layout, port_width),
            outputs,
            packet,
            writes: SequenceWindow { first, last: first },
            begun: None,
            has_started: false,
            in_a_row: 0,
            layout,
        };
        Ok(Self {
            parts,
            state,
            neutral,
            health,
            is_run: false,
        })
    }

    /// A handle that disables the outputs: for [`on_emergency`](luna::System::on_emergency), unless
    /// the card was opened by [`open`](crate::open), which registers it.
    pub fn neutral(&self) -> Neutral {
        self.neutral.clone()
    }

    /// What it counts.
    pub fn health(&self) -> Arc<Health> {
        self.health.clone()
    }
}

impl Process for CardProcess {
    fn run(&mut self) -> impl Future<Output = luna::Result<()>> {
        // A failure here occurs again at the first wait, which reports it.
        let _ = luna::external::prepare_files();
        async move {
            let ended = self.go_on().await;
            self.disarm();
            match ended {
                Ok(()) => Ok(()),
                Err(Stop::Luna(error)) => Err(error),
                Err(Stop::Fault(fault)) => Err(self.fail(fault)),
            }
        }
    }

    /// The outputs are off, whatever has ended the link; then the card can be opened again.
    fn post_run(&mut self) {
        self.disarm();
        self.parts.device = None;
        self.parts.kept.clear();
    }
}

impl Drop for CardProcess {
    fn drop(&mut self) {
        if !self.neutral.is_engaged() {
            self.disarm();
        }
    }
}

enum Stop {
    Luna(Error),
    Fault(Fault),
}

impl From<Fault> for Stop {
    fn from(fault: Fault) -> Stop {
        Stop::Fault(fault)
    }
}

impl CardProcess {
    /// Disables the outputs. If the system refuses, the watchdog remains.
    fn disarm(&self) {
        let _ = self.neutral.try_engage();
    }

    async fn go_on(&mut self) -> Result<(), Stop> {
        if std::mem::replace(&mut self.is_run, true) {
            return Err(Fault::RunTwice.into());
        }
        if Clock::is_virtual_here() {
            return Err(Fault::VirtualTime.into());
        }
        let patience = self.parts.period.mul_f64(self.parts.patience);
        let mut tick = luna::periodic(&self.parts.name, self.parts.period).map_err(Stop::Luna)?;
        loop {
            tick.next().await;
            self.health.cycles.add();
            let have_ended = self.parts.actuators.take(
                &self.state.layout,
                &mut self.state.outputs,
                &self.health,
                self.state.has_started,
            )?;
            if have_ended || self.neutral.is_engaged() {
                return Ok(());
            }
            self.write();
            // An emergency meanwhile may have sent its packet before this one.
            if self.neutral.is_engaged() {
                return Ok(());
            }
            let deadline = luna::now() + patience;
            let outcome = self.state.exchange(deadline).await.map_err(Fault::Wait)?;
            if !self.judge(outcome)? && self.parts.actuators.are_none() {
                return Ok(());
            }
        }
    }

    /// Sends the write packet, or the one that starts the card.
    fn write(&mut self) {
        let State {
            layout,
            exchange,
            outputs,
            packet,
            writes,
            begun,
            has_started,
            ..
        } = &mut self.state;
        let made = match has_started {
            true => {
                writes.last = writes.last.wrapping_add(1);
                layout.write_request(writes.last, outputs, packet)
            }
            false => {
                begun.get_or_insert_with(luna::now);
                layout.start_request(writes.first, packet)
            }
        };
        // It fits: that was tried before.
        if made.is_ok() {
            exchange.send(packet);
        }
    }

    /// Reports the cycle's outcome to the readers. Returns whether there are any.
    fn judge(&mut self, outcome: Outcome) -> Result<bool, Stop> {
        let health = &self.health;
        let Outcome::Answered { asked, answered } = outcome else {
            self.state.in_a_row = self.state.in_a_row.saturating_add(1);
            health.missed.add();
            health.longest_silence.raise_to(self.state.in_a_row.into());
            self.error()?;
            return Ok(self.state.readings.send_stale(&self.parts.sensors));
        };
        self.state.in_a_row = 0;
        let State {
            layout,
            exchange,
            readings,
            writes,
            begun,
            has_started,
            ..
        } = &mut self.state;
        let Ok(answer) = layout.decode(exchange.answer()) else {
            return Err(Fault::Foreign.into());
        };
        let echo = answer.echo_state(*writes);
        if !*has_started {
            if echo == EchoState::UpToDate && answer.is_driving() && !answer.has_bitten {
                *has_started = true;
            } else {
                health.writes_behind.add();
                self.error()?;
                return Ok(true);
            }
        }
        // First the reason, then what came of it.
        if answer.has_bitten {
            return Err(Fault::Bitten.into());
        }
        if echo == EchoState::Foreign || !answer.is_driving() {
            return Err(Fault::Foreign.into());
        }
        let begun = begun.unwrap_or(asked);
        readings.update(&answer, &self.parts.sensors, [begun, asked, answered])?;
        let is_read = readings.send_all(&self.parts.sensors);
        if echo == EchoState::Behind {
            health.writes_behind.add();
            self.error()?;
        } else {
            self.parts.bucket.leak();
        }
        Ok(is_read)
    }

    fn error(&mut self) -> Result<(), Stop> {
        match self.parts.bucket.fill() {
            true => Err(Fault::TooManyErrors {
                in_a_row: self.state.in_a_row,
            }
            .into()),
            false => Ok(()),
        }
    }

    /// Ends a link that cannot go on. First its channels are poisoned: no process that runs for the
    /// emergency receives an old value.
    fn fail(&self, fault: Fault) -> Error {
        self.parts.sensors.poison();
        self.parts.actuators.poison();
        // It allocates; there is nothing left to be in time for.
        luna::realtime::off_path(|| match &self.parts.device {
            Some(device) => device.lost(Error::other(fault)),
            None => luna::emergency(Error::other(fault)),
        })
    }
}

impl State {
    /// Asks the card and waits for its answer.
    async fn exchange(&mut self, deadline: Instant) -> Result<Outcome, luna::external::FileError> {
        let number = self.exchange.next_number();
        // It fits: that was tried before.
        if self.layout.read_request(number, &mut self.packet).is_err() {
            return Ok(Outcome::Missed);
        }
        self.exchange.ask(&self.packet, deadline).await
    }
}

luna_platform::debug_fields!(
    CardProcess, |process|
    name: process.parts.name,
    health: process.health
);
