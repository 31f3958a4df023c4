//! A dead-man's key as a process.

use super::alarms::Alarms;
use super::{Steps, put_out, taken, unless};
use crate::dead_man::{DeadMan, judge};
use crate::fault::Finding;
use crate::monitor::Monitor;
use crate::response::{Reactor, Response};
use crate::setting::SettingError;
use luna::{Instant, Process, Receiver, Sender, alt};
use std::pin::pin;

/// A [`DeadMan`] between two channels: values pass while the key is held; otherwise neutral is put
/// out.
///
/// One value is put out for each that comes, and neutral at once when the key is released or its
/// time is over. When the writers of keys are gone, or have poisoned the channel, while the key is
/// held, that is a fault at once ([`Fault::KeyLost`](crate::Fault::KeyLost)): release it before they
/// end. A release is no fault and no alarm, unless the response makes it one by
/// [`limited_for`](Response::limited_for). It recovers as the response specifies: with
/// [`Recovery::After(Duration::ZERO)`](crate::Recovery::After) with the first value after the key
/// is held again. When the writers of values are gone it puts out neutral once, and ends; also when
/// its readers are gone.
///
/// When the system enters a safe state it offers neutral at once (in a recorded system, with the
/// next value), and goes on while the safe state lasts. A value that was not taken by then is
/// withdrawn, and replaced by neutral. Bound: neutral after a release or the end of the time is put
/// out as soon as the process runs and its reader takes it. Real-time path: yes; O(1) a step, no
/// allocation except one for the first alarm, for a safe state, and for an emergency.
///
/// ```
/// use luna::prelude::*;
/// use luna_safety_blocks::{DeadMan, DeadManProcess, Reaction};
/// use std::time::Duration;
///
/// let mut system = System::new("jog");
/// system.virtual_clock();
/// let main = system.executor("main").build()?;
/// let (speed, speeds) = luna::channel();
/// let (key, keys) = luna::channel();
/// let (safe, outputs) = luna::channel();
/// let grip = DeadMan::new(Duration::from_millis(50))?;
/// main.process("dead-man").spawn(DeadManProcess::new(
///     "grip",
///     grip,
///     0.0,
///     Reaction::Neutral,
///     speeds,
///     keys,
///     safe,
/// )?)?;
/// main.process("operator").spawn(async move {
///     key.send(1).await?;
///     speed.send(0.2).await?; // held
///     luna::after(Duration::from_millis(60)).await; // and not refreshed
///     Ok(())
/// })?;
/// main.process("drive").spawn(async move {
///     let start = luna::now();
///     assert_eq!(outputs.recv().await?, 0.2);
///     assert_eq!(outputs.recv().await?, 0.0);
///     assert_eq!(luna::now() - start, Duration::from_millis(50));
///     while outputs.recv().await.is_ok() {}
///     Ok(())
/// })?;
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug)]
#[must_use = "a process protects nothing until it is spawned"]
pub struct DeadManProcess {
    dead_man: DeadMan,
    reactor: Reactor,
    values: Receiver<f64>,
    keys: Receiver<u32>,
    output: Sender<f64>,
    alarms: Alarms,
}

enum Event {
    Value(Option<f64>),
    Key(Option<u32>),
    Time,
    /// Neutral was put out for the safe state, if a reader exists.
    Taken(bool),
}

impl DeadManProcess {
    /// A dead-man called `name` between `values` and `output`, with keys from `keys`.
    ///
    /// # Errors
    ///
    /// `neutral` is not finite.
    pub fn new(
        name: &str,
        dead_man: DeadMan,
        neutral: f64,
        response: impl Into<Response>,
        values: Receiver<f64>,
        keys: Receiver<u32>,
        output: Sender<f64>,
    ) -> Result<Self, SettingError> {
        Ok(Self {
            dead_man,
            reactor: Reactor::new(name, neutral, response)?,
            values,
            keys,
            output,
            alarms: Alarms::default(),
        })
    }

