//! Joysticks: a simulated one with events from a pipe, and the kernel's where one can be created.

#![cfg(feature = "evdev")]

use crate::common;
use common::{SpawnOk, run_to_loss, skip, with_files};
use luna::devices::{Device, Sharing};
use luna::prelude::*;
use luna_links::Transport;
use luna_links::joystick::{self, Control, Controller, Range, Snapshot};
use std::io::{self, PipeReader, PipeWriter, Write};
use std::os::fd::OwnedFd;
use std::sync::{Arc, Mutex};

/// Two axes, and their positions.
struct Simulated {
    events: PipeReader,
    stands: Arc<Mutex<Snapshot>>,
}

impl Transport for Simulated {
    fn file(&self) -> io::Result<OwnedFd> {
        Ok(self.events.try_clone()?.into())
    }
}

impl Controller for Simulated {
    fn range(&self, axis: u16) -> Option<Range> {
        (axis < 2).then_some(Range {
            least: 0,
            most: 200,
            flat: 0,
        })
    }

    fn snapshot(&self) -> io::Result<Snapshot> {
        Ok(*self.stands.lock().unwrap())
    }
}

fn simulated(system: &System) -> (Device<Simulated>, Arc<Mutex<Snapshot>>, PipeWriter) {
    let (events, far) = io::pipe().unwrap();
    let mut snapshot = Snapshot::ZERO;
    snapshot.axes[..2].copy_from_slice(&[100, 200]);
    let stands = Arc::new(Mutex::new(snapshot));
    let own = stands.clone();
    let opened = system
        .devices()
        .open("stick", "joystick", Sharing::Exclusive, || {
            Ok(Simulated {
                events,
                stands: own,
            })
        });
    (opened.unwrap(), stands, far)
}

fn event(kind: u16, code: u16, value: i32) -> Vec<u8> {
    let mut bytes = vec![7; 2 * size_of::<usize>()];
    bytes.extend(kind.to_ne_bytes());
    bytes.extend(code.to_ne_bytes());
    bytes.extend(value.to_ne_bytes());
    bytes
}

#[test]
fn controls_come_in_order_and_are_right_after_lost_events() {
    let Some(_watch) = with_files() else { return };
    let mut system = System::new("joystick");
    let (stick, stands, mut far) = simulated(&system);
    let (sender, controls) = luna::channel();
    let link = joystick::controls(&stick, sender).unwrap();
    let counts = link.counts();
    let main = system.executor("main").build().unwrap();
    main.process("joystick").spawn_ok(link);
    let axis = |axis, position| Control::Axis { axis, position };
    main.process("user").spawn_ok(async move {
        // The initial position, if it is not the middle.
        assert_eq!(controls.recv().await?, axis(1, 1.0));
        let mut events = event(3, 0, 150);
        events.extend(event(1, 300, 1));
        events.extend(event(0, 0, 0));
        // In two pieces that cut an event.
        let (begin, end) = events.split_at(30);
        far.write_all(begin).unwrap();
        assert_eq!(controls.recv().await?, axis(0, 0.5));
        far.write_all(end).unwrap();
        let pressed = |pressed| Control::Button {
            button: 300,
            pressed,
        };
        assert_eq!(controls.recv().await?, pressed(true));
        {
            let mut stands = stands.lock().unwrap();
            stands.axes[0] = 150;
            stands.axes[1] = 0;
        }
        // Lost, and something that means nothing then.
        let lost = [event(0, 3, 0), event(3, 0, 7), event(0, 0, 0)];
        far.write_all(&lost.concat()).unwrap();
        assert_eq!(controls.recv().await?, axis(1, -1.0));
        assert_eq!(controls.recv().await?, pressed(false));
        Ok(())
    });
    drop(stick);
    system.run().unwrap();
    assert_eq!(counts.bad(), 1);
}

#[test]
fn a_joystick_that_is_unplugged_is_an_emergency() {
    let Some(_watch) = with_files() else { return };
    let mut system = System::new("unplugged");
    let devices = system.devices();
    let (stick, _stands, far) = simulated(&system);
    let (sender, controls) = luna::channel();
    let main = system.executor("main").build().unwrap();
    let link = joystick::controls(&stick, sender).unwrap();
    main.process("joystick").spawn_ok(link);
    main.process("user").spawn_ok(async move {
        controls.recv().await?;
        drop(far);
        while controls.recv().await.is_ok() {}
        std::future::pending::<()>().await;
        Ok(())
    });
    drop(stick);
    let error = run_to_loss(&system, &devices);
    assert!(error.contains("the joystick `stick` is lost"), "{error}");
}

/// The kernel's own, if it can make one.
#[test]
fn a_joystick_of_the_kernel() {
    use evdev::{AbsInfo, AbsoluteAxisCode, AttributeSet, InputEvent, KeyCode, UinputAbsSetup};
    let Some(_watch) = with_files() else { return };
    let made = evdev::uinput::VirtualDevice::builder().and_then(|builder| {
        let axis = AbsInfo::new(0, -100, 100, 0, 0, 0);
        let mut keys = AttributeSet::new();
        keys.insert(KeyCode::BTN_TRIGGER);
        builder
            .name("luna test")
            .with_absolute_axis(&UinputAbsSetup::new(AbsoluteAxisCode::ABS_X, axis))?
            .with_keys(&keys)?
            .build()
    });
    let mut device = match made {
        Ok(device) => device,
        Err(error) => {
            return skip(&format!(
                "the kernel makes no input device (uinput): {error}"
            ));
        }
    };
    let path = device.enumerate_dev_nodes_blocking().unwrap().next();
    let path = path.unwrap().unwrap();
    let mut system = System::new("kernel");
    let stick = joystick::open_alone(&system.devices(), path.to_str().unwrap()).unwrap();
    let (sender, controls) = luna::channel();
    let main = system.executor("main").build().unwrap();
    let link = joystick::controls(&stick, sender).unwrap();
    main.process("joystick").spawn_ok(link);
    main.process("user").spawn_ok(async move {
        device.emit(&[InputEvent::new(3, 0, 50)]).unwrap();
        let expected = Control::Axis {
            axis: joystick::X,
            position: 0.5,
        };
        assert_eq!(controls.recv().await?, expected);
        Ok(())
    });
    drop(stick);
    system.run().unwrap();
}
