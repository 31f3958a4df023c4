//! Which device is open, and by which users.

use crate::device::{Device, DeviceView, OnLoss, Open, Status};
use luna_error::{DeviceError, Error, Holder, Result};
use luna_platform::lock::PiLock;
use std::any::Any;
use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// How long an opening waits for the closing before it.
const CLOSING: Duration = Duration::from_secs(1);

/// Whether a device that is open already may be opened again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Sharing {
    /// Others that open it as shared, too, and as the same type: all use what the first has opened.
    Shared,
    /// No other user.
    Exclusive,
}

/// Opens the devices of a `System`: see
/// `System::devices`.
///
/// Cloning it is cheap, and it does not borrow the system. Devices belong to the set-up; one may
/// also be opened in a `pre_run`, or anew while the system runs when it was lost. Not for the
/// real-time path: its functions take plain locks, and opening is what drivers make of it.
#[derive(Clone)]
pub struct DeviceManager {
    devices: Arc<Devices>,
}

/// What a system does for its devices.
#[doc(hidden)]
pub trait Host: Send + Sync {
    /// Adds an emergency function, which may take so long, or as long as those without a limit.
    ///
    /// # Errors
    ///
    /// It would never be run, or there are too many.
    fn on_emergency(
        &self,
        name: &str,
        limit: Option<Duration>,
        function: Box<dyn FnMut() + Send>,
    ) -> Result<u64>;
    /// Takes an emergency function back.
    fn withdraw(&self, function: u64);
    /// A device is lost.
    fn lost(&self, policy: OnLoss, error: &Error);
    /// Whether there is an emergency.
    fn has_emergency(&self) -> bool;
    /// An opening has failed.
    fn note_refusal(&self);
}

/// What a system keeps of its devices.
#[doc(hidden)]
pub struct Devices {
    pub(super) host: Arc<dyn Host>,
    entries: Mutex<Vec<Entry>>,
    kept: PiLock<Kept>,
}

/// Devices with no handle left, dropped in an emergency, perhaps before their functions have run.
#[derive(Default)]
struct Kept {
    open: Vec<Arc<dyn Any + Send + Sync>>,
    /// The functions have run: nothing is kept any more.
    is_over: bool,
}

struct Entry {
    status: Arc<Status>,
    sharing: Sharing,
    /// What was opened; none while it is being opened, or when that failed.
    open: Option<Weak<dyn Any + Send + Sync>>,
}

impl Entry {
    fn is_open(&self) -> bool {
        let open = self.open.as_ref();
        open.is_some_and(|open| open.strong_count() > 0)
    }

    /// What is open, if it is.
    fn open(&self) -> Option<Arc<dyn Any + Send + Sync>> {
        self.open.as_ref()?.upgrade()
    }
}

impl Devices {
    /// Of the system that is behind `host`.
    pub fn new(host: Arc<dyn Host>) -> Arc<Self> {
        Arc::new(Self {
            host,
            entries: Mutex::default(),
            kept: PiLock::default(),
        })
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Entry>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Keeps a device open until the emergency functions have run. Allocates nothing, since there
    /// is room for each from its opening on.
    pub(super) fn keep(&self, open: Arc<dyn Any + Send + Sync>) {
        let mut kept = self.kept.lock();
        if !kept.is_over {
            kept.open.push(open);
        }
    }

    /// The emergency functions, if there was an emergency, have run: closes the devices that were
    /// kept open for them.
    pub fn let_go(&self) {
        let mut kept = self.kept.lock();
        kept.is_over = true;
        let open = std::mem::take(&mut kept.open);
        drop(kept);
        drop(open);
    }
}

/// Forgets a device that could not be opened.
struct Forget<'a> {
    devices: &'a Devices,
    status: &'a Arc<Status>,
}

impl Drop for Forget<'_> {
    fn drop(&mut self) {
        let mut entries = self.devices.lock();
        entries.retain(|entry| entry.open.is_some() || !Arc::ptr_eq(&entry.status, self.status));
    }
}

impl DeviceManager {
    /// Of these.
    #[doc(hidden)]
    pub fn new(devices: Arc<Devices>) -> Self {
        Self { devices }
    }

