//! From an input device to a channel of controls.

use super::state::{Meaning, State};
use super::{Control, Controller, Event, FRAMING};
use crate::Counts;
use crate::end::{Stop, UntilStopped};
use luna::devices::Device;
use luna::external::{FromBytes, LinkError, Splitter, Wire};
use luna::{Process, Sender};
use luna_core::path::{self, Call};
use std::future::Future;
use std::pin::{Pin, pin};

/// Creates a process that reports a device's controls: first those that are not at 0, then each as
/// it changes.
///
/// When the kernel has dropped events for lack of room, the process queries the device's state and
/// reports the differences; so the reader's state becomes right again. That is counted as
/// [bad](Counts::bad). It ends without an error when the last receiver is gone. When the device is
/// unplugged it is [lost](Device::lost).
///
/// Real-time path: from its `run` on; a system call a read, no allocation. Cancel-safe.
///
/// # Errors
///
/// The system has no more descriptors.
pub fn controls<D: Controller>(
    device: &Device<D>,
    sender: Sender<Control>,
) -> Result<Controls<D>, LinkError> {
    let file = device
        .file()
        .map_err(|error| LinkError::SetUp(error.into()))?;
    Ok(Controls {
        wire: Some(Wire::new(file)?),
        splitter: Splitter::new(FRAMING)?,
        state: Box::new(State::new(|axis| device.range(axis))),
        device: Some(device.clone()),
        sender: Some(sender.external()),
        counts: Counts::default(),
    })
}

/// A link to be spawned: see [`controls`].
#[must_use = "a link is a process: spawn it"]
pub struct Controls<D: Controller> {
    /// Before the device, which is closed after it.
    wire: Option<Wire>,
    device: Option<Device<D>>,
    splitter: Splitter,
    state: Box<State>,
    sender: Option<Sender<Control>>,
    counts: Counts,
}

impl<D: Controller> Controls<D> {
    /// What it counts: events.
    pub fn counts(&self) -> Counts {
        self.counts.clone()
    }
}

impl<D: Controller> Process for Controls<D> {
    fn run(&mut self) -> impl Future<Output = luna::Result<()>> {
        // Here, off the real-time path. If it fails, the first wait fails too, and reports it.
        let _ = luna::external::prepare_files();
        async {
            let sender = self.sender.take();
            let (Some(wire), Some(device), Some(sender)) = (&mut self.wire, &self.device, sender)
            else {
                return Err(LinkError::NotPrepared.into());
            };
            let (state, splitter, counts) = (&mut self.state, &mut self.splitter, &self.counts);
            let Err(stop) = report(wire, splitter, state, device, &sender, counts).await;
            stop.end(device)
        }
    }

    /// Lets go of the device.
    fn post_run(&mut self) {
        self.wire = None;
        self.device = None;
    }
}

/// Until something ends it.
async fn report<D: Controller>(
    wire: &mut Wire,
    splitter: &mut Splitter,
    state: &mut State,
    device: &Device<D>,
    sender: &Sender<Control>,
    counts: &Counts,
) -> UntilStopped {
    let mut ended = pin!(sender.ended());
    let mut meaning = Meaning::Ask;
    loop {
        match meaning {
            Meaning::Nothing => {}
            Meaning::Control(control) => {
                sender.send(control).await?;
            }
            Meaning::Ask => {
                let now = path::expected(Call::File, || device.snapshot())
                    .map_err(|error| LinkError::Read(error.into()))?;
                let mut place = 0;
                while let Some(control) = state.compare(&now, &mut place) {
                    sender.send(control).await?;
                }
            }
        }
        let event = next(wire, splitter, ended.as_mut()).await?;
        counts.record();
        meaning = state.take(event);
        if meaning == Meaning::Ask {
            counts.one_bad();
        }
    }
}

async fn next(
    wire: &mut Wire,
    splitter: &mut Splitter,
    mut ended: Pin<&mut luna::channel::Ended<'_>>,
) -> Result<Event, Stop> {
    loop {
        if let Some(Ok(bytes)) = splitter.next_record()
            && let Ok(event) = Event::from_bytes(bytes)
        {
            return Ok(event);
        }
        match wire.read(splitter.room(), ended.as_mut()).await? {
            0 => return Err(Stop::HungUp),
            count => splitter.filled(count),
        }
    }
}

luna_platform::debug_fields!(
    impl[D: Controller] Controls<D>, |controls|
    device: controls.device,
    counts: controls.counts
);
