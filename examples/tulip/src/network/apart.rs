//! The operator in a program of its own, on this computer or another one: over TCP.
//!
//! Only newest values go into the link, so a slow network or program delays nothing. When the
//! connection breaks, the robot stands, as without an operator, until there is another one.

use super::newest;
use crate::messages::{LONGEST, Request, Shown};
use crate::processes::{Orders, operate};
use luna::external::{Framing, Prefix};
use luna::prelude::*;
use luna::system::Executor;
use luna_links::OnBad;
use luna_links::tcp::{self, Reconnect};
use std::net::SocketAddr;
use std::time::Duration;

/// Both messages, each after its length.
const FRAMING: Framing = Framing::prefixed(Prefix::U8, LONGEST);
/// An operator that takes nothing for so long is connected again.
const PATIENCE: Duration = Duration::from_secs(1);

/// The link of the robot to the operator at `address`. It ends with the robot, whether the operator
/// does or not.
pub(super) fn connect(
    system: &System,
    executor: &Executor,
    address: SocketAddr,
    (shows, request): (Receiver<Shown>, Sender<Request>),
) -> luna::Result<()> {
    let port = tcp::connect(&system.devices(), address)?;
    let link = tcp::link(&port, shows, request, FRAMING)?
        .reconnect(Reconnect::backing_off(
            Duration::from_millis(20),
            Duration::from_millis(500),
        ))
        .patience(PATIENCE)
        .until_unread()
        .on_bad(OnBad::Drop);
    executor.process("operator's link").spawn(link)?;
    Ok(())
}

/// Runs the operator for robots that connect to `local`, one after the other, until the program is
/// asked to end. Calls `listens` with the actual address first, and `see` with what is shown.
///
/// # Errors
///
/// The address cannot be listened on, or those of building and running the system.
pub fn serve_operator(
    mut system: System,
    local: SocketAddr,
    orders: Orders,
    listens: impl FnOnce(SocketAddr),
    see: impl FnMut(&Shown) + Send + 'static,
) -> luna::Result<()> {
    let executor = system.executor("operator").policy(Policy::Other).build()?;
    let port = tcp::listen(&system.devices(), local)?;
    let address = port.address()?;
    let (show, shows) = newest("shown");
    let (request, requests) = newest("requests");
    let link = tcp::link(&port, requests, show, FRAMING)?
        .patience(PATIENCE)
        .on_bad(OnBad::Drop);
    drop(port);
    executor.process("link").spawn(link)?;
    let operator = executor.process("operator");
    operator.spawn(operate(orders, request, shows, see))?;
    drop(executor);
    system.announce_address("operator", &address.to_string());
    listens(address);
    system.run().map(drop)
}
