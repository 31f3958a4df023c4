//! The device manager: a device is opened once, shared by count, and closed behind the last user,
//! also after an emergency.

#![cfg(unix)]

use crate::common;
use common::{PLACEMENTS, SpawnOk, skip, watchdog};
use luna::devices::{Device, DeviceError, DeviceManager, DeviceState, Holder, OnLoss, Sharing};
use luna::prelude::*;
use luna::safety::Degree;
use luna::{End, Error};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, mpsc};

/// A device that notes what happens to it.
struct Motor(Log);

type Log = Arc<Mutex<Vec<&'static str>>>;

impl Motor {
    fn note(&self, what: &'static str) {
        self.0.lock().unwrap().push(what);
    }
}

impl Drop for Motor {
    fn drop(&mut self) {
        self.note("closed");
    }
}

fn open(devices: &DeviceManager, sharing: Sharing) -> Result<(Device<Motor>, Log), DeviceError> {
    let log = Log::default();
    let own = log.clone();
    let motor = devices.open("motor", "motor", sharing, || Ok(Motor(own)))?;
    Ok((motor, log))
}

fn is_busy(opened: Result<(Device<Motor>, Log), DeviceError>) -> bool {
    matches!(opened, Err(DeviceError::Busy { device, by: Holder::ThisProgram }) if device == "motor")
}

#[test]
fn it_is_closed_with_the_last_user_and_may_be_opened_anew() {
    let system = System::new("count");
    let devices = system.devices();
    let (one, log) = open(&devices, Sharing::Shared).unwrap();
    let (two, never) = open(&devices, Sharing::Shared).unwrap();
    let three = two.clone();
    assert_eq!(devices.list()[0].users, 3);
    assert_eq!(Arc::strong_count(&never), 1, "only the first opens it");
    drop((one, three));
    assert_eq!(*log.lock().unwrap(), [""; 0]);
    drop(two);
    assert_eq!(*log.lock().unwrap(), ["closed"]);
    let (again, _) = open(&devices, Sharing::Exclusive).unwrap();
    assert!(is_busy(open(&devices, Sharing::Exclusive)));
    drop(again);
    let states: Vec<_> = devices.list().iter().map(|about| about.state).collect();
    assert_eq!(states, [DeviceState::Closed], "one device, the same again");
}

#[test]
fn it_is_opened_anew_as_soon_as_the_process_that_used_it_has_ended() {
    let _watchdog = watchdog();
    let mut system = System::new("again");
    let devices = system.devices();
    let main = system.executor("main").build().unwrap();
    let user = main.clone();
    main.process("opens it")
        .spawn(async move {
            for _ in 0..20 {
                let own = devices.clone();
                let open = move || open(&own, Sharing::Exclusive).map(|(motor, _)| motor);
                let motor = luna::blocking(open).await?;
                let process = user.process("uses it").one_of_many().start(async move {
                    luna::yield_now().await;
                    drop(motor);
                    Ok(())
                })?;
                process.join().await;
            }
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
}

#[test]
fn one_that_wants_it_alone_does_not_share_it() {
    let system = System::new("sharing");
    let devices = system.devices();
    for (first, second) in [
        (Sharing::Exclusive, Sharing::Shared),
        (Sharing::Shared, Sharing::Exclusive),
        (Sharing::Exclusive, Sharing::Exclusive),
    ] {
        let (_motor, _) = open(&devices, first).unwrap();
        assert!(is_busy(open(&devices, second)), "{first:?} {second:?}");
    }
    // As another type it is another driver's.
    let (_motor, _) = open(&devices, Sharing::Shared).unwrap();
    let other = devices.open("motor", "motor", Sharing::Shared, || Ok(5));
    assert!(matches!(other, Err(DeviceError::Busy { .. })));
}

#[test]
fn what_cannot_be_opened_may_be_tried_again() {
    let system = System::new("retry");
    let devices = system.devices();
    let missing = || DeviceError::Missing {
        device: "motor".to_owned(),
        kind: "motor",
    };
    let refused = devices.open(
        "motor",
        "motor",
        Sharing::Exclusive,
        || -> Result<Motor, _> { Err(missing()) },
    );
    assert_eq!(refused.unwrap_err(), missing());
    assert_eq!(devices.list(), []);
    let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        devices.open(
            "motor",
            "motor",
            Sharing::Exclusive,
            || -> Result<Motor, _> { panic!("a bug in a driver") },
        )
    }));
    assert!(panicked.is_err());
    assert!(open(&devices, Sharing::Exclusive).is_ok());
}

