//! A bus, opened: its subdevices are found, and their process data is mapped.

use crate::error::{OpenError, StepError};
use crate::exchange::{Broken, Exchange};
use crate::{Expected, Found, Link, Wire, sdo};
use ethercrab::error::{Error, Item};
use ethercrab::subdevice_group::{NoDc, PreOp, PreOpPdi};
use ethercrab::{
    DcSupport, DcSync, DefaultLock, MainDevice, MainDeviceConfig, PduStorage, RetryBehaviour,
    SubDevice, SubDeviceGroup, Timeouts,
};
use luna::devices::{Device, DeviceError, DeviceManager, Sharing};
use std::ops::Deref;
use std::time::Duration;

/// The most subdevices of a bus.
pub(crate) const MAX_SUBDEVICES: usize = 64;
/// The room for process data in one frame, beside a datagram for the distributed clock.
pub(crate) const MAX_DATA: usize = 1466;
/// Frames that may be under way at once.
const FRAMES: usize = 4;
/// How long a mailbox may take to be free, and to answer.
const MAILBOX: Duration = Duration::from_secs(1);
const FRAME_SIZE: usize = PduStorage::element_size(1486);
/// How often the reference clock is sent around before a bus is used.
const CLOCK_FRAMES: u32 = 10_000;

pub(crate) type Group<State, Dc = NoDc> =
    SubDeviceGroup<MAX_SUBDEVICES, MAX_DATA, DefaultLock, State, Dc>;

const KIND: &str = "EtherCAT bus";

/// An opened bus: its subdevices are those that were expected, in PRE-OP, and their process data is
/// mapped. See [`open`].
pub struct Bus {
    pub(crate) main: Box<MainDevice<'static>>,
    pub(crate) exchange: Exchange,
    pub(crate) group: Box<Group<PreOpPdi>>,
    pub(crate) found: Vec<Found>,
    pub(crate) reference: Option<DcSupport>,
    /// Whether each can make pulses, and is to.
    pub(crate) can_sync: Vec<bool>,
    pub(crate) syncs: Vec<bool>,
    pub(crate) device: Option<Device<BusDevice>>,
}

/// A bus as the device manager knows it: see [`open`].
#[derive(Debug)]
pub struct BusDevice {
    wire: String,
}

impl BusDevice {
    /// Where it is.
    pub fn wire(&self) -> &str {
        &self.wire
    }
}

/// Opens the bus on `wire` by the device manager: once, as `ethercat:eth0`, until its link has
/// ended and the outputs are safe. Its subdevices have to be those of `expected`, in this order.
/// They get the objects that are listed there, and then their process data is mapped.
///
/// For set-up: blocks and allocates, for a second or so where distributed clocks are aligned, and
/// for some seconds at most if a subdevice fails. Each bus that is opened keeps about 7 KiB until
/// the program ends. All subdevices are reset first, whatever program has used them; only their
/// objects may keep what was written ([`Expected::sdo`]).
///
/// # Errors
///
/// [`OpenError`].
///
/// ```
/// use luna::System;
/// use luna_ethercat::sim::{Network, SubDevice};
/// use luna_ethercat::{Expected, OpenError, Wire};
///
/// let network = Network::new();
/// network.add(SubDevice::digital(8, 8));
/// let system = System::new("machine");
/// let drive = Expected::new("drive", SubDevice::VENDOR, SubDevice::SERVO);
/// let wire = Wire::simulated(&network);
/// let error = luna_ethercat::open(&system.devices(), &wire, &[drive]).unwrap_err();
/// assert!(matches!(error, OpenError::Mismatch { position: 0, .. }));
/// ```
pub fn open(devices: &DeviceManager, wire: &Wire, expected: &[Expected]) -> Result<Bus, OpenError> {
    let name = wire.name();
    let mut opened = None;
    let device = devices.open(&name, KIND, Sharing::Exclusive, || {
        match opened.insert(Bus::open(wire, expected)) {
            Ok(_) => Ok(BusDevice { wire: name.clone() }),
            Err(_) => Err(DeviceError::Missing {
                device: name.clone(),
                kind: KIND,
            }),
        }
    });
    match (device, opened) {
        // Why it cannot be opened is known better.
        (_, Some(Err(error))) => Err(error),
        (Ok(device), Some(Ok(bus))) => Ok(Bus {
            device: Some(device),
            ..bus
        }),
        (Err(error), _) => Err(OpenError::Device(error)),
        (Ok(device), None) => unreachable!("{device:?} is open, and was not opened"),
    }
}

