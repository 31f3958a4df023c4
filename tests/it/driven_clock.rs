//! Systems on a clock that a simulator moves: lock-step, and how it ends.

use crate::common;
use common::{SpawnOk, watchdog};
use luna::prelude::*;
use luna::system::{ClockDriver, ClockKind, DriveError};
use luna::{End, Error, Instant};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, mpsc};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

/// Runs `system` on a thread of its own, and gives what `drive` gives.
fn beside<R: Send>(
    system: &System,
    drive: impl FnOnce() -> R + Send,
) -> (luna::Result<luna::Report>, R) {
    std::thread::scope(|scope| {
        let driving = scope.spawn(drive);
        let report = system.run();
        (report, driving.join().unwrap())
    })
}

fn driven() -> (System, luna::Executor, ClockDriver) {
    let mut system = System::new("driven");
    let driver = system.driven_clock();
    let main = system.executor("main").build().unwrap();
    (system, main, driver)
}

/// A motor: an integrator of the second order, in steps of a tenth of the controller's period.
#[derive(Default)]
struct Plant {
    position: f64,
    speed: f64,
}

impl Plant {
    fn step(&mut self, torque: f64, seconds: f64) {
        self.speed += (torque - 0.1 * self.speed) * seconds;
        self.position += self.speed * seconds;
    }
}

/// A controller in lock-step with the plant: positions to a bit, at each step of the plant.
fn lock_step() -> Vec<u64> {
    let (system, main, mut driver) = driven();
    let (position, torque) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
    let (sensor, actuator) = (position.clone(), torque.clone());
    let control = async move {
        let mut tick = luna::periodic("control", MS)?;
        let mut last = 0.0;
        loop {
            tick.next().await;
            let measured = f64::from_bits(sensor.load(Relaxed));
            let speed = (measured - last) / 1e-3;
            last = measured;
            actuator.store((400.0 * (1.0 - measured) - 40.0 * speed).to_bits(), Relaxed);
        }
    };
    main.process("control").spawn_ok(control);
    let (report, positions) = beside(&system, move || {
        let mut plant = Plant::default();
        let mut positions = Vec::new();
        for _ in 0..10_000 {
            driver.advance_by(MS / 10).unwrap();
            plant.step(f64::from_bits(torque.load(Relaxed)), 1e-4);
            position.store(plant.position.to_bits(), Relaxed);
            positions.push(plant.position.to_bits());
        }
        positions
    });
    let report = report.unwrap();
    assert_eq!(
        (report.end, report.clock),
        (End::Undriven, ClockKind::Driven)
    );
    assert_eq!(report.elapsed, Duration::from_secs(1));
    assert_eq!(report.loops["control"].cycles, 1000);
    assert_eq!(report.processes[0].exit, Some(luna::Exit::Cancelled));
    assert!(report.deadlock.is_none());
    positions
}

#[test]
fn a_plant_in_lock_step_is_controlled_the_same_each_time() {
    let _alive = watchdog();
    let positions = lock_step();
    let end = f64::from_bits(*positions.last().unwrap());
    assert!((end - 1.0).abs() < 0.01, "it settles: {end}");
    assert!(positions == lock_step());
}

#[test]
fn an_advance_serves_every_deadline_on_the_way_and_returns_at_rest() {
    let _alive = watchdog();
    let (system, main, mut driver) = driven();
    let seen = Arc::new(Mutex::new(Vec::new()));
    for (name, period) in [("three", 3), ("two", 2)] {
        let seen = seen.clone();
        let body = async move {
            let mut tick = luna::periodic(name, MS * period)?;
            loop {
                let cycle = tick.next().await;
                assert_eq!(
                    (luna::now(), cycle.lateness),
                    (cycle.deadline, Duration::ZERO)
                );
                seen.lock()
                    .unwrap()
                    .push((name, luna::now().as_nanos() / 1_000_000 - 1000));
            }
        };
        main.process(name).spawn_ok(body);
    }
    let noted = seen.clone();
    let (report, ()) = beside(&system, move || {
        let start = driver.now();
        assert_eq!(start, Instant::from_nanos(1_000_000_000));
        assert_eq!(driver.next_deadline(), Ok(Some(start + MS * 2)));
        driver.advance_to(start + MS).unwrap();
        assert_eq!((driver.now(), noted.lock().unwrap().len()), (start + MS, 0));
        driver.advance_by(MS * 5).unwrap();
        let expected = [
            ("two", 2),
            ("three", 3),
            ("two", 4),
            ("three", 6),
            ("two", 6),
        ];
        assert_eq!(*noted.lock().unwrap(), expected);
        let past = DriveError::Past {
            asked: start,
            now: start + MS * 6,
        };
        assert_eq!(driver.advance_to(start), Err(past));
        assert!(past.to_string().contains("does not go back"), "{past}");
        assert_eq!(driver.next_deadline(), Ok(Some(start + MS * 8)));
    });
    assert_eq!(report.unwrap().elapsed, MS * 6);
}