#[test]
fn a_driver_may_open_what_lies_below_it_but_not_itself() {
    let system = System::new("below");
    let devices = system.devices();
    let below = devices.open("chip", "chip", Sharing::Exclusive, || {
        let (pin, _) = open(&devices, Sharing::Shared)?;
        let again = devices.open("chip", "chip", Sharing::Shared, || Ok(()));
        assert!(matches!(again, Err(DeviceError::Busy { .. })));
        Ok(pin)
    });
    let names: Vec<_> = devices.list().into_iter().map(|about| about.name).collect();
    assert_eq!(names, ["chip", "motor"]);
    drop(below);
    assert!(devices.list().iter().all(|about| about.users == 0));
}

#[test]
fn in_an_emergency_its_functions_run_in_order_and_then_it_is_closed() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let mut system = System::new("emergency");
        let devices = system.devices();
        let (motor, log) = open(&devices, Sharing::Exclusive).unwrap();
        motor
            .on_emergency("brake", |motor| motor.note("brake"))
            .unwrap();
        let own = log.clone();
        system.on_emergency("horn", move || own.lock().unwrap().push("horn"));
        motor
            .on_emergency("power off", |motor| motor.note("off"))
            .unwrap();
        let process = place.process(&mut system, "place", "drive");
        let own = motor.clone();
        process.spawn_ok(async move { Err(own.lost(Error::other("no answer"))) });
        // Holds its handle to the end, and drops it when it is cancelled, on the real-time path.
        place
            .process(&mut system, "other", "other")
            .spawn_ok(async move {
                std::future::pending::<()>().await;
                drop(motor);
                Ok(())
            });
        let error = system.run().unwrap_err();
        assert_eq!(
            error.to_string(),
            "process `drive`: the motor `motor` is lost: no answer"
        );
        assert_eq!(system.report().unwrap().end, End::Emergency);
        assert_eq!(
            *log.lock().unwrap(),
            ["brake", "horn", "off", "closed"],
            "{place:?}"
        );
        let about = &devices.list()[0];
        assert_eq!((about.state, about.users), (DeviceState::Closed, 0));
        assert_eq!(about.loss.as_ref().unwrap().to_string(), "no answer");
    }
}

/// The last user of the device ends because of the emergency, before the device's function has run.
#[test]
fn it_stays_open_until_its_functions_have_run() {
    let _watch = watchdog();
    let mut system = System::new("stays open");
    let devices = system.devices();
    let (motor, log) = open(&devices, Sharing::Exclusive).unwrap();
    let (gone, is_gone) = mpsc::channel();
    let (seen, is_seen) = mpsc::channel();
    let own = devices.clone();
    system.on_emergency("waits", move || {
        let _ = is_gone.recv();
        seen.send(own.list()[0].clone()).unwrap();
    });
    motor
        .on_emergency("brake", |motor| motor.note("brake"))
        .unwrap();
    system
        .thread("place")
        .process("drive")
        .spawn_ok(async move {
            let error = motor.lost(Error::other("no answer"));
            drop(motor);
            gone.send(()).unwrap();
            Err(error)
        });
    assert!(system.run().is_err());
    let about = is_seen.recv().unwrap();
    assert_eq!((about.users, about.state), (0, DeviceState::Lost));
    assert_eq!(*log.lock().unwrap(), ["brake", "closed"]);
    assert_eq!(devices.list()[0].state, DeviceState::Closed);
}

#[test]
fn one_that_is_closed_by_then_is_left_alone() {
    let _watch = watchdog();
    let mut system = System::new("closed");
    let devices = system.devices();
    let (motor, log) = open(&devices, Sharing::Exclusive).unwrap();
    motor
        .on_emergency("brake", |motor| motor.note("brake"))
        .unwrap();
    drop(motor);
    let main = system.executor("main").build().unwrap();
    main.process("raises")
        .spawn_ok(async { Err(luna::emergency(Error::other("a test"))) });
    assert!(system.run().is_err());
    assert_eq!(*log.lock().unwrap(), ["closed"]);
}

#[test]
fn a_loss_that_is_no_emergency_ends_its_process_alone() {
    let _watch = watchdog();
    let mut system = System::new("loss");
    let devices = system.devices();
    let (motor, log) = open(&devices, Sharing::Exclusive).unwrap();
    motor.on_loss(OnLoss::Fail);
    motor
        .on_emergency("brake", |motor| motor.note("brake"))
        .unwrap();
    let main = system.executor("main").build().unwrap();
    let goes_on = Arc::new(AtomicU32::new(0));
    let count = goes_on.clone();
    let (sender, receiver) = luna::channel::<()>();
    main.process("drive").spawn_ok(async move {
        let _ends_with_it = sender;
        Err(motor.lost(Error::other("first")))
    });
    main.process("other").spawn_ok(async move {
        assert!(receiver.recv().await.is_err());
        count.fetch_add(1, Ordering::Relaxed);
        Ok(())
    });
    let error = system.run().unwrap_err();
    assert!(error.to_string().contains("is lost: first"), "{error}");
    assert_eq!(system.report().unwrap().end, End::Completed);
    assert_eq!(goes_on.load(Ordering::Relaxed), 1);
    assert_eq!(*log.lock().unwrap(), ["closed"]);
}