/// Finds the subdevices on `wire`, whatever they are. For set-up, as [`open`]; they are left in
/// PRE-OP.
///
/// It resets all subdevices, and the device manager does not know of it: never call it for a wire on
/// which a link runs, which would lose its bus ([`Fault::Left`](crate::Fault::Left)).
///
/// # Errors
///
/// [`OpenError`].
///
/// ```
/// use luna_ethercat::sim::{Network, SubDevice};
///
/// let network = Network::new();
/// network.add(SubDevice::servo());
/// let found = luna_ethercat::scan(&luna_ethercat::Wire::simulated(&network)).unwrap();
/// assert_eq!((found[0].name.as_str(), found[0].product), ("SERVO", SubDevice::SERVO));
/// ```
pub fn scan(wire: &Wire) -> Result<Vec<Found>, OpenError> {
    let (_, _, group) = find(wire)?;
    Ok(group.found)
}

/// Subdevices that were found, and are in PRE-OP.
struct Reached {
    group: Box<Group<PreOp>>,
    found: Vec<Found>,
    clocks: Vec<DcSupport>,
}

/// Finds what is there.
fn find(wire: &Wire) -> Result<(Box<MainDevice<'static>>, Exchange, Reached), OpenError> {
    let port = wire.open().map_err(|error| OpenError::Interface {
        wire: wire.name(),
        error,
    })?;
    // All parts of the library borrow it.
    let storage: &'static PduStorage<FRAMES, FRAME_SIZE> = Box::leak(Box::new(PduStorage::new()));
    let Ok((tx, rx, pdus)) = storage.try_split() else {
        unreachable!("a new storage is not split");
    };
    let config = MainDeviceConfig {
        dc_static_sync_iterations: CLOCK_FRAMES,
        retry_behaviour: RetryBehaviour::Count(4),
    };
    // The library's own are so short that a busy computer fails to set a bus up.
    let timeouts = Timeouts {
        pdu: Duration::from_millis(100),
        eeprom: Duration::from_secs(1),
        mailbox_echo: MAILBOX,
        mailbox_response: MAILBOX,
        ..Timeouts::default()
    };
    let main = Box::new(MainDevice::new(pdus, timeouts, config));
    let begin = port.time();
    let mut exchange = Exchange::new(tx, rx, port);
    let step = "finding subdevices";
    let finding = Box::pin(main.init_single_group::<MAX_SUBDEVICES, MAX_DATA>(|| begin));
    let group = match block_on(&mut exchange, finding) {
        Ok(group) => Box::new(group),
        Err(Failed::Bus(Error::Capacity(Item::SubDevice))) => {
            return Err(OpenError::TooMany {
                most: MAX_SUBDEVICES,
            });
        }
        Err(Failed::Bus(Error::Timeout(_))) if !exchange.has_answer() => {
            let wire = wire.name();
            return Err(match exchange.take_refusal() {
                Some(error) => OpenError::Interface { wire, error },
                None => OpenError::Nobody { wire },
            });
        }
        Err(failed) => return Err(failed.at(step).into()),
    };
    if group.is_empty() {
        return Err(OpenError::Uncounted { wire: wire.name() });
    }
    let found = group.iter(&main).map(|each| describe(&each)).collect();
    let clocks = group.iter(&main).map(|each| each.dc_support()).collect();
    let reached = Reached {
        group,
        found,
        clocks,
    };
    Ok((main, exchange, reached))
}

fn describe(subdevice: &impl Deref<Target = SubDevice>) -> Found {
    let identity = subdevice.identity();
    Found {
        name: subdevice.name().to_owned(),
        vendor: identity.vendor_id,
        product: identity.product_id,
        revision: identity.revision,
        serial: identity.serial,
        has_clock: subdevice.dc_support().any(),
        outputs: 0,
        inputs: 0,
    }
}

/// A step that did not succeed.
pub(crate) enum Failed {
    Bus(Error),
    /// A subdevice has sent an emergency message in place of an answer.
    Emergency,
    Broken(Broken),
}

