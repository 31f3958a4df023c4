//! Faults of a bus while it runs.

use crate::common::{self, DRIVE, SpawnOk, TERMINAL, register};
use luna::TryRecvError;
use luna::prelude::*;
use luna_ethercat::sim::Network;
use luna_ethercat::{Fault, Health, Place, Sample, State};
use std::sync::Arc;
use std::time::Duration;

/// A bus with a lamp that is to burn, with the safe value off, and a drive that is watched.
struct Run {
    system: System,
    network: Network,
    health: Arc<Health>,
    position: Receiver<Sample<i32>>,
    lamp: Sender<bool>,
}

fn run() -> Run {
    let network = common::machine();
    let system = common::system();
    let mut link = common::open(&system, &network).unwrap();
    let (samples, position) = register();
    let (lamp, lamps) = register();
    link.input(DRIVE, 2, samples)
        .output_bit(TERMINAL, 0, false, lamps);
    let process = link.process().unwrap();
    let health = process.health();
    let mut run = Run {
        system,
        network,
        health,
        position,
        lamp,
    };
    let main = run.system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    run
}

impl Run {
    /// Runs with a controller that gets each sample with its number, and keeps the lamp burning.
    fn go(
        self,
        mut each: impl FnMut(u32, Sample<i32>) + Send + 'static,
    ) -> luna::Result<luna::Report> {
        let Self {
            mut system,
            position,
            lamp,
            ..
        } = self;
        let main = system.executor("control").build().unwrap();
        main.process("control").spawn_ok(async move {
            for number in 0..200 {
                let sample = position.recv().await?;
                each(number, sample);
                lamp.send(true).await?;
            }
            Ok(())
        });
        system.run()
    }
}

fn is_safe(network: &Network) {
    assert_eq!(network.state(TERMINAL), State::SafeOp);
    assert_eq!(
        (network.written(TERMINAL), network.outputs(TERMINAL)),
        (vec![0; 2], vec![0; 2])
    );
}

#[test]
fn lost_frames_are_counted_and_shown() {
    let run = run();
    let (network, health) = (run.network.clone(), run.health.clone());
    let lossy = network.clone();
    run.go(move |number, sample| {
        if number == 50 {
            lossy.lose(3);
        }
        let expected = if (51..54).contains(&number) {
            number - 50
        } else {
            0
        };
        assert_eq!(sample.stale_cycles(), expected, "in {number}");
        assert_eq!(sample.fresh().is_none(), expected > 0);
    })
    .unwrap();
    assert_eq!(
        (
            health.missed(),
            health.longest_silence(),
            health.miscounted()
        ),
        (3, 3, 0)
    );
    is_safe(&network);
}

#[test]
fn too_many_lost_frames_end_the_link() {
    let run = run();
    let (network, health) = (run.network.clone(), run.health.clone());
    let lossy = network.clone();
    // Those that make it safe come through.
    let outcome = run.go(move |number, _| {
        if number == 50 {
            lossy.lose(11);
        }
    });
    let fault = common::fault(outcome);
    assert_eq!(
        fault,
        Fault::TooManyErrors {
            in_a_row: 11,
            missed: 11,
            miscounted: 0,
            counter: None,
            expected: 6,
            silent: None
        }
    );
    assert_eq!(health.missed(), 11);
    is_safe(&network);
}

#[test]
fn every_third_frame_lost_ends_the_link() {
    let run = run();
    let (network, health) = (run.network.clone(), run.health.clone());
    let lossy = network.clone();
    let outcome = run.go(move |number, _| {
        if number == 50 {
            lossy.lose_one_in(Some(3));
        }
    });
    let fault = common::fault(outcome);
    assert_eq!(
        fault,
        Fault::TooManyErrors {
            in_a_row: 1,
            missed: 13,
            miscounted: 0,
            counter: None,
            expected: 6,
            silent: None
        }
    );
    // Each weighs as ten good ones: 10 - 2 a loss, until 100 is passed.
    assert_eq!(health.missed(), 13);
    // One of the three frames that make it safe is lost too.
    is_safe(&network);
}

#[test]
fn an_answer_that_comes_too_late_is_not_used() {
    let run = run();
    let (network, health) = (run.network.clone(), run.health.clone());
    let slow = network.clone();
    run.go(move |number, sample| {
        match number {
            // Longer than the link waits, and shorter than a period.
            50 => slow.set_latency(Duration::from_micros(900)),
            54 => slow.set_latency(Duration::ZERO),
            _ => {}
        }
        let expected = if (51..55).contains(&number) {
            number - 50
        } else {
            0
        };
        assert_eq!(sample.stale_cycles(), expected, "in {number}");
    })
    .unwrap();
    assert_eq!((health.missed(), health.dropped()), (4, 4));
    is_safe(&network);
}

#[test]
fn a_wrong_working_counter_is_counted_and_its_data_not_used() {
    let run = run();
    let (network, health) = (run.network.clone(), run.health.clone());
    let faulty = network.clone();
    let mut last = None;
    run.go(move |number, sample| {
        if number == 50 {
            faulty.miscount(2);
        }
        let is_stale = (51..53).contains(&number);
        assert_eq!(sample.stale_cycles() > 0, is_stale, "in {number}");
        // A value keeps the time of its exchange.
        let is_same = last.replace(sample.exchanged_between()) == Some(sample.exchanged_between());
        assert_eq!(is_same, is_stale, "in {number}");
    })
    .unwrap();
    assert_eq!((health.missed(), health.miscounted()), (0, 2));
    is_safe(&network);
}