#[test]
fn lower_degrees_let_the_others_run_on() {
    let _watch = watchdog();
    for (policy, degree) in [
        (OnLoss::SafeState, Degree::SafeState),
        (OnLoss::Warn, Degree::Warning),
        (OnLoss::Fail, Degree::Normal),
    ] {
        let mut system = System::new("degrees");
        let (motor, log) = open(&system.devices(), Sharing::Exclusive).unwrap();
        motor.on_loss(policy);
        let main = system.executor("main").build().unwrap();
        let (sender, receiver) = luna::channel::<()>();
        main.process("drive").spawn_ok(async move {
            let _ends_with_it = sender;
            Err(motor.lost(Error::other("worn")))
        });
        main.process("other").spawn_ok(async move {
            assert!(receiver.recv().await.is_err());
            assert_eq!(luna::safety::current().unwrap().degree(), degree);
            Ok(())
        });
        assert!(system.run().is_err());
        assert_eq!(system.report().unwrap().end, End::Completed);
        assert_eq!(*log.lock().unwrap(), ["closed"]);
    }
}

#[test]
fn one_that_was_lost_may_be_opened_again_while_the_system_runs() {
    let _watch = watchdog();
    let mut system = System::new("again");
    let devices = system.devices();
    let main = system.executor("main").build().unwrap();
    let own = devices.clone();
    let logs = Arc::new(Mutex::new(Vec::new()));
    let kept = logs.clone();
    main.process("drive").spawn_ok(async move {
        for _ in 0..2 {
            let (motor, log) = luna::realtime::off_path(|| open(&own, Sharing::Exclusive))?;
            kept.lock().unwrap().push(log);
            motor.on_loss(OnLoss::Fail);
            let _ = motor.lost(Error::other("unplugged"));
            assert!(matches!(own.list()[0].state, DeviceState::Lost));
            // At once, and not by the thread that runs the system.
            luna::realtime::off_path(|| drop(motor));
            assert!(matches!(own.list()[0].state, DeviceState::Closed));
        }
        let (motor, log) = luna::realtime::off_path(|| open(&own, Sharing::Exclusive))?;
        kept.lock().unwrap().push(log);
        motor.on_emergency("brake", |motor| motor.note("brake"))?;
        Err(motor.lost(Error::other("at last")))
    });
    assert!(system.run().is_err());
    let logs = logs.lock().unwrap();
    let logs: Vec<_> = logs.iter().map(|log| log.lock().unwrap().clone()).collect();
    assert_eq!(
        logs,
        [vec!["closed"], vec!["closed"], vec!["brake", "closed"]]
    );
    assert_eq!(devices.list().len(), 1);
}

/// A device that only root may open, by its own rules. CI runs this as a plain user too.
#[cfg(target_os = "linux")]
#[test]
fn without_permission_the_error_says_what_gives_it() {
    use luna::devices::Node;
    let path = std::path::Path::new("/dev/cpu_dma_latency");
    if !path.exists() {
        return skip("there is no /dev/cpu_dma_latency");
    }
    match Node::new("latency").group("realtime").open(path, false) {
        Err(DeviceError::NoPermission { device, remedy }) => {
            assert_eq!(device, "/dev/cpu_dma_latency");
            let rule = r#"KERNEL=="cpu_dma_latency", GROUP="realtime", MODE="0660""#;
            assert!(
                remedy.contains(rule) || remedy.contains("usermod"),
                "{remedy}"
            );
        }
        Ok(_) => skip("this user may open /dev/cpu_dma_latency"),
        Err(other) => panic!("{other}"),
    }
}

#[test]
fn a_system_that_never_runs_lets_go_of_its_devices() {
    let mut system = System::new("never");
    let (motor, log) = open(&system.devices(), Sharing::Exclusive).unwrap();
    motor
        .on_emergency("brake", |motor| motor.note("brake"))
        .unwrap();
    let main = system.executor("main").build().unwrap();
    main.process("drive").spawn_ok(async move {
        motor.note("ran");
        Ok(())
    });
    drop((main, system));
    assert_eq!(*log.lock().unwrap(), ["closed"]);
}
