//! An open device, and those who use it.

use super::error::DeviceError;
use super::manager::Sharing;
use crate::error::Error;
use crate::safety::{Function, emergency};
use crate::system::Plan;
use luna_platform::lock::PiLock;
use luna_platform::path::off_path;
use luna_platform::reclaim::Shared;
use std::fmt;
use std::ops::Deref;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Weak};

/// What becomes of the system when a device is lost while it runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum OnLoss {
    /// An emergency: the functions of [`on_emergency`](crate::System::on_emergency) run, and the system ends. The default, since who drives something that
    /// moves must not go on without it.
    #[default]
    Emergency,
    /// The link's process fails, and with it its channels end; the others go on.
    Fail,
}

/// How it is with a device.
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

/// How it is with a device, at one moment.
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
    /// By what its loss was found out, also when it is closed.
    pub loss: Option<Error>,
}

/// What is known of a device, also when it is closed.
#[derive(Debug)]
pub(super) struct Status {
    name: Arc<str>,
    key: String,
    kind: &'static str,
    users: AtomicUsize,
    is_closed: AtomicBool,
    is_loss_fatal: AtomicBool,
    loss: PiLock<Option<Error>>,
}

impl Status {
    pub(super) fn new(name: &str, key: String, kind: &'static str) -> Self {
        Self {
            name: Arc::from(name),
            key,
            kind,
            users: AtomicUsize::new(0),
            is_closed: AtomicBool::new(false),
            is_loss_fatal: AtomicBool::new(true),
            loss: PiLock::new(None),
        }
    }

    pub(super) fn key(&self) -> &str {
        &self.key
    }

    pub(super) fn view(&self, sharing: Sharing) -> DeviceView {
        let loss = self.loss.lock().clone();
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
}

impl<D> Open<D> {
    pub(super) fn new(device: D, status: Arc<Status>) -> Self {
        Self {
            device: Some(device),
            status,
        }
    }

    fn device(&self) -> &D {
        self.device.as_ref().expect("it is taken by the drop alone")
    }
}

impl<D> Drop for Open<D> {
    fn drop(&mut self) {
        self.device = None;
        self.status.is_closed.store(true, Ordering::Release);
    }
}

/// A handle to an open device: one user of it. Made by [`DeviceManager::open`](super::DeviceManager::open).
///
/// It is cloned for each process that uses the device, and gives access to what its driver has opened. When the last handle is dropped the device is
/// closed, also after an emergency; never on the real-time path: what a process drops there is closed by the thread that runs the system. A process that was
/// [left behind](crate::System::run) keeps its handle.
pub struct Device<D: Send + Sync + 'static> {
    open: Shared<Arc<Open<D>>>,
    plan: Weak<Plan>,
}

impl<D: Send + Sync + 'static> Device<D> {
    pub(super) fn new(open: Arc<Open<D>>, plan: Weak<Plan>) -> Self {
        open.status.users.fetch_add(1, Ordering::AcqRel);
        Self {
            open: Shared::new(open),
            plan,
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

    /// Registers a function that brings the device to safety: `what` it does, for messages. It runs as those of [`System::on_emergency`](crate::System::on_emergency),
    /// in the order in which all are registered, unless the device is closed by then.
    ///
    /// It runs on the emergency thread while processes may be using the device: it must not wait for them longer than can be borne, and what they do
    /// after it must not undo it.
    ///
    /// # Errors
    ///
    /// [`DeviceError::TooLate`] once the system runs.
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
        mut function: impl FnMut(&D) + Send + 'static,
    ) -> Result<(), DeviceError> {
        let plan = self.plan.upgrade().filter(|plan| !plan.has_begun());
        let Some(plan) = plan else {
            return Err(DeviceError::TooLate {
                device: self.name().to_owned(),
            });
        };
        let open = Arc::downgrade(&*self.open);
        plan.settings().functions.push(Function {
            name: format!("{}: {what}", self.name()),
            run: Box::new(move || {
                if let Some(open) = open.upgrade() {
                    function(open.device());
                }
            }),
        });
        Ok(())
    }

    /// Says what becomes of the system when the device is lost; all its handles share it.
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
        let status = &self.open.status;
        status
            .is_loss_fatal
            .store(policy == OnLoss::Emergency, Ordering::Release);
    }

    /// Says that the device is gone or does not answer, as was found by `error`: called by its driver in a process, which then ends with what this gives.
    ///
    /// By default it raises an emergency, as [`emergency`](crate::emergency()) does; see [`on_loss`](Self::on_loss). The first loss is what the manager tells. It allocates,
    /// off the real-time path.
    #[must_use = "the process is to end with it: return it as its error"]
    pub fn lost(&self, error: impl Into<Error>) -> Error {
        let status = &self.open.status;
        let error = error.into();
        let lost = off_path(|| {
            let mut loss = status.loss.lock();
            if loss.is_none() {
                *loss = Some(error.clone());
            }
            drop(loss);
            Error::from(DeviceError::Lost {
                device: status.name.clone(),
                kind: status.kind,
                error,
            })
        });
        if status.is_loss_fatal.load(Ordering::Acquire) {
            emergency(lost)
        } else {
            lost
        }
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
            plan: self.plan.clone(),
        }
    }
}

impl<D: Send + Sync + 'static> Drop for Device<D> {
    fn drop(&mut self) {
        self.open.status.users.fetch_sub(1, Ordering::AcqRel);
    }
}

impl<D: Send + Sync + 'static> fmt::Debug for Device<D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Device")
            .field("name", &self.name())
            .field("kind", &self.kind())
            .finish_non_exhaustive()
    }
}