#[test]
fn a_subdevice_that_leaves_op_ends_the_link_at_once() {
    let run = run();
    let (network, health) = (run.network.clone(), run.health.clone());
    let faulty = network.clone();
    let outcome = run.go(move |number, _| {
        if number == 50 {
            faulty.fall(DRIVE, 0x001b);
        }
        assert!(number <= 50, "an old value is sent");
    });
    let fault = common::fault(outcome);
    let expected = Fault::Left {
        position: DRIVE,
        state: State::SafeOp,
        code: Some(0x001b),
    };
    assert_eq!(fault, expected);
    let text = fault.to_string();
    assert!(
        text.contains("position 1 has left OP: it is in SAFE-OP"),
        "{text}"
    );
    assert_eq!(health.miscounted(), 0);
    is_safe(&network);
}

#[test]
fn channels_are_poisoned_before_the_emergency() {
    let Run {
        mut system,
        network,
        position,
        lamp,
        ..
    } = run();
    let received = position.clone();
    let (seen, looks) = std::sync::mpsc::channel();
    system.on_emergency("look", move || {
        let received = position.try_recv().unwrap_err();
        let sent = lamp.try_send(true).unwrap_err();
        seen.send((received, sent.is_poisoned())).unwrap();
    });
    let main = system.executor("control").build().unwrap();
    main.process("control").spawn_ok(async move {
        received.recv().await?;
        network.fall(DRIVE, 1);
        while received.recv().await.is_ok() {}
        Ok(())
    });
    let fault = common::fault(system.run());
    assert!(matches!(fault, Fault::Left { .. }), "{fault}");
    assert_eq!(looks.try_recv().unwrap(), (TryRecvError::Poisoned, true));
}

#[test]
fn a_cable_that_is_cut_names_the_subdevice_behind_it() {
    let run = run();
    let network = run.network.clone();
    let faulty = network.clone();
    let outcome = run.go(move |number, sample| {
        if number == 50 {
            faulty.cut(DRIVE);
        }
        assert_eq!(sample.fresh().is_some(), number <= 50);
    });
    let fault = common::fault(outcome);
    let expected = Fault::TooManyErrors {
        in_a_row: 11,
        missed: 0,
        miscounted: 11,
        counter: Some(3),
        expected: 6,
        silent: Some(DRIVE),
    };
    assert_eq!(fault, expected);
    let text = fault.to_string();
    assert!(
        text.contains("subdevice at position 1 did not answer"),
        "{text}"
    );
    is_safe(&network);
    // The drive got no frame that makes it safe: its watchdog has to.
    assert_eq!(network.state(DRIVE), State::Op);
}

#[test]
fn failures_are_counted_by_their_cause() {
    let run = run();
    let faulty = run.network.clone();
    let outcome = run.go(move |number, _| match number {
        50 => faulty.lose(3),
        60 => faulty.miscount(20),
        _ => {}
    });
    let fault = common::fault(outcome);
    // Of the 30 that the lost ones weigh, the good ones between have taken 6.
    let expected = Fault::TooManyErrors {
        in_a_row: 8,
        missed: 3,
        miscounted: 8,
        counter: Some(5),
        expected: 6,
        silent: None,
    };
    assert_eq!(fault, expected);
    let text = fault.to_string();
    assert!(text.contains("one took no part in process data"), "{text}");
}

#[test]
fn failures_that_are_outweighed_are_not_counted() {
    let run = run();
    let faulty = run.network.clone();
    let outcome = run.go(move |number, _| match number {
        50 => faulty.lose(3),
        100 => faulty.miscount(20),
        _ => {}
    });
    let fault = common::fault(outcome);
    assert!(
        matches!(
            fault,
            Fault::TooManyErrors {
                missed: 0,
                miscounted: 11,
                ..
            }
        ),
        "{fault}"
    );
}

#[test]
fn a_cable_that_is_mended_in_time_is_no_fault() {
    let run = run();
    let (network, health) = (run.network.clone(), run.health.clone());
    let faulty = network.clone();
    run.go(move |number, _| match number {
        50 => faulty.cut(DRIVE),
        55 => faulty.mend(),
        _ => {}
    })
    .unwrap();
    assert_eq!(health.miscounted(), 5);
    is_safe(&network);
}

#[test]
fn a_writer_that_hangs_ends_the_link() {
    let network = common::machine();
    let mut system = common::system();
    let mut link = common::open(&system, &network).unwrap();
    let (velocity, velocities) = register::<i32>();
    link.greatest_age(Some(Duration::from_millis(20)))
        .output(DRIVE, 2, 0, velocities);
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(link.process().unwrap());
    let seen = network.clone();
    main.process("hangs").spawn_ok(async move {
        velocity.send(1000).await?;
        luna::after(Duration::from_millis(15)).await;
        assert_eq!(seen.outputs(DRIVE)[2..], 1000_i32.to_le_bytes());
        luna::after(Duration::from_secs(10)).await;
        Ok(())
    });
    let fault = common::fault(system.run());
    let place = Place {
        position: DRIVE,
        is_output: true,
        bit: 16,
        bits: 32,
    };
    assert_eq!(fault, Fault::Overdue { place, cycles: 21 });
    assert_eq!(network.written(DRIVE), [0; 6]);
}
