//! The kernel's chips, by the crate `gpiocdev`.

use super::{Chip, Levels, Lines, NODE, Use};
use gpiocdev::Request;
use gpiocdev::line::{EdgeDetection, EventClock, Value, Values};
use gpiocdev::request::Config;
use luna::devices::{DeviceError, Holder};
use luna_platform::lock::PiLock;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::path::Path;

/// Lines that the kernel has given.
pub(super) struct KernelChip {
    request: Request,
    offsets: Vec<u32>,
    /// Kept, so that setting lines allocates nothing.
    values: PiLock<Values>,
}

/// Asks the kernel for lines.
pub(super) fn request(path: &str, name: &str, lines: &Lines) -> Result<KernelChip, DeviceError> {
    let mut config = Config::default();
    let mut values = Values::default();
    for line in &lines.lines {
        config.with_line(line.offset);
        match line.use_ {
            Use::Input => config
                .as_input()
                .with_edge_detection(EdgeDetection::BothEdges)
                .with_event_clock(EventClock::Monotonic),
            Use::Output(level) => {
                values.set(line.offset, Value::from(level));
                config.as_output(Value::from(level))
            }
        };
    }
    let request = Request::from_config(config)
        .on_chip(path)
        .with_consumer(&lines.consumer)
        .request()
        .map_err(|error| refused(path, name, lines, error))?;
    Ok(KernelChip {
        request,
        offsets: lines.lines.iter().map(|line| line.offset).collect(),
        values: PiLock::new(values),
    })
}

fn refused(path: &str, name: &str, lines: &Lines, error: gpiocdev::Error) -> DeviceError {
    let text = error.to_string();
    match NODE.explain(Path::new(path), system_error(error)) {
        DeviceError::Busy { .. } => DeviceError::Busy {
            device: name.to_owned(),
            by: holder(path, lines),
        },
        // An offset that the chip has not, and what it cannot do.
        DeviceError::Refused { error, .. } if error.kind() == io::ErrorKind::InvalidInput => {
            DeviceError::Settings {
                device: name.to_owned(),
                reason: text,
            }
        }
        other => other,
    }
}

/// The process that holds one of the lines, by the kernel's name for it.
fn holder(path: &str, lines: &Lines) -> Holder {
    let Ok(chip) = gpiocdev::Chip::from_path(path) else {
        return Holder::Unknown;
    };
    lines
        .lines
        .iter()
        .filter_map(|line| chip.line_info(line.offset).ok())
        .find(|info| info.used && !info.consumer.is_empty())
        .map_or(Holder::Unknown, |info| Holder::Named {
            name: info.consumer,
        })
}

fn system_error(error: gpiocdev::Error) -> io::Error {
    use gpiocdev::Error;
    match &error {
        Error::Os(number) => io::Error::from_raw_os_error(number.0),
        Error::Uapi(_, gpiocdev_uapi::Error::Os(number)) => io::Error::from_raw_os_error(number.0),
        _ => io::Error::new(io::ErrorKind::InvalidInput, error.to_string()),
    }
}

impl Chip for KernelChip {
    fn set(&self, levels: Levels) -> io::Result<()> {
        let mut values = self.values.lock();
        for (number, offset) in self.offsets.iter().enumerate() {
            if let Some(level) = levels.get(number) {
                values.set(*offset, Value::from(level));
            }
        }
        self.request.set_values(&values).map_err(system_error)
    }

    fn get(&self, number: usize) -> io::Result<bool> {
        let Some(offset) = self.offsets.get(number) else {
            return Err(io::ErrorKind::InvalidInput.into());
        };
        let value = self.request.value(*offset).map_err(system_error)?;
        Ok(value == Value::Active)
    }

    fn edges(&self) -> io::Result<OwnedFd> {
        self.request.as_fd().try_clone_to_owned()
    }
}
