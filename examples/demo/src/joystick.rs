//! A real joystick in the place of the recording: what takes over the process that plays it.

use luna::devices::OnLoss;
use luna::prelude::*;
use luna::{Error, Executor};
use luna_jiwy::AXES;
use luna_jiwy::joystick::{Deflection, Sticks};
use luna_links::joystick::{self, Control};
use std::path::Path;
use std::time::Duration;

/// As often as a recording is sampled.
const PERIOD: Duration = Duration::from_millis(10);

/// Whether the file is a device, and not a recording.
pub(crate) fn is_device(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt;
    std::fs::metadata(path).is_ok_and(|about| about.file_type().is_char_device())
}

/// Lets the joystick at `path` move the camera, from processes on `executor`. Unplugging it is the
/// safe state: the camera keeps its last setpoint.
pub(crate) fn follow(system: &mut System, executor: &Executor, path: &Path) -> luna::Result<()> {
    let Some(name) = path.to_str() else {
        return Err(Error::other("a device's name is UTF-8"));
    };
    let device = joystick::open(&system.devices(), name)?;
    device.on_loss(OnLoss::SafeState);
    let (sender, controls) = luna::channel();
    let link = joystick::controls(&device, sender)?;
    executor.process("joystick device").spawn(link)?;
    system.stand_in("joystick", move |ends: Sticks| steer(controls, ends))?;
    Ok(())
}

/// Sends the stick's position to both axes, until they have ended. Away from oneself is up.
async fn steer(controls: Receiver<Control>, Sticks(sticks): Sticks) -> luna::Result<()> {
    let mut tick = luna::periodic("joystick", PERIOD)?;
    let mut deflection = Deflection::default();
    loop {
        tick.next().await;
        while let Ok(control) = controls.try_recv() {
            match control {
                Control::Axis {
                    axis: joystick::X,
                    position,
                } => deflection.pan = position,
                Control::Axis {
                    axis: joystick::Y,
                    position,
                } => deflection.tilt = -position,
                _ => {}
            }
        }
        for (axis, stick) in AXES.iter().zip(&sticks) {
            if stick.send((axis.stick)(deflection)).await.is_err() {
                return Ok(());
            }
        }
    }
}
