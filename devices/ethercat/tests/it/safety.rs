//! What becomes of outputs at the end and in an emergency.

use crate::common::{self, DRIVE, SpawnOk, TERMINAL, register};
use luna::End;
use luna::devices::{DeviceState, OnLoss};
use luna::prelude::*;
use luna::report::FunctionOutcome;
use luna_ethercat::sim::{Network, Servo};
use luna_ethercat::{BusProcess, State};
use std::time::Duration;

/// A brake with the safe value on, and a drive that is to stop.
fn spawn(system: &mut System, network: &Network, then: fn() -> luna::Result<()>) {
    let mut link = common::open(system, network).unwrap();
    let (brake, brakes) = register::<bool>();
    let (control, controls) = register::<u16>();
    let (velocity, velocities) = register::<i32>();
    link.output_bit(TERMINAL, 3, true, brakes)
        .output(DRIVE, 0, 0x0004, controls)
        .output(DRIVE, 2, 0, velocities);
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(link.process().unwrap());
    let seen = network.clone();
    main.process("control").spawn_ok(async move {
        for cycle in 0..100 {
            brake.send(false).await?;
            control.send(Servo::ENABLED).await?;
            velocity.send(1000).await?;
            luna::after(Duration::from_millis(1)).await;
            if cycle == 99 {
                assert_eq!(seen.outputs(TERMINAL), [0, 0]);
                assert_eq!(seen.outputs(DRIVE)[..4], [8, 0, 0xe8, 3]);
            }
        }
        then()
    });
}

fn is_safe(network: &Network) {
    for position in [TERMINAL, DRIVE] {
        assert_eq!(network.state(position), State::SafeOp);
        assert!(network.outputs(position).iter().all(|byte| *byte == 0));
    }
    assert_eq!(network.written(TERMINAL), [0b1000, 0]);
    assert_eq!(network.written(DRIVE), [4, 0, 0, 0, 0, 0]);
}