    /// Sends each fault that begins to `reports`, if there is room: use a buffer that overwrites.
    pub fn report_to(mut self, reports: Sender<Finding>) -> Self {
        self.alarms.report_to(reports);
        self
    }

    /// What others see of it, and by which they reset it.
    pub fn monitor(&self) -> Monitor {
        self.reactor.monitor()
    }

    async fn pass_on(&mut self) -> luna::Result<()> {
        self.alarms.begin();
        let mut steps = Steps::default();
        let mut put_out_at = Steps::default();
        let mut last = steps_from(&mut steps);
        let (mut has_keys, mut was_held) = (true, false);
        let neutral = self.reactor.neutral();
        let mut newest = neutral;
        // For the safe state, until it is taken or something else is put out.
        let mut offers = false;
        let mut entered = pin!(self.alarms.entered());
        loop {
            let expires = self.dead_man.expires_in().map(|time| last + time);
            let event = async {
                let event = alt! {
                    _ = luna::at(expires.unwrap_or(Instant::NEVER)), if expires.is_some() => Event::Time,
                    sent = self.output.send(neutral), if offers => Event::Taken(taken(sent)?),
                    key = self.keys.recv(), if has_keys => Event::Key(key.ok()),
                    value = self.values.recv() => match value {
                        Err(error) if error.is_poisoned() => return Err(luna::Error::Poisoned),
                        value => Event::Value(value.ok()),
                    },
                };
                Ok(event)
            };
            let awaited = entered.as_mut().as_pin_mut();
            let awaited = awaited.filter(|_| self.alarms.awaits_safe_state());
            let Some(event) = unless(event, awaited).await.transpose()? else {
                self.alarms.note_safe_state();
                offers = true;
                continue;
            };
            if let Event::Taken(is_there) = event {
                offers = false;
                match is_there {
                    true => continue,
                    false => return Ok(()),
                }
            }
            last = luna::now();
            let elapsed = steps.elapsed(last);
            if self.alarms.safe_state_is_over() {
                self.reactor.rearm();
            }
            self.reactor.take_reset();
            let key = match event {
                // Writers that are gone do not come back.
                Event::Key(None) => {
                    has_keys = false;
                    self.dead_man.end(elapsed)
                }
                Event::Key(key) => self.dead_man.step(key, elapsed),
                Event::Value(_) | Event::Time | Event::Taken(_) => {
                    self.dead_man.step(None, elapsed)
                }
            };
            let is_held = key.is_ok();
            match event {
                Event::Value(None) => return Ok(()),
                Event::Value(Some(value)) => {
                    newest = value;
                }
                _ if was_held && !is_held => {}
                // A key that is refreshed, or still is not held, puts out nothing.
                _ => {
                    was_held = is_held;
                    continue;
                }
            }
            was_held = is_held;
            offers = false;
            let verdict = judge(newest, key, self.reactor.neutral());
            // Since what was put out last: keys came in between.
            let elapsed = put_out_at.elapsed(last);
            let (value, alarm) = self.reactor.react(verdict, newest, elapsed);
            if let Some(alarm) = alarm {
                self.alarms.raise(alarm);
            }
            self.alarms.go_on()?;
            let is_neutral = self.alarms.is_safe_state();
            let value = if is_neutral { neutral } else { value };
            let entered = entered.as_mut().as_pin_mut().filter(|_| !is_neutral);
            let (output, alarms) = (&self.output, &mut self.alarms);
            if !put_out(output, value, entered, alarms, || neutral).await? {
                return Ok(());
            }
        }
    }
}

/// Starts to count, and returns the present instant.
fn steps_from(steps: &mut Steps) -> Instant {
    let now = luna::now();
    steps.elapsed(now);
    now
}

impl Process for DeadManProcess {
    async fn run(&mut self) -> luna::Result<()> {
        let ended = self.pass_on().await;
        if !matches!(&ended, Err(error) if !error.is_poisoned()) {
            // Readers that are gone need no neutral.
            let _ = self.output.send(self.reactor.neutral()).await;
        }
        ended
    }
}
