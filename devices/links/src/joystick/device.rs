//! The kernel's input devices, by the crate `evdev`.

use super::{Controller, MAX_AXES, Range, Snapshot};
use crate::Transport;
use evdev::KeyCode;
use luna::devices::{Device, DeviceError, DeviceManager, Node, Sharing};
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::path::Path;

const NODE: Node = Node::new("input device").subsystem("input").group("input");

/// An open input device: see [`open`].
pub struct InputDevice {
    device: evdev::Device,
    ranges: Box<[Option<Range>; MAX_AXES]>,
}

/// Opens the input device at `path`, such as `/dev/input/event5` or its permanent name in
/// `/dev/input/by-id`. Other programs see its events, too.
///
/// # Errors
///
/// A [`DeviceError`]: missing, busy in this program, no permission, no input device.
///
/// ```
/// use luna::devices::DeviceError;
/// use luna_links::joystick;
///
/// let system = luna::System::new("machine");
/// let opened = joystick::open(&system.devices(), "/dev/null");
/// assert!(matches!(opened, Err(DeviceError::WrongKind { expected: "input device", .. })));
/// ```
pub fn open(devices: &DeviceManager, path: &str) -> Result<Device<InputDevice>, DeviceError> {
    opened(devices, path, false)
}

/// As [`open`], and grabs the device: no other program gets its events meanwhile, not even the
/// desktop.
///
/// # Errors
///
/// As for [`open`]; busy, if another program has grabbed it.
pub fn open_alone(devices: &DeviceManager, path: &str) -> Result<Device<InputDevice>, DeviceError> {
    opened(devices, path, true)
}

fn opened(
    devices: &DeviceManager,
    path: &str,
    is_grabbed: bool,
) -> Result<Device<InputDevice>, DeviceError> {
    devices.open(path, NODE.kind(), Sharing::Exclusive, || {
        let file = Path::new(path);
        NODE.check(file)?;
        let refused = |error| NODE.explain(file, error);
        let mut device = evdev::Device::open(file).map_err(refused)?;
        if is_grabbed {
            device.grab().map_err(refused)?;
        }
        let mut ranges = Box::new([None; MAX_AXES]);
        if let Some(axes) = device.supported_absolute_axes() {
            let about = device.get_abs_state().map_err(refused)?;
            for axis in axes.iter() {
                let number = usize::from(axis.0);
                if let (Some(range), Some(about)) = (ranges.get_mut(number), about.get(number)) {
                    *range = Some(Range {
                        least: about.minimum,
                        most: about.maximum,
                        flat: about.flat,
                    });
                }
            }
        }
        Ok(InputDevice { device, ranges })
    })
}

impl Transport for InputDevice {
    fn file(&self) -> io::Result<OwnedFd> {
        self.device.as_fd().try_clone_to_owned()
    }
}

impl Controller for InputDevice {
    fn range(&self, axis: u16) -> Option<Range> {
        *self.ranges.get(usize::from(axis))?
    }

    fn snapshot(&self) -> io::Result<Snapshot> {
        let mut snapshot = Snapshot::ZERO;
        if self.device.supported_absolute_axes().is_some() {
            let axes = self.device.get_abs_state()?;
            for (value, about) in snapshot.axes.iter_mut().zip(axes) {
                *value = about.value;
            }
        }
        if self.device.supported_keys().is_some() {
            let keys = self.device.get_key_state()?;
            for KeyCode(number) in keys.iter() {
                snapshot.press(number, true);
            }
        }
        Ok(snapshot)
    }
}

luna_platform::debug_fields!(InputDevice, |device| name: device.device.name());
