//! By the clock and in lock-step: the exchanges, their begin and their end.

use super::{MS, inputs_first, process, register, system};
use crate::spawn::SpawnOk;
use luna::prelude::*;
use luna_plants::{Checked, ConnectError, Motor, PAN, PanTilt, Plant, PlantError, PlantLink, Port};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Its outputs are the time that it was stepped, in seconds, and the sum of its two inputs.
struct Stopwatch {
    ports: [Port; 4],
    inputs: [f64; 2],
    time: Duration,
}

impl Stopwatch {
    fn new() -> Self {
        Self {
            ports: [
                Port::new("a", "1"),
                Port::new("b", "1").range(-5.0, 5.0),
                Port::new("time", "s"),
                Port::new("sum", "1"),
            ],
            inputs: [0.0; 2],
            time: Duration::ZERO,
        }
    }
}

impl Plant for Stopwatch {
    inputs_first!(2);

    fn apply(&mut self, inputs: &[f64]) -> Result<(), PlantError> {
        self.inputs.copy_from_slice(inputs);
        Ok(())
    }

    fn step(&mut self, time: Duration) -> Result<(), PlantError> {
        self.time += time;
        Ok(())
    }

    fn measure(&mut self, outputs: &mut [f64]) -> Result<(), PlantError> {
        outputs.copy_from_slice(&[self.time.as_secs_f64(), self.inputs[0] + self.inputs[1]]);
        Ok(())
    }
}

#[test]
fn a_periodic_plant_goes_by_its_slots_and_keeps_what_was_written_last() {
    let (system, main) = system("periodic");
    let (write, written) = register::<f64>();
    let (time, times) = register::<f64>();
    let (sum, sums) = register::<f64>();
    let mut link = PlantLink::new("stopwatch", Stopwatch::new());
    link.actuator("a", written).unwrap();
    link.hold("b", 2.0).unwrap();
    link.sensor("time", time).unwrap();
    link.sensor("sum", sum).unwrap();
    let (end, at_end) = std::sync::mpsc::channel();
    link.at_end(move |plant| end.send(plant.time).unwrap());
    main.process("plant").spawn_ok(process(link, false));
    main.process("control").spawn_ok(async move {
        // What it begins with.
        assert_eq!((times.recv().await?, sums.recv().await?), (0.0, 2.0));
        write.send(40.0).await?;
        let mut last = 0.0;
        let mut sum = 2.0;
        while last < 0.02 || sum != 42.0 {
            let now = times.recv().await?;
            assert!(now > last);
            // Missed slots are part of the time, so it is always whole periods.
            assert!((now * 1e3 - (now * 1e3).round()).abs() < 1e-9, "{now}");
            sum = sums.recv().await?;
            assert!(sum == 2.0 || sum == 42.0, "{sum}");
            last = now;
        }
        Ok(())
    });
    system.run().unwrap();
    // It has seen its writer gone, and ended.
    assert!(at_end.recv().unwrap() >= Duration::from_millis(20));
}

