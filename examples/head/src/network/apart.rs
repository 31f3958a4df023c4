//! Vision in a program of its own, on this computer or another one: over TCP.
//!
//! Only newest values go into the link, so a slow network or program drops images and delays
//! nothing. When the connection breaks, the head holds its gaze, as without images, until there is
//! another one.

use super::{look, newest};
use crate::messages::{Image, Sighting};
use luna::external::{Framing, Prefix};
use luna::prelude::*;
use luna::system::Executor;
use luna_links::OnBad;
use luna_links::cycle::CycleData;
use luna_links::tcp::{self, Reconnect};
use std::net::SocketAddr;
use std::time::Duration;

/// Images and sightings, each after its length.
const FRAMING: Framing = Framing::prefixed(Prefix::U32Little, Image::SIZE);
/// Vision that takes nothing for so long is connected again.
const PATIENCE: Duration = Duration::from_secs(1);

/// The link of the head to vision at `address`. It ends with the head, whether vision does or not.
pub(super) fn connect(
    system: &System,
    executor: &Executor,
    address: SocketAddr,
    (images, sighting): (Receiver<Image>, Sender<Sighting>),
) -> luna::Result<()> {
    let port = tcp::connect(&system.devices(), address)?;
    let link = tcp::link(&port, images, sighting, FRAMING)?
        .reconnect(Reconnect::backing_off(
            Duration::from_millis(20),
            Duration::from_millis(500),
        ))
        .patience(PATIENCE)
        .until_unread()
        .on_bad(OnBad::Drop);
    executor.process("vision's link").spawn(link)?;
    Ok(())
}

/// Runs vision for heads that connect to `local`, one after the other, until the program is asked
/// to end. Calls `listens` with the actual address first.
///
/// # Errors
///
/// The address cannot be listened on, or those of building and running the system.
pub fn serve_vision(
    mut system: System,
    local: SocketAddr,
    listens: impl FnOnce(SocketAddr),
) -> luna::Result<()> {
    let executor = system.executor("vision").policy(Policy::Other).build()?;
    let port = tcp::listen(&system.devices(), local)?;
    let address = port.address()?;
    let (image, images) = newest("images");
    let (sighting, sightings) = newest("sightings");
    let link = tcp::link(&port, sightings, image, FRAMING)?
        .patience(PATIENCE)
        .on_bad(OnBad::Drop);
    drop(port);
    executor.process("link").spawn(link)?;
    executor.process("vision").spawn(look(images, sighting))?;
    drop(executor);
    system.announce_address("vision", &address.to_string());
    listens(address);
    system.run().map(drop)
}
