//! An open device, and its users.

use crate::manager::{Devices, Sharing};
use luna_core::deferred_free::Shared;
use luna_core::path::off_path;
use luna_error::{DeviceError, Error, Result};
use luna_platform::lock::PiLock;
use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

/// What becomes of the system when a device is lost while it runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum OnLoss {
    /// An emergency: the functions of `on_emergency` run, and the
    /// system ends. The default, since a program that drives something that moves must not go on
    /// without it.
    #[default]
    Emergency,
    /// The safe state: the processes run on with neutral
    /// outputs, but the link's, which fails.
    SafeState,
    /// A warning, and the link's process fails: its channels end
    /// with it, and the others go on.
    Warn,
    /// The link's process fails, and nothing else.
    Fail,
}

/// The state of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum DeviceState {
    /// It is open.
    Open,
    /// It is open, and its driver has found that it is gone or does not answer.
    Lost,
    /// All users have finished, and it is closed.
    Closed,
}

/// A device at one instant.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct DeviceView {
    /// The name it was opened by.
    pub name: String,
    /// What it is: "serial port".
    pub kind: &'static str,
    /// Whether several may open it.
    pub sharing: Sharing,
    /// How many handles there are.
    pub users: usize,
    /// Open, lost or closed.
    pub state: DeviceState,
    /// The error that showed its loss, also when it is closed.
    pub loss: Option<Error>,
}

/// What is known of a device, also when it is closed.
#[derive(Debug)]
pub(super) struct Status {
    name: Arc<str>,
    pub(super) key: String,
    kind: &'static str,
    users: AtomicUsize,
    is_closed: AtomicBool,
    /// What becomes of the system at a loss, and the first loss.
    loss: PiLock<(OnLoss, Option<Error>)>,
}

impl Status {
    pub(super) fn new(name: &str, key: String, kind: &'static str) -> Self {
        Self {
            name: Arc::from(name),
            key,
            kind,
            users: AtomicUsize::new(0),
            is_closed: AtomicBool::new(false),
            loss: PiLock::new((OnLoss::default(), None)),
        }
    }

    /// Whether nobody uses it any more: it is being closed, if it is not yet.
    pub(super) fn is_left(&self) -> bool {
        self.users.load(Ordering::Acquire) == 0
    }

    pub(super) fn view(&self, sharing: Sharing) -> DeviceView {
        let loss = self.loss.lock().1.clone();
        DeviceView {
            name: self.name.to_string(),
            kind: self.kind,
            sharing,
            users: self.users.load(Ordering::Acquire),
            state: if self.is_closed.load(Ordering::Acquire) {
                DeviceState::Closed
            } else if loss.is_some() {
                DeviceState::Lost
            } else {
                DeviceState::Open
            },
            loss,
        }
    }
}

/// What a driver has opened.
pub(super) struct Open<D> {
    /// Closed by its drop; none from then on.
    device: Option<D>,
    status: Arc<Status>,
    /// The functions that run in an emergency while it is open.
    functions: PiLock<Vec<u64>>,
    devices: Arc<Devices>,
}

impl<D> Open<D> {
    pub(super) fn new(device: D, status: Arc<Status>, devices: Arc<Devices>) -> Self {
        Self {
            device: Some(device),
            status,
            functions: PiLock::new(Vec::new()),
            devices,
        }
    }

    fn device(&self) -> &D {
        self.device.as_ref().expect("it is taken by the drop alone")
    }
}

impl<D> Drop for Open<D> {
    fn drop(&mut self) {
        for function in std::mem::take(self.functions.get_mut()) {
            self.devices.host.withdraw(function);
        }
        self.device = None;
        self.status.is_closed.store(true, Ordering::Release);
    }
}

/// A handle to an open device: one user of it. Made by
/// [`DeviceManager::open`](super::DeviceManager::open).
///
/// It is cloned for each process that uses the device, and gives access to what its driver has
/// opened. When the last handle is dropped the device is closed; never on the real-time path: what
/// a process drops there is closed by the thread that runs the system. In an emergency it stays
/// open until all emergency functions have run, and is closed before
/// `System::run` returns. A process that was left behind keeps its handle.
pub struct Device<D: Send + Sync + 'static> {
    open: Shared<Arc<Open<D>>>,
}

