//! A loop that follows the distributed clock of a bus.

use crate::common::{self, PERIOD, SpawnOk, register};
use luna::time::FollowState;
use luna_ethercat::sim::{Network, SubDevice};
use luna_ethercat::{Expected, Fault, Sample, Wire};
use std::time::Duration;

/// Where in the period of SYNC0 frames are to come.
const PHASE: Duration = Duration::from_micros(400);
/// Cycles from OP until the phase has settled.
const SETTLED: u32 = 100;
/// By how much the phase may be wrong then, whatever the drift (ns).
const BOUND: u64 = 200;
/// How long a frame takes from one subdevice to the next.
const HOP: Duration = Duration::from_nanos(500);

/// Runs a bus with a reference clock that is fast by `drift` (ppm), and another that is fast by
/// 30 ppm. Returns the greatest phase error of frames once settled (ns), and the learned rate.
fn greatest_error(drift: f64, latency: Duration) -> (u64, f64) {
    let network = Network::on_virtual_time();
    network.add(SubDevice::digital(8, 8).with_clock(drift));
    let drive = network.add(SubDevice::servo().with_clock(30.0));
    network.set_latency(latency);
    let expected = [
        Expected::new("terminal", SubDevice::VENDOR, SubDevice::DIGITAL).sync0(),
        Expected::new("drive", SubDevice::VENDOR, SubDevice::SERVO).sync0(),
    ];
    let mut system = common::system();
    let wire = Wire::simulated(&network);
    let bus = luna_ethercat::open(&system.devices(), &wire, &expected).unwrap();
    let mut link = bus.link("bus", PERIOD);
    let (position, positions) = register::<Sample<i32>>();
    link.follow_clock(PHASE).input(drive, 2, position);
    let process = link.process().unwrap();
    let health = process.health();
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    let (result, results) = luna::buffered(luna::Buffer::fifo(1));
    main.process("control").spawn_ok(async move {
        let mut greatest = 0;
        for cycle in 0..1_000 {
            positions.recv().await?;
            // What the subdevices measure of the frames that they got.
            let wanted = PHASE + latency / 2;
            for (position, wanted) in [(0, wanted), (drive, wanted + HOP)] {
                let phase = network.sync_phase(position).unwrap();
                let error = phase.abs_diff(wanted.as_nanos() as u64);
                if cycle >= SETTLED {
                    greatest = greatest.max(error);
                }
            }
        }
        assert_eq!(health.clock(), FollowState::Locked);
        assert!(health.phase_error().unsigned_abs() < BOUND);
        result.send((greatest, health.rate_ppm())).await?;
        Ok(())
    });
    system.run().unwrap();
    results.try_recv().unwrap()
}

#[test]
fn the_phase_converges_and_stays_within_its_bound() {
    for drift in [-100.0, -20.0, 0.0, 20.0, 100.0] {
        let (greatest, rate) = greatest_error(drift, Duration::ZERO);
        println!("{drift} ppm: {greatest} ns at most, learned {rate} ppm");
        assert!(greatest <= BOUND, "{greatest} ns at {drift} ppm");
        // A fast clock has a shorter period.
        assert!((rate + drift).abs() < 1.0, "{rate} ppm at {drift} ppm");
    }
}

#[test]
fn frames_that_are_long_under_way_shift_nothing() {
    for drift in [-100.0, 100.0] {
        let (greatest, _) = greatest_error(drift, Duration::from_micros(60));
        assert!(greatest <= BOUND, "{greatest} ns at {drift} ppm");
    }
}

#[test]
fn each_run_has_the_same_outcome() {
    let run = || greatest_error(100.0, Duration::from_micros(10));
    assert_eq!(run(), run());
}

#[test]
fn a_clock_that_is_too_wrong_is_not_followed() {
    let network = Network::on_virtual_time();
    // Two per cent: the loop is moved by one at most.
    network.add(SubDevice::servo().with_clock(20_000.0));
    let mut system = common::system();
    let expected = [Expected::new("drive", SubDevice::VENDOR, SubDevice::SERVO)];
    let wire = Wire::simulated(&network);
    let bus = luna_ethercat::open(&system.devices(), &wire, &expected).unwrap();
    let mut link = bus.link("bus", PERIOD);
    link.follow_clock(PHASE)
        .start_within(Duration::from_millis(500));
    let (_keep, velocities) = register::<i32>();
    link.output(0, 2, 0, velocities);
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(link.process().unwrap());
    let fault = common::fault(system.run());
    let is_measured = matches!(
        fault,
        Fault::NotLocked {
            phase_error: Some(_),
            refused: 0,
            ..
        }
    );
    assert!(is_measured, "{fault}");
}

#[test]
fn a_clock_whose_frames_are_too_long_under_way_is_not_followed() {
    let network = Network::on_virtual_time();
    network.add(SubDevice::servo().with_clock(0.0));
    let mut system = common::system();
    let expected = [Expected::new("drive", SubDevice::VENDOR, SubDevice::SERVO)];
    let wire = Wire::simulated(&network);
    let bus = luna_ethercat::open(&system.devices(), &wire, &expected).unwrap();
    let mut link = bus.link("bus", PERIOD);
    link.follow_clock(PHASE)
        .start_within(Duration::from_millis(500));
    let (_keep, velocities) = register::<i32>();
    link.output(0, 2, 0, velocities);
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(link.process().unwrap());
    network.set_latency(PERIOD / 2);
    let fault = common::fault(system.run());
    let Fault::NotLocked {
        phase_error: None,
        refused,
        ..
    } = fault
    else {
        panic!("{fault}");
    };
    assert!(refused > 400, "{refused}");
}