#[test]
fn slots_that_are_missed_before_the_first_one_are_part_of_the_time() {
    let (system, main) = system("late start");
    let (time, times) = register::<f64>();
    let mut link = PlantLink::new("stopwatch", Stopwatch::new());
    link.hold("a", 1.0).unwrap().hold("b", 2.0).unwrap();
    link.sensor("time", time).unwrap();
    main.process("plant").spawn_ok(process(link, false));
    main.process("hog").spawn_ok(async move {
        // The loop has been made, and waits for its first slot.
        assert_eq!(times.recv().await?, 0.0);
        let end = luna::now() + 10 * MS;
        while luna::now() < end {}
        // The current slot is served, so at most one period is not simulated yet.
        let simulated = times.recv().await?;
        assert!(simulated > 0.009 - 1e-9, "{simulated}");
        assert!((simulated * 1e3 - (simulated * 1e3).round()).abs() < 1e-9);
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn a_first_slot_that_comes_early_is_no_whole_period() {
    let period = 20 * MS;
    let mut system = System::new("common grid");
    system.timers(luna::time::Timers::Manager);
    let main = system.executor("main").build().unwrap();
    let (time, times) = register::<f64>();
    let mut link = PlantLink::new("stopwatch", Stopwatch::new());
    link.hold("a", 1.0).unwrap().hold("b", 2.0).unwrap();
    link.sensor("time", time).unwrap();
    let plant = link.periodic(period).unwrap();
    let own = main.clone();
    main.process("late").spawn_ok(async move {
        // Within a period that all share.
        let mut tick = luna::periodic("late", period)?;
        let slot = tick.next().await.deadline;
        while luna::now() < slot + period / 2 {}
        let before = luna::now();
        own.process("plant").spawn(plant)?;
        assert_eq!(times.recv().await?, 0.0);
        let mut last = 0.0;
        for _ in 0..3 {
            let simulated = times.recv().await?;
            let passed = (luna::now() - before).as_secs_f64();
            assert!(
                last < simulated && simulated <= passed + 1e-9,
                "{simulated}, {passed}"
            );
            last = simulated;
        }
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn in_lock_step_the_outcome_is_that_of_the_plant_alone() {
    let control = |count: i32, gain: f64| -gain * f64::from(count - 500) / 500.0;
    let cycles = 500;
    let mut alone = Checked::new(PanTilt::jiwy([0, 0]));
    let mut expected = [Vec::new(), Vec::new()];
    for _ in 0..cycles {
        let counts: Vec<i32> = alone
            .outputs()
            .unwrap()
            .iter()
            .map(|&count| count as i32)
            .collect();
        for axis in [0, 1] {
            expected[axis].push(counts[axis]);
            alone.set_input(axis, control(counts[axis], 0.4)).unwrap();
        }
        alone.step(MS).unwrap();
    }
    // Two independent controllers: on one executor, on two, beside the plant or not.
    for places in [[0, 0, 0], [0, 1, 2], [0, 0, 1], [1, 0, 1]] {
        let mut system = System::new("lock-step");
        let executors: Vec<_> = (0..3)
            .map(|n| system.executor(format!("executor {n}")).build().unwrap())
            .collect();
        let mut link = PlantLink::new("camera", PanTilt::jiwy([0, 0]));
        let seen: [Arc<Mutex<Vec<i32>>>; 2] = Default::default();
        for (axis, name) in ["pan", "tilt"].into_iter().enumerate() {
            let (duty, duties) = luna::channel::<f64>();
            let (count, counts) = luna::channel::<i32>();
            link.actuator(&format!("{name} duty"), duties).unwrap();
            link.sensor(&format!("{name} count"), count).unwrap();
            let seen = seen[axis].clone();
            executors[places[axis]].process(name).spawn_ok(async move {
                for _ in 0..cycles {
                    let count = counts.recv().await?;
                    seen.lock().unwrap().push(count);
                    duty.send(control(count, 0.4)).await?;
                }
                Ok(())
            });
        }
        executors[places[2]]
            .process("camera")
            .spawn_ok(process(link, true));
        system.run().unwrap();
        for axis in [0, 1] {
            assert_eq!(*seen[axis].lock().unwrap(), expected[axis], "{places:?}");
        }
    }
}

#[test]
fn the_order_of_reads_and_writes_does_not_matter() {
    let (system, main) = system("orders");
    let [(a, on_a), (b, on_b), (time, times), (sum, sums)] =
        std::array::from_fn(|_| luna::channel::<f64>());
    let mut link = PlantLink::new("stopwatch", Stopwatch::new());
    link.actuator("a", on_a).unwrap();
    link.actuator("b", on_b).unwrap();
    link.sensor("time", time).unwrap();
    link.sensor("sum", sum).unwrap();
    main.process("plant").spawn_ok(process(link, true));
    main.process("control").spawn_ok(async move {
        let mut last = 0.0;
        for n in 0..20 {
            let value = f64::from(n % 4);
            if n % 2 == 0 {
                b.send(1.0).await?;
                a.send(value).await?;
                assert_eq!(sums.recv().await?, last);
                times.recv().await?;
            } else {
                times.recv().await?;
                a.send(value).await?;
                assert_eq!(sums.recv().await?, last);
                b.send(1.0).await?;
            }
            last = value + 1.0;
        }
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn a_plant_of_sensors_alone_ends_with_its_readers() {
    for lock_step in [false, true] {
        let (system, main) = system("sensors");
        let (time, times) = register::<f64>();
        let (sum, sums) = register::<f64>();
        let mut link = PlantLink::new("stopwatch", Stopwatch::new());
        link.hold("a", 1.0).unwrap().hold("b", 2.0).unwrap();
        link.sensor("time", time).unwrap();
        link.sensor("sum", sum).unwrap();
        main.process("plant").spawn_ok(process(link, lock_step));
        main.process("reader").spawn_ok(async move {
            assert_eq!(sums.recv().await?, 3.0);
            drop(sums);
            while times.recv().await? < 0.003 {}
            Ok(())
        });
        system.run().unwrap();
    }
}

#[test]
fn the_enable_line_leaves_actuators_without_effect() {
    let (system, main) = system("cut");
    let (a, on_a) = luna::channel::<f64>();
    let (sum, sums) = luna::channel::<f64>();
    let mut link = PlantLink::new("stopwatch", Stopwatch::new());
    link.actuator("a", on_a).unwrap();
    link.hold("b", 2.0).unwrap();
    link.sensor("sum", sum).unwrap();
    let line = link.enable_line();
    main.process("plant").spawn_ok(process(link, true));
    main.process("control").spawn_ok(async move {
        let mut seen = Vec::new();
        for n in 0..4 {
            seen.push(sums.recv().await?);
            if n == 2 {
                line.cut();
            }
            a.send(7.0).await?;
        }
        assert_eq!(seen, [2.0, 9.0, 9.0, 2.0]);
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn wrong_connections_are_reported() {
    let (_, receiver) = luna::channel::<f64>();
    let (sender, _) = luna::channel::<f64>();
    let mut link = PlantLink::new("stopwatch", Stopwatch::new());
    let error =
        |result: Result<&mut PlantLink<Stopwatch>, ConnectError>| result.unwrap_err().to_string();
    assert_eq!(
        error(link.actuator("c", receiver.clone())),
        "plant `stopwatch` has no input `c`; it has `a`, `b`"
    );
    assert_eq!(
        error(link.sensor("a", sender)),
        "plant `stopwatch` has no output `a`; it has `time`, `sum`"
    );
    assert_eq!(
        error(link.hold("b", 6.0)),
        "plant `stopwatch`: input `b` is 6 1, outside of -5 to 5 1"
    );
    let mut link = PlantLink::new("stopwatch", Stopwatch::new());
    link.actuator("a", receiver.clone()).unwrap();
    assert_eq!(
        error(link.hold("a", 1.0)),
        "input `a` of plant `stopwatch` has an actuator already"
    );
    assert_eq!(
        link.periodic(MS).unwrap_err().to_string(),
        "plant `stopwatch` has inputs without an actuator: `b`; connect them, or give them a value with `hold`"
    );
    let mut link = PlantLink::new("pan", Motor::new(PAN));
    link.actuator("duty", receiver).unwrap();
    assert!(matches!(
        link.lock_step(Duration::ZERO),
        Err(ConnectError::ZeroStep { .. })
    ));
}