impl<D: Send + Sync + 'static> Device<D> {
    pub(super) fn new(open: Arc<Open<D>>) -> Self {
        open.status.users.fetch_add(1, Ordering::AcqRel);
        Self {
            open: Shared::new(open),
        }
    }

    /// The name it was opened by.
    pub fn name(&self) -> &str {
        &self.open.status.name
    }

    /// What it is: "serial port".
    pub fn kind(&self) -> &'static str {
        self.open.status.kind
    }

    /// Registers a function that brings the device to safety: `what` it does, for messages. It runs
    /// as those of `System::on_emergency` and has as long, in the
    /// order in which all are registered, unless the device was closed before the emergency.
    ///
    /// It runs on the emergency thread while processes may be using the device: it must not wait
    /// for them longer than can be borne, and what they do after it must not undo it.
    ///
    /// # Errors
    ///
    /// It would never be run, since an emergency is over or the system has ended; or there are too
    /// many functions.
    ///
    /// ```
    /// use luna::devices::Sharing;
    /// use luna::prelude::*;
    /// use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
    ///
    /// let mut system = System::new("drive");
    /// let motor = system.devices().open("motor", "motor", Sharing::Exclusive, || Ok(AtomicU32::new(100)))?;
    /// motor.on_emergency("power off", |power| power.store(0, Relaxed))?;
    /// let main = system.executor("main").build()?;
    /// let own = motor.clone();
    /// main.process("drive").spawn(async move { Err(own.lost(luna::Error::other("no answer"))) })?;
    /// let error = system.run().unwrap_err();
    /// assert_eq!(error.to_string(), "process `drive`: the motor `motor` is lost: no answer");
    /// assert_eq!(motor.load(Relaxed), 0);
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn on_emergency(
        &self,
        what: &str,
        function: impl FnMut(&D) + Send + 'static,
    ) -> Result<()> {
        self.add_function(what, None, function)
    }

    /// As [`on_emergency`](Self::on_emergency), with a time after which the next function does not
    /// wait for this one any more: for what waits for a bus.
    ///
    /// # Errors
    ///
    /// As for `on_emergency`.
    pub fn on_emergency_within(
        &self,
        what: &str,
        limit: Duration,
        function: impl FnMut(&D) + Send + 'static,
    ) -> Result<()> {
        self.add_function(what, Some(limit), function)
    }

    fn add_function(
        &self,
        what: &str,
        limit: Option<Duration>,
        mut function: impl FnMut(&D) + Send + 'static,
    ) -> Result<()> {
        let open = Arc::downgrade(&*self.open);
        let name = format!("{}: {what}", self.name());
        let call = move || {
            if let Some(open) = open.upgrade() {
                function(open.device());
            }
        };
        let host = &self.open.devices.host;
        let function = host.on_emergency(&name, limit, Box::new(call))?;
        self.open.functions.lock().push(function);
        Ok(())
    }

    /// Sets what becomes of the system when the device is lost; all its handles share it.
    ///
    /// ```
    /// use luna::devices::{OnLoss, Sharing};
    /// use luna::prelude::*;
    ///
    /// let mut system = System::new("robot");
    /// let joystick = system.devices().open("joystick", "joystick", Sharing::Exclusive, || Ok(()))?;
    /// joystick.on_loss(OnLoss::Fail);
    /// let main = system.executor("main").build()?;
    /// main.process("joystick").spawn(async move { Err(joystick.lost(luna::Error::other("unplugged"))) })?;
    /// main.process("legs").spawn(async { Ok(()) })?;
    /// assert!(system.run().is_err());
    /// assert_eq!(system.report().unwrap().end, luna::End::Completed); // no emergency
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn on_loss(&self, policy: OnLoss) {
        self.open.status.loss.lock().0 = policy;
    }

    /// Reports that the device is gone or does not answer, as was found by `error`. Its driver
    /// calls this, and the driver's process then ends with the result. From any thread.
    ///
    /// By default it raises an emergency, as `emergency`) does; see
    /// [`on_loss`](Self::on_loss). The manager reports the first loss. It allocates, off the
    /// real-time path.
    #[must_use = "the process is to end with it: return it as its error"]
    pub fn lost(&self, error: impl Into<Error>) -> Error {
        let status = &self.open.status;
        let error = error.into();
        let (policy, lost) = off_path(|| {
            let mut loss = status.loss.lock();
            let (policy, first) = &mut *loss;
            first.get_or_insert_with(|| error.clone());
            let policy = *policy;
            drop(loss);
            let lost = DeviceError::Lost {
                device: status.name.clone(),
                kind: status.kind,
                error: Box::new(error),
            };
            (policy, Error::from(lost))
        });
        self.open.devices.host.lost(policy, &lost);
        lost
    }
}

impl<D: Send + Sync + 'static> Deref for Device<D> {
    type Target = D;

    fn deref(&self) -> &D {
        self.open.device()
    }
}

impl<D: Send + Sync + 'static> Clone for Device<D> {
    fn clone(&self) -> Self {
        self.open.status.users.fetch_add(1, Ordering::AcqRel);
        Self {
            open: self.open.clone(),
        }
    }
}

impl<D: Send + Sync + 'static> Drop for Device<D> {
    fn drop(&mut self) {
        let users = self.open.status.users.fetch_sub(1, Ordering::AcqRel);
        // A process that ends because of the emergency must not close the device before its
        // functions have run.
        let devices = &self.open.devices;
        if users == 1 && devices.host.has_emergency() {
            devices.keep(Arc::clone(&*self.open) as _);
        }
    }
}

luna_platform::debug_fields!(
    impl[D: Send + Sync + 'static] Device<D>, |device|
    name: device.name(),
    kind: device.kind()
);