#[test]
fn a_loop_goes_on_while_frames_are_lost() {
    let network = Network::on_virtual_time();
    let drive = network.add(SubDevice::servo().with_clock(-80.0));
    let mut system = common::system();
    let expected = [Expected::new("drive", SubDevice::VENDOR, SubDevice::SERVO).sync0()];
    let wire = Wire::simulated(&network);
    let bus = luna_ethercat::open(&system.devices(), &wire, &expected).unwrap();
    let mut link = bus.link("bus", PERIOD);
    let (position, positions) = register::<Sample<i32>>();
    link.follow_clock(PHASE)
        .tolerate(50)
        .input(drive, 2, position);
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(link.process().unwrap());
    main.process("control").spawn_ok(async move {
        for cycle in 0..600 {
            positions.recv().await?;
            if cycle == 400 {
                network.lose(8);
            }
            if cycle > 408 {
                let phase = network.sync_phase(drive).unwrap();
                let error = phase.abs_diff(PHASE.as_nanos() as u64);
                assert!(error <= BOUND, "{error} ns in {cycle}");
            }
        }
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn frames_that_did_not_reach_the_clock_are_not_followed() {
    let network = Network::on_virtual_time();
    network.add(SubDevice::digital(8, 8));
    let drive = network.add(SubDevice::servo().with_clock(-80.0));
    let mut system = common::system();
    let wire = Wire::simulated(&network);
    let [terminal, servo] = common::expected();
    let expected = [terminal, servo.sync0()];
    let bus = luna_ethercat::open(&system.devices(), &wire, &expected).unwrap();
    let mut link = bus.link("bus", PERIOD);
    let (position, positions) = register::<Sample<i32>>();
    link.follow_clock(PHASE)
        .tolerate(50)
        .input(drive, 2, position);
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(link.process().unwrap());
    main.process("control").spawn_ok(async move {
        for cycle in 0..600 {
            positions.recv().await?;
            match cycle {
                400 => network.cut(drive),
                410 => network.mend(),
                _ => {}
            }
            if cycle > 410 {
                let phase = network.sync_phase(drive).unwrap();
                let error = phase.abs_diff(PHASE.as_nanos() as u64);
                assert!(error <= BOUND, "{error} ns in {cycle}");
            }
        }
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn clocks_are_kept_together_where_the_loop_follows_none() {
    let network = Network::on_virtual_time();
    network.add(SubDevice::digital(8, 8).with_clock(-100.0));
    let drive = network.add(SubDevice::servo().with_clock(100.0));
    let mut system = common::system();
    let wire = Wire::simulated(&network);
    let bus = luna_ethercat::open(&system.devices(), &wire, &common::expected()).unwrap();
    let mut link = bus.link("bus", PERIOD);
    let (position, positions) = register::<Sample<i32>>();
    link.input(drive, 2, position);
    let process = link.process().unwrap();
    let health = process.health();
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    main.process("control").spawn_ok(async move {
        for cycle in 0..1_000 {
            positions.recv().await?;
            let [reference, own] = [0, drive].map(|it| network.system_time(it).unwrap());
            // They drift 200 ns apart in a cycle, and half of the difference is taken away. Until
            // the first cycles they had drifted for longer.
            let difference = own.abs_diff(reference);
            assert!(difference < 250 || cycle < 20, "{difference} ns in {cycle}");
        }
        assert_eq!(health.clock(), FollowState::Acquiring);
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn pulses_have_the_period_of_the_program() {
    let network = Network::on_virtual_time();
    network.add(SubDevice::servo().with_clock(0.0));
    let mut system = common::system();
    common::period_from_file(&mut system, "2 ms");
    let expected = [Expected::new("drive", SubDevice::VENDOR, SubDevice::SERVO).sync0()];
    let wire = Wire::simulated(&network);
    let bus = luna_ethercat::open(&system.devices(), &wire, &expected).unwrap();
    let mut link = bus.link("bus", PERIOD);
    link.follow_clock(PHASE);
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(link.process().unwrap());
    let expected = Fault::Period {
        configured: PERIOD,
        given: 2 * PERIOD,
    };
    assert_eq!(common::fault(system.run()), expected);
}

#[test]
fn pulses_of_a_long_period_begin() {
    // A multiple of it is long over, or far away, when they are configured.
    for period in [Duration::from_millis(1_500), Duration::from_secs(4)] {
        let network = Network::on_virtual_time();
        let watchdog = Duration::ZERO;
        let servo = SubDevice::servo().with_clock(0.0).with_watchdog(watchdog);
        let drive = network.add(servo);
        let mut system = common::system();
        let expected = [Expected::new("drive", SubDevice::VENDOR, SubDevice::SERVO).sync0()];
        let wire = Wire::simulated(&network);
        let bus = luna_ethercat::open(&system.devices(), &wire, &expected).unwrap();
        let mut link = bus.link("bus", period);
        let (position, positions) = register::<Sample<i32>>();
        link.follow_clock(PHASE)
            .start_within(Duration::from_secs(10_000))
            .input(drive, 2, position);
        let main = system.executor("main").build().unwrap();
        main.process("bus").spawn_ok(link.process().unwrap());
        main.process("control").spawn_ok(async move {
            positions.recv().await?;
            assert!(network.sync_phase(drive).is_some());
            Ok(())
        });
        system.run().unwrap();
    }
}
