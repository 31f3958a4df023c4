//! The server as a device.

use luna::devices::{Device, DeviceError, DeviceManager, Sharing};
use std::net::SocketAddr;

/// A Modbus server as a device: see [`open`].
#[derive(Debug)]
pub struct ModbusServer {
    address: SocketAddr,
}

impl ModbusServer {
    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

/// Names a server; Modbus has port 502. Nothing is connected before a client runs. Several clients
/// can share it, each with a connection of its own: for several units behind a gateway, or for
/// several periods.
///
/// # Errors
///
/// A [`DeviceError`]: the name is in use for another kind of device.
pub fn open(
    devices: &DeviceManager,
    address: SocketAddr,
) -> Result<Device<ModbusServer>, DeviceError> {
    let name = format!("modbus:{address}");
    devices.open(&name, "Modbus server", Sharing::Shared, || {
        Ok(ModbusServer { address })
    })
}
