//! A terminal and a drive, and a system around their bus.

#[path = "../../../../tests/shared/spawn.rs"]
mod spawn;

use luna::prelude::*;
use luna_ethercat::sim::{Network, SubDevice};
use luna_ethercat::{Expected, Fault, Link, OpenError, Wire};
pub(crate) use spawn::SpawnOk;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

pub(crate) const PERIOD: Duration = Duration::from_millis(1);
pub(crate) const TERMINAL: usize = 0;
pub(crate) const DRIVE: usize = 1;

/// A terminal of 16 outputs and 8 inputs, and a drive.
pub(crate) fn machine() -> Network {
    let network = Network::on_virtual_time();
    assert_eq!(network.add(SubDevice::digital(16, 8)), TERMINAL);
    assert_eq!(network.add(SubDevice::servo()), DRIVE);
    network
}

pub(crate) fn expected() -> [Expected; 2] {
    [
        Expected::new("terminal", SubDevice::VENDOR, SubDevice::DIGITAL),
        Expected::new("drive", SubDevice::VENDOR, SubDevice::SERVO),
    ]
}

pub(crate) fn open(system: &System, network: &Network) -> Result<Link, OpenError> {
    let wire = Wire::simulated(network);
    let bus = luna_ethercat::open(&system.devices(), &wire, &expected())?;
    Ok(bus.link("bus", PERIOD))
}

pub(crate) fn register<T: Copy + Send>() -> (Sender<T>, Receiver<T>) {
    luna::buffered(Buffer::overwrite_oldest(1))
}

/// A system on a virtual clock, so that a test has one outcome however busy the machine is.
pub(crate) fn system() -> System {
    let mut system = System::new("test");
    system.virtual_clock();
    system
}

/// Gives the loop `bus` another period, as a system file does.
pub(crate) fn period_from_file(system: &mut System, period: &str) {
    static FILES: AtomicU32 = AtomicU32::new(0);
    let number = FILES.fetch_add(1, Ordering::Relaxed);
    let name = format!("luna-ethercat-{}-{number}.toml", std::process::id());
    let file = std::env::temp_dir().join(name);
    std::fs::write(&file, format!("[loop.bus]\nperiod = \"{period}\"\n")).unwrap();
    let read = system.deployment_from(&file);
    std::fs::remove_file(&file).unwrap();
    read.unwrap();
}

/// The fault that has ended a run.
pub(crate) fn fault(outcome: luna::Result<luna::Report>) -> Fault {
    let error = outcome.expect_err("the link has failed");
    let luna::Error::Process { source, .. } = &error else {
        panic!("not of a process: {error}");
    };
    let luna::Error::Device(lost) = &**source else {
        panic!("not a device's: {source:?}");
    };
    let luna::devices::DeviceError::Lost { error, .. } = &**lost else {
        panic!("not lost: {lost}");
    };
    let luna::Error::Other(other) = &**error else {
        panic!("not a link's: {error}");
    };
    let fault = other.get().downcast_ref::<Fault>();
    fault.expect("a fault").clone()
}