#[test]
fn what_the_simulator_sends_is_taken_at_the_present_instant() {
    let _alive = watchdog();
    let (system, main, mut driver) = driven();
    let (inputs, input) = luna::buffered::<u64>(luna::Buffer::fifo(4));
    let (outputs, output) = luna::buffered::<(u64, Instant)>(luna::Buffer::fifo(4));
    let body = async move {
        while let Ok(value) = input.recv().await {
            outputs.send((value * 2, luna::now())).await?;
        }
        Ok(())
    };
    main.process("doubles").spawn_ok(body);
    let (report, ()) = beside(&system, move || {
        for value in 0..100 {
            assert!(inputs.try_send(value).is_ok());
            driver.advance_by(Duration::ZERO).unwrap();
            assert_eq!(output.try_recv(), Ok((value * 2, driver.now())));
            driver.advance_by(MS).unwrap();
        }
        // All processes wait for the simulator, which is no deadlock. No process waits for the
        // time.
        assert_eq!(driver.next_deadline(), Ok(None));
        drop(inputs);
        // The process ends by that, and the system with it.
        let now = driver.now();
        assert_eq!(driver.advance_by(MS), Err(DriveError::Ended { now }));
    });
    let report = report.unwrap();
    assert_eq!((report.end, report.elapsed), (End::Completed, MS * 100));
    assert!(report.deadlock.is_none());
}

#[test]
fn the_driver_is_told_when_all_processes_have_ended() {
    let _alive = watchdog();
    for _ in 0..20 {
        let (system, main, mut driver) = driven();
        let body = async {
            luna::after(MS * 5).await;
            Ok(())
        };
        main.process("short").spawn_ok(body);
        let (report, ()) = beside(&system, move || {
            let start = driver.now();
            driver.advance_by(MS * 4).unwrap();
            let ended = DriveError::Ended {
                now: start + MS * 5,
            };
            assert_eq!(driver.advance_by(MS * 4), Err(ended));
            assert_eq!(driver.next_deadline(), Err(ended));
            assert!(ended.to_string().contains("has ended"), "{ended}");
        });
        assert_eq!(report.unwrap().end, End::Completed);
    }
}

#[test]
fn a_driver_that_goes_ends_the_system_in_good_order() {
    let _alive = watchdog();
    for _ in 0..20 {
        let (mut system, main, driver) = driven();
        let emergencies = Arc::new(AtomicU64::new(0));
        let counted = emergencies.clone();
        system.on_emergency("none", move || {
            counted.fetch_add(1, Relaxed);
        });
        let (began, has_begun) = mpsc::channel();
        let dropped = Arc::new(());
        let held = dropped.clone();
        let body = async move {
            let _held = held;
            began.send(()).unwrap();
            luna::after(MS).await;
            unreachable!("time does not move");
        };
        let body = async move {
            body.await;
            Ok(())
        };
        main.process("waits").spawn_ok(body);
        // Before it has begun or after.
        drop(driver);
        let report = system.run().unwrap();
        assert_eq!(
            (report.end, report.elapsed),
            (End::Undriven, Duration::ZERO)
        );
        assert!(
            has_begun.try_recv().is_ok(),
            "what can run at the first instant does"
        );
        assert_eq!(
            (Arc::strong_count(&dropped), emergencies.load(Relaxed)),
            (1, 0)
        );
        assert!(
            report
                .to_string()
                .contains("ended with the driver of its clock")
        );
    }
}

#[test]
fn an_error_of_a_process_is_that_of_the_run_also_if_the_driver_goes() {
    let _alive = watchdog();
    let (system, main, mut driver) = driven();
    let fails = async {
        luna::after(MS).await;
        Err(Error::other("no encoder"))
    };
    let waits = async {
        luna::after(MS * 9).await;
        Ok(())
    };
    main.process("waits").spawn_ok(waits);
    main.process("fails").spawn_ok(fails);
    let (report, ()) = beside(&system, move || driver.advance_by(MS * 2).unwrap());
    assert_eq!(
        report.unwrap_err().to_string(),
        "process `fails`: no encoder"
    );
    assert_eq!(system.report().unwrap().end, End::Undriven);
}

