//! What the tests share.

#[path = "../../../../tests/shared/mod.rs"]
mod shared;
#[path = "../../../../tests/shared/spawn.rs"]
mod spawn;

use luna::prelude::*;
use luna_modbus::{Client, Event, ModbusServer, Reconnect, sim};
pub(crate) use shared::{Watchdog, skip};
pub(crate) use spawn::SpawnOk;
use std::time::Duration;

/// A watchdog; none where the platform layer cannot wait for files, which is reported.
pub(crate) fn with_files() -> Option<Watchdog> {
    if cfg!(luna_portable) {
        shared::skip("the portable layer cannot wait for files");
        return None;
    }
    Some(shared::watchdog())
}

/// How often the tests' clients ask.
pub(crate) const PERIOD: Duration = Duration::from_millis(2);

/// A busy machine has time to answer within it.
pub(crate) const LONG: Duration = Duration::from_secs(60);

/// At once, and as often as it takes.
pub(crate) const AT_ONCE: Reconnect =
    Reconnect::backing_off(Duration::from_millis(1), Duration::from_millis(10));

/// A system for one client.
pub(crate) struct Bench {
    pub(crate) system: System,
    pub(crate) device: luna::devices::Device<ModbusServer>,
}

impl Bench {
    /// With the client, its server and its events.
    pub(crate) fn new() -> (Self, Client, sim::Server, Receiver<Event>) {
        let plc = sim::Server::start().unwrap();
        let system = System::new("plant");
        let device = luna_modbus::open(&system.devices(), plc.address()).unwrap();
        let (event, events) = luna::buffered(Buffer::fifo(64));
        let client = luna_modbus::client(&device, PERIOD, event)
            .unwrap()
            .timeout(LONG)
            .unwrap()
            .reconnect(AT_ONCE);
        (Self { system, device }, client, plc, events)
    }

    /// Runs the client beside its user, to the end of both.
    pub(crate) fn run(
        self,
        client: Client,
        user: impl Future<Output = luna::Result<()>> + Send + 'static,
    ) {
        let Self { mut system, device } = self;
        let main = system.executor("main").build().unwrap();
        main.process("client").spawn_ok(client);
        main.process("user").spawn_ok(user);
        drop(device);
        system.run().unwrap();
    }
}

/// A channel that keeps the newest value.
pub(crate) fn newest<T: Send>() -> (Sender<T>, Receiver<T>) {
    luna::buffered(Buffer::overwrite_oldest(1))
}

/// Waits for the value that is `expected`.
pub(crate) async fn until<T: PartialEq + Send>(
    receiver: &Receiver<T>,
    expected: T,
) -> luna::Result<()> {
    while receiver.recv().await? != expected {}
    Ok(())
}
