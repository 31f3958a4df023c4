//! Process data both ways.

use crate::common::{self, DRIVE, PERIOD, SpawnOk, TERMINAL, register};
use luna_ethercat::sim::{Identity, Network, Nothing, Servo, SubDevice};
use luna_ethercat::{Expected, Fault, Sample, State, Wire};

#[test]
fn values_go_both_ways() {
    let network = common::machine();
    network.set_inputs(TERMINAL, &[0b0000_0100]);
    let mut system = common::system();
    let mut link = common::open(&system, &network).unwrap();
    let (switch, switches) = register::<Sample<bool>>();
    let (position, positions) = register::<Sample<i32>>();
    let (status, statuses) = register::<Sample<u16>>();
    let (lamp, lamps) = register::<bool>();
    let (control, controls) = register::<u16>();
    let (velocity, velocities) = register::<i32>();
    link.input_bit(TERMINAL, 2, switch)
        .input(DRIVE, 2, position)
        .input(DRIVE, 0, status)
        .output_bit(TERMINAL, 9, false, lamps)
        .output(DRIVE, 0, 0, controls)
        .output(DRIVE, 2, 0, velocities);
    let process = link.process().unwrap();
    let health = process.health();
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    let seen = network.clone();
    main.process("control").spawn_ok(async move {
        for cycle in 0..200_i32 {
            let at = positions.recv().await?;
            assert_eq!((at.stale_cycles(), at.fresh()), (0, Some(at.held())));
            assert_eq!(switches.recv().await?.fresh(), Some(cycle < 100));
            if cycle == 99 {
                seen.set_inputs(TERMINAL, &[0]);
            }
            let is_enabled = statuses.recv().await?.held() & Servo::ENABLED != 0;
            assert!(is_enabled || cycle < 3, "in cycle {cycle}");
            control.send(Servo::ENABLED).await?;
            velocity.send(10_000).await?;
            lamp.send(cycle % 2 == 0).await?;
            if cycle == 151 {
                assert_eq!(seen.outputs(TERMINAL), [0, 2]);
                assert_eq!(seen.state(DRIVE), State::Op);
                let expected = 10_000.0 * f64::from(cycle) * PERIOD.as_secs_f64();
                let error = f64::from(at.held()) - expected;
                assert!(error.abs() < 100.0, "{error} counts");
            }
        }
        Ok(())
    });
    system.run().unwrap();
    assert_eq!(
        (health.missed(), health.miscounted(), health.dropped()),
        (0, 0, 0)
    );
    assert!(health.cycles() > 200);
    // The writers have gone: the outputs are safe.
    assert_eq!(network.state(TERMINAL), State::SafeOp);
    assert_eq!(network.written(TERMINAL), [0, 0]);
    assert_eq!(network.written(DRIVE), [0; 6]);
}

#[test]
fn a_system_file_gives_the_bus_another_period() {
    let network = common::machine();
    let mut system = common::system();
    common::period_from_file(&mut system, "2 ms");
    let mut link = common::open(&system, &network).unwrap();
    let (position, positions) = register::<Sample<i32>>();
    link.input(DRIVE, 2, position);
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(link.process().unwrap());
    main.process("control").spawn_ok(async move {
        let mut last = positions.recv().await?.exchanged_between()[0];
        for _ in 0..10 {
            let at = positions.recv().await?.exchanged_between()[0];
            assert_eq!(at - last, 2 * PERIOD);
            last = at;
        }
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn a_period_from_a_system_file_is_checked() {
    for (period, part) in [("200 ms", "the greatest age"), ("5 s", "at most 4 s")] {
        let network = common::machine();
        let mut system = common::system();
        common::period_from_file(&mut system, period);
        let mut link = common::open(&system, &network).unwrap();
        let (_keep, velocities) = register::<i32>();
        link.output(DRIVE, 2, 0, velocities);
        let main = system.executor("main").build().unwrap();
        main.process("bus").spawn_ok(link.process().unwrap());
        let fault = common::fault(system.run());
        assert!(matches!(fault, Fault::Setting { .. }), "{fault}");
        assert!(fault.to_string().contains(part), "{fault}");
    }
}

#[test]
fn states_that_find_no_room_come_in_a_second_frame() {
    let network = Network::on_virtual_time();
    let identity = Identity::default();
    // 1464 bytes, of which one frame has room for 1466 beside the clock.
    let outputs = [244; 48];
    let much = SubDevice::new("MUCH", identity, &outputs, &[], Nothing).with_clock(0.0);
    network.add(much);
    let mut system = common::system();
    let wire = Wire::simulated(&network);
    let expected = [Expected::new("much", 0, 0)];
    let bus = luna_ethercat::open(&system.devices(), &wire, &expected).unwrap();
    let mut link = bus.link("bus", PERIOD);
    let (last, lasts) = register::<u8>();
    link.output(0, 1_463, 0, lasts);
    let process = link.process().unwrap();
    let health = process.health();
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    main.process("control").spawn_ok(async move {
        luna::after(5 * PERIOD / 2).await;
        assert_eq!(network.state(0), State::Op);
        last.send(7).await?;
        let frames = network.frames();
        luna::after(10 * PERIOD).await;
        assert_eq!(network.frames() - frames, 20);
        assert_eq!(network.outputs(0)[1_463], 7);
        Ok(())
    });
    system.run().unwrap();
    assert_eq!((health.missed(), health.miscounted()), (0, 0));
}