#[test]
fn a_driver_of_a_system_that_never_runs_is_told() {
    let _alive = watchdog();
    let (system, main, mut driver) = driven();
    let waiting = std::thread::spawn(move || driver.advance_by(MS));
    drop((system, main));
    assert!(matches!(
        waiting.join().unwrap(),
        Err(DriveError::Ended { .. })
    ));
    // A second clock: the first belongs to no system any more.
    let mut system = System::new("twice");
    let mut first = system.driven_clock();
    let second = system.driven_clock();
    assert!(matches!(
        first.advance_by(MS),
        Err(DriveError::Ended { .. })
    ));
    drop(second);
    assert!(system.run().is_ok());
    let mut late = system.driven_clock();
    assert!(matches!(late.advance_by(MS), Err(DriveError::Ended { .. })));
}

#[test]
fn a_driver_of_a_system_whose_start_fails_is_told() {
    let _alive = watchdog();
    let (mut system, _main, mut driver) = driven();
    system.stand_in("nobody", |_: u8| async { Ok(()) }).unwrap();
    let (report, outcome) = beside(&system, move || driver.advance_by(MS));
    assert!(report.unwrap_err().to_string().contains("nobody"));
    assert!(
        matches!(outcome, Err(DriveError::Ended { .. })),
        "{outcome:?}"
    );
    let again = system.run().unwrap_err().to_string();
    assert!(
        again.contains("run"),
        "as of every start that has failed: {again}"
    );
}

#[test]
fn an_advance_without_an_end_stays_at_the_last_deadline() {
    let _alive = watchdog();
    let (system, main, mut driver) = driven();
    let (go, gone) = luna::buffered::<()>(luna::Buffer::fifo(1));
    let body = async move {
        luna::after(MS).await;
        luna::after(MS * 2).await;
        gone.recv().await?;
        luna::after(MS * 4).await;
        std::future::pending().await
    };
    main.process("waits").spawn_ok(body);
    let (report, ()) = beside(&system, move || {
        let start = driver.now();
        driver.advance_to(Instant::NEVER).unwrap();
        assert_eq!(driver.now(), start + MS * 3);
        // A process that is woken later must wait for the driver.
        assert!(go.try_send(()).is_ok());
        driver.advance_by(Duration::ZERO).unwrap();
        assert_eq!(driver.now(), start + MS * 3);
        assert_eq!(driver.next_deadline(), Ok(Some(start + MS * 7)));
        driver.advance_by(MS).unwrap();
        assert_eq!(driver.now(), start + MS * 4);
        driver.advance_by(Duration::MAX).unwrap();
        assert_eq!(driver.now(), start + MS * 7);
        assert_eq!(driver.advance_by(Duration::MAX), Ok(()), "nobody waits");
        assert_eq!(driver.now(), start + MS * 7);
    });
    assert_eq!(report.unwrap().elapsed, MS * 7);
}

#[test]
fn a_panic_on_the_way_stops_time_and_tells_the_driver() {
    let _alive = watchdog();
    let (system, main, mut driver) = driven();
    let body = async {
        luna::after(MS * 3).await;
        panic!("on purpose");
    };
    main.process("panics").spawn_ok(body);
    let other = async {
        luna::after(MS * 100).await;
        Ok(())
    };
    main.process("other").spawn_ok(other);
    let (report, outcome) = beside(&system, move || driver.advance_by(MS * 50));
    assert!(matches!(report, Err(Error::Process { .. })), "{report:?}");
    assert_eq!(
        outcome,
        Err(DriveError::Ended {
            now: Instant::from_nanos(1_003_000_000)
        })
    );
    assert_eq!(system.report().unwrap().end, End::Panic);
}

#[test]
fn an_advance_waits_for_blocking_calls() {
    let _alive = watchdog();
    let (system, main, mut driver) = driven();
    let (release, released) = mpsc::channel::<()>();
    let done = Arc::new(AtomicU64::new(0));
    let kept = done.clone();
    let body = async move {
        luna::after(MS).await;
        let at = luna::blocking(move || {
            released.recv().unwrap();
            luna::now()
        });
        kept.store(at.await.as_nanos(), Relaxed);
        luna::after(MS).await;
        Ok(())
    };
    main.process("calls").spawn_ok(body);
    let (report, ()) = beside(&system, move || {
        let releasing = std::thread::spawn(move || release.send(()));
        assert!(driver.advance_by(MS * 2).is_err(), "the process has ended");
        assert_eq!(done.load(Relaxed), 1_001_000_000);
        releasing.join().unwrap().unwrap();
    });
    assert_eq!(report.unwrap().elapsed, MS * 2);
}