#[test]
fn outputs_without_a_set_point_are_safe() {
    let network = common::machine();
    let mut system = common::system();
    let mut link = common::open(&system, &network).unwrap();
    let (brake, brakes) = register::<bool>();
    link.output_bit(TERMINAL, 3, true, brakes);
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(link.process().unwrap());
    let seen = network.clone();
    main.process("brake").spawn_ok(async move {
        // For longer than a set-point may be old.
        luna::after(Duration::from_millis(500)).await;
        assert_eq!(seen.outputs(TERMINAL), [0b1000, 0]);
        brake.send(false).await?;
        luna::after(Duration::from_millis(2)).await;
        assert_eq!(seen.outputs(TERMINAL), [0, 0]);
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn an_emergency_makes_the_outputs_safe() {
    let network = common::machine();
    let mut system = common::system();
    spawn(&mut system, &network, || {
        Err(luna::emergency(luna::Error::other("a test")))
    });
    let devices = system.devices();
    // Behind that of the bus; the link itself may still run.
    let (seen, looks) = std::sync::mpsc::channel();
    let look = network.clone();
    system.on_emergency("look", move || {
        let states = [TERMINAL, DRIVE].map(|it| (look.state(it), look.written(it)));
        seen.send(states).unwrap();
    });
    system.run().unwrap_err();
    let safe = [vec![0b1000, 0], vec![4, 0, 0, 0, 0, 0]].map(|it| (State::SafeOp, it));
    assert_eq!(looks.try_recv().unwrap(), safe);
    is_safe(&network);
    let safety = system.report().unwrap().safety;
    let [function, _] = &safety.functions[..] else {
        panic!("not two functions: {safety:?}");
    };
    assert_eq!(function.outcome, FunctionOutcome::Ran);
    assert!(
        function.name.ends_with(": outputs safe"),
        "{}",
        function.name
    );
    assert_eq!(devices.list()[0].state, DeviceState::Closed);
}

#[test]
fn the_end_of_the_writers_makes_the_outputs_safe() {
    let network = common::machine();
    let mut system = common::system();
    spawn(&mut system, &network, || Ok(()));
    system.run().unwrap();
    is_safe(&network);
    // The bus can be opened again, from SAFE-OP.
    let next = common::system();
    common::open(&next, &network).unwrap();
}

/// A link in SAFE-OP with a brake that is safe when on, and nothing written yet.
fn ready(system: &System, network: &Network) -> (BusProcess, Sender<bool>) {
    let mut link = common::open(system, network).unwrap();
    let (brake, brakes) = register::<bool>();
    link.output_bit(TERMINAL, 3, true, brakes);
    let process = link.process().unwrap();
    for position in [TERMINAL, DRIVE] {
        assert_eq!(network.state(position), State::SafeOp);
    }
    assert_eq!(network.written(TERMINAL), [0, 0]);
    (process, brake)
}

#[test]
fn a_handle_makes_the_outputs_safe_from_any_thread() {
    let network = common::machine();
    let system = common::system();
    let (process, _brake) = ready(&system, &network);
    let neutral = process.neutral();
    assert!(!neutral.is_engaged());
    let frames = network.frames();
    std::thread::spawn(move || neutral.engage()).join().unwrap();
    assert!(process.neutral().is_engaged());
    assert_eq!(network.written(TERMINAL), [0b1000, 0]);
    // One may be lost, or two.
    assert_eq!(network.frames() - frames, 3);
    drop(process);
    assert_eq!(network.frames() - frames, 3);
}

#[test]
fn a_link_that_never_runs_makes_the_outputs_safe() {
    let network = common::machine();
    let system = common::system();
    let (process, _brake) = ready(&system, &network);
    drop(process);
    assert_eq!(network.state(DRIVE), State::SafeOp);
    assert_eq!(network.written(TERMINAL), [0b1000, 0]);
}

#[test]
fn a_loss_is_what_was_chosen() {
    let network = common::machine();
    let mut system = common::system();
    let wire = luna_ethercat::Wire::simulated(&network);
    let expected = common::expected();
    let bus = luna_ethercat::open(&system.devices(), &wire, &expected).unwrap();
    bus.device().unwrap().on_loss(OnLoss::Fail);
    let mut link = bus.link("bus", common::PERIOD);
    let (_keep, lamps) = register::<bool>();
    link.output_bit(TERMINAL, 0, false, lamps);
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(link.process().unwrap());
    let faulty = network.clone();
    main.process("faulty").spawn_ok(async move {
        luna::after(Duration::from_millis(50)).await;
        faulty.fall(DRIVE, 1);
        Ok(())
    });
    assert!(matches!(
        common::fault(system.run()),
        luna_ethercat::Fault::Left { .. }
    ));
    assert_eq!(system.report().unwrap().end, End::Completed);
}

#[test]
fn a_program_that_is_gone_is_noticed_by_the_watchdog() {
    let network = common::machine();
    let mut system = common::system();
    let mut link = common::open(&system, &network).unwrap();
    let (lamp, lamps) = register::<bool>();
    // The link itself is to go on.
    link.greatest_age(None)
        .tolerate(1_000)
        .output_bit(TERMINAL, 0, false, lamps);
    let process = link.process().unwrap();
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    let seen = network.clone();
    let (ended, ends) = std::sync::mpsc::channel();
    main.process("lamp").spawn_ok(async move {
        lamp.send(true).await?;
        luna::after(Duration::from_millis(50)).await;
        assert_eq!(seen.outputs(TERMINAL), [1, 0]);
        // As if no frame came any more, those at its end included.
        seen.lose(u32::MAX);
        // A look lets the subdevices' time pass.
        luna::after(Duration::from_millis(9)).await;
        assert_eq!(seen.state(TERMINAL), State::Op);
        luna::after(Duration::from_millis(101)).await;
        assert_eq!(
            (seen.state(TERMINAL), seen.code(TERMINAL)),
            (State::SafeOp, 0x001b)
        );
        assert_eq!(seen.outputs(TERMINAL), [0, 0]);
        ended.send(()).unwrap();
        Ok(())
    });
    system.run().unwrap();
    ends.try_recv().unwrap();
}