    /// Opens the device `name`, or shares what is open under that name already.
    ///
    /// `open` is called only in the first case, and does all that opening means; dropping what it
    /// gives closes the device. A device that its last user has just left is waited for, until it
    /// is closed, for a second at most. Real-time path: no. `kind` is what the device is, in the
    /// words of an error: "motor driver". A name that is a path is that of the file which it leads
    /// to, so a link and its target are one device.
    ///
    /// # Errors
    ///
    /// [`DeviceError::Busy`] if it is open in this system and not shared by both, or open as
    /// another type; and whatever `open` fails with. Then the device may be opened again.
    ///
    /// ```
    /// use luna::devices::{DeviceError, Holder, Sharing};
    /// use luna::prelude::*;
    ///
    /// let system = System::new("machine");
    /// let devices = system.devices();
    /// let bus = devices.open("bus", "field bus", Sharing::Shared, || Ok(42))?;
    /// let same = devices.open("bus", "field bus", Sharing::Shared, || -> Result<i32, DeviceError> { unreachable!() })?;
    /// assert_eq!((*bus, *same, devices.list()[0].users), (42, 42, 2));
    /// let refused = devices.open("bus", "field bus", Sharing::Exclusive, || Ok(0));
    /// assert!(matches!(refused, Err(DeviceError::Busy { by: Holder::ThisProgram, .. })));
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn open<D: Send + Sync + 'static>(
        &self,
        name: &str,
        kind: &'static str,
        sharing: Sharing,
        open: impl FnOnce() -> Result<D, DeviceError>,
    ) -> Result<Device<D>, DeviceError> {
        self.open_or_share(name, kind, sharing, open)
            .inspect_err(|_| self.devices.host.note_refusal())
    }

    fn open_or_share<D: Send + Sync + 'static>(
        &self,
        name: &str,
        kind: &'static str,
        sharing: Sharing,
        open: impl FnOnce() -> Result<D, DeviceError>,
    ) -> Result<Device<D>, DeviceError> {
        let busy = || DeviceError::Busy {
            device: name.to_owned(),
            by: Holder::ThisProgram,
        };
        let devices = &self.devices;
        let key = key(name);
        self.wait_while_closing(&key);
        let status = {
            let mut entries = devices.lock();
            let there = entries.iter().position(|entry| *entry.status.key == *key);
            if let Some(entry) = there.map(|place| &entries[place]) {
                if entry.open.is_none() {
                    return Err(busy());
                }
                if let Some(open) = entry.open() {
                    let both = (entry.sharing, sharing) == (Sharing::Shared, Sharing::Shared);
                    return match open.downcast::<Open<D>>() {
                        Ok(open) if both => Ok(Device::new(open)),
                        _ => Err(busy()),
                    };
                }
            }
            // It was closed: another opening is another device.
            if let Some(place) = there {
                entries.remove(place);
            }
            let status = Arc::new(Status::new(name, key, kind));
            entries.push(Entry {
                status: status.clone(),
                sharing,
                open: None,
            });
            devices.kept.lock().open.reserve(entries.len());
            status
        };
        // Without the lock: the call is into the driver, which may open a device below its own.
        let forget = Forget {
            devices,
            status: &status,
        };
        let open = Arc::new(Open::new(open()?, status.clone(), devices.clone()));
        let held: Arc<dyn Any + Send + Sync> = open.clone();
        for entry in &mut *devices.lock() {
            if Arc::ptr_eq(&entry.status, &status) {
                entry.open = Some(Arc::downgrade(&held));
            }
        }
        drop(forget);
        Ok(Device::new(open))
    }

    /// Waits while the device is being closed: what a process dropped on the real-time path is
    /// closed by another thread, a moment later.
    fn wait_while_closing(&self, key: &str) {
        let begin = Instant::now();
        let is_closing = || {
            let entries = self.devices.lock();
            let entry = entries.iter().find(|entry| entry.status.key == key);
            entry.is_some_and(|entry| entry.status.is_left() && entry.is_open())
        };
        // In an emergency it stays open until the functions have run.
        while !self.devices.host.has_emergency() && is_closing() && begin.elapsed() < CLOSING {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// All devices that were opened, in that order, with those that are closed again.
    ///
    /// ```
    /// use luna::devices::{DeviceState, Sharing};
    ///
    /// let system = luna::System::new("machine");
    /// let devices = system.devices();
    /// let lamp = devices.open("lamp", "lamp", Sharing::Exclusive, || Ok(()))?;
    /// assert_eq!((devices.list()[0].state, devices.list()[0].users), (DeviceState::Open, 1));
    /// drop(lamp);
    /// assert_eq!((devices.list()[0].state, devices.list()[0].users), (DeviceState::Closed, 0));
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn list(&self) -> Vec<DeviceView> {
        self.devices
            .lock()
            .iter()
            .filter(|entry| entry.open.is_some())
            .map(|entry| entry.status.view(entry.sharing))
            .collect()
    }
}

/// The key that a device is known by.
fn key(name: &str) -> String {
    if !name.starts_with('/') {
        return name.to_owned();
    }
    std::fs::canonicalize(name).map_or_else(
        |_| name.to_owned(),
        |path| path.to_string_lossy().into_owned(),
    )
}

impl fmt::Debug for DeviceManager {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.list()).finish()
    }
}

luna_platform::debug_fields!(Devices);