impl Failed {
    pub(crate) fn at(self, step: &'static str) -> (&'static str, StepError) {
        let error = match self {
            Self::Bus(error) => error.into(),
            Self::Emergency => StepError::Emergency,
            Self::Broken(Broken::System(error)) => StepError::System(error),
            Self::Broken(Broken::Panicked(text)) => StepError::Panicked(text),
        };
        (step, error)
    }
}

impl From<(&'static str, StepError)> for OpenError {
    fn from((step, error): (&'static str, StepError)) -> Self {
        Self::Step { step, error }
    }
}

/// Does a step of the set-up.
pub(crate) fn block_on<T>(
    exchange: &mut Exchange,
    step: std::pin::Pin<Box<impl Future<Output = Result<T, Error>>>>,
) -> Result<T, Failed> {
    match exchange.block_on(step) {
        Ok(done) => done.map_err(Failed::Bus),
        // The library asserts that no emergency message comes.
        Err(Broken::Panicked(text)) if text.contains("Emergency") => Err(Failed::Emergency),
        Err(broken) => Err(Failed::Broken(broken)),
    }
}

impl Bus {
    /// As [`open`], without the device manager: twice if so called, and in an emergency its
    /// outputs are safe only by [`BusProcess::neutral`](crate::BusProcess::neutral).
    ///
    /// # Errors
    ///
    /// [`OpenError`].
    pub fn open(wire: &Wire, expected: &[Expected]) -> Result<Self, OpenError> {
        let (main, mut exchange, reached) = find(wire)?;
        let Reached {
            mut group,
            mut found,
            clocks,
        } = reached;
        compare(expected, &found)?;
        let syncs: Vec<_> = expected.iter().map(|each| each.has_sync0).collect();
        for (mut subdevice, has_sync0) in group.iter_mut(&main).zip(&syncs) {
            if *has_sync0 {
                subdevice.set_dc_sync(DcSync::Sync0);
            }
        }
        sdo::configure(&main, &mut exchange, &group, expected)?;
        let step = "mapping process data";
        let mapping = Box::pin(group.into_pre_op_pdi(&main));
        let group = match block_on(&mut exchange, mapping) {
            Ok(group) => Box::new(group),
            Err(Failed::Bus(Error::PdiTooLong { desired_length, .. })) => {
                return Err(OpenError::TooMuchData {
                    bytes: desired_length,
                    most: MAX_DATA,
                });
            }
            Err(failed) => return Err(failed.at(step).into()),
        };
        for (subdevice, found) in group.iter(&main).zip(&mut found) {
            found.outputs = subdevice.outputs_raw().len();
            found.inputs = subdevice.inputs_raw().len();
        }
        Ok(Self {
            reference: clocks.iter().copied().find(DcSupport::any),
            can_sync: clocks.iter().map(DcSupport::enhanced).collect(),
            main,
            exchange,
            group,
            found,
            syncs,
            device: None,
        })
    }

    /// Its subdevices, in the order of the line.
    pub fn subdevices(&self) -> &[Found] {
        &self.found
    }

    /// Its handle, if it was opened by [`open`]. A clone of it keeps the bus open.
    pub fn device(&self) -> Option<&Device<BusDevice>> {
        self.device.as_ref()
    }

    /// Creates a link called `name`, with a loop of that name that exchanges process data each
    /// `period`. Nothing is connected yet.
    pub fn link(self, name: &str, period: Duration) -> Link {
        Link::new(self, name, period)
    }
}

fn compare(expected: &[Expected], found: &[Found]) -> Result<(), OpenError> {
    for position in 0..expected.len().max(found.len()) {
        match (expected.get(position), found.get(position)) {
            (Some(expected), Some(found)) if expected.is(found) => {}
            (Some(expected), Some(found)) => {
                return Err(OpenError::Mismatch {
                    position,
                    expected: Box::new(expected.clone()),
                    found: found.clone(),
                });
            }
            (Some(expected), None) => {
                return Err(OpenError::Missing {
                    position,
                    expected: expected.clone(),
                    count: found.len(),
                });
            }
            (None, Some(found)) => {
                return Err(OpenError::Unexpected {
                    position,
                    found: found.clone(),
                });
            }
            (None, None) => {}
        }
    }
    Ok(())
}

luna_platform::debug_fields!(Bus, |bus| found: bus.found);
