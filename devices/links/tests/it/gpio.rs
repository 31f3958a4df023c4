//! Pins: a simulated chip behind the trait, and the kernel's simulated chip where available.

#![cfg(feature = "gpio")]

use crate::common;
use common::{SpawnOk, run_to_loss, skip, watchdog, with_files};
use embedded_hal::digital::{InputPin, OutputPin, StatefulOutputPin};
use luna::Error;
use luna::devices::{Device, DeviceError, DeviceState, Holder};
use luna::prelude::*;
use luna::report::FunctionOutcome;
use luna_links::gpio::{self, Chip, Edge, Levels, Lines, Pin, Pins};
use luna_links::{OnBad, reader};
use std::io::{self, PipeReader, PipeWriter, Write};
use std::os::fd::OwnedFd;
use std::sync::{Arc, Mutex};

/// What was set, or why nothing can be.
type Record = Arc<Mutex<Vec<Levels>>>;

struct Simulated {
    set: Record,
    edges: PipeReader,
    is_broken: bool,
}

impl Chip for Simulated {
    fn set(&self, levels: Levels) -> io::Result<()> {
        if self.is_broken {
            return Err(io::Error::from_raw_os_error(19));
        }
        self.set.lock().unwrap().push(levels);
        Ok(())
    }

    fn get(&self, number: usize) -> io::Result<bool> {
        let set = self.set.lock().unwrap();
        Ok(set.iter().rev().find_map(|levels| levels.get(number)) == Some(true))
    }

    fn edges(&self) -> io::Result<OwnedFd> {
        Ok(self.edges.try_clone()?.into())
    }
}

/// Two outputs, the second of which is safe when high, and an input.
fn lines() -> Lines {
    Lines::new("test")
        .output(17, false)
        .output(27, true)
        .input(22)
}

fn simulated(system: &System, is_broken: bool) -> (Device<Pins>, Record, PipeWriter) {
    let (edges, far) = io::pipe().unwrap();
    let set = Record::default();
    let chip = Simulated {
        set: set.clone(),
        edges,
        is_broken,
    };
    let pins = gpio::open_chip(&system.devices(), "chip", &lines(), || Ok(chip)).unwrap();
    (pins, set, far)
}

const SAFE: Levels = Levels::NONE.with(0, false).with(1, true);

#[test]
fn after_an_emergency_the_outputs_do_not_change_any_more() {
    let _watch = watchdog();
    let mut system = System::new("press");
    let devices = system.devices();
    let (pins, set, _far) = simulated(&system, false);
    let (levels, receiver) = luna::channel();
    let main = system.executor("main").build().unwrap();
    let moving = Levels::NONE.with(0, true).with(1, false);
    let writer = gpio::writer(&pins, receiver);
    main.process("writer").spawn_ok(writer);
    let own = pins.clone();
    let seen = set.clone();
    main.process("control").spawn_ok(async move {
        levels.send(moving).await?;
        // Taken, and set with the next turn of the writer.
        while seen.lock().unwrap().is_empty() {
            luna::yield_now().await;
        }
        let cause = luna::emergency(Error::other("a test"));
        // The emergency thread has the highest priority; on any core, later sets fail.
        while seen.lock().unwrap().last() != Some(&SAFE) {
            luna::yield_now().await;
        }
        let refused = own.set(moving).unwrap_err();
        assert!(refused.to_string().contains("emergency"), "{refused}");
        Err(cause)
    });
    assert!(system.run().is_err());
    assert_eq!(*set.lock().unwrap(), [moving, SAFE]);
    drop(pins);
    // Closing sets them once more.
    assert_eq!(*set.lock().unwrap(), [moving, SAFE, SAFE]);
    assert_eq!(devices.list()[0].state, DeviceState::Closed);
}

#[test]
fn a_chip_that_has_gone_is_lost() {
    let _watch = watchdog();
    let mut system = System::new("gone");
    let devices = system.devices();
    let (pins, _set, _far) = simulated(&system, true);
    let (levels, receiver) = luna::channel();
    let main = system.executor("main").build().unwrap();
    let writer = gpio::writer(&pins, receiver);
    main.process("writer").spawn_ok(writer);
    main.process("control").spawn_ok(async move {
        levels.send(Levels::NONE.with(0, true)).await?;
        std::future::pending::<()>().await;
        Ok(())
    });
    drop(pins);
    let error = run_to_loss(&system, &devices);
    assert!(error.contains("the GPIO chip `chip` is lost"), "{error}");
    // Its outputs are unchanged, and the report agrees.
    let safety = system.report().unwrap().safety;
    assert_eq!(safety.functions[0].outcome, FunctionOutcome::Panicked);
    assert_eq!(safety.failed().count(), 1);
}

#[test]
fn edges_come_as_values() {
    let Some(_watch) = with_files() else { return };
    let mut system = System::new("buttons");
    let (pins, _set, mut far) = simulated(&system, false);
    let (sender, edges) = luna::channel::<Edge>();
    let input = reader(&pins, sender, gpio::FRAMING)
        .unwrap()
        .on_bad(OnBad::Drop);
    let counts = input.counts();
    let main = system.executor("main").build().unwrap();
    main.process("edges").spawn_ok(input);
    main.process("user").spawn_ok(async move {
        for number in 1..=3 {
            let edge = edges.recv().await?;
            assert_eq!((edge.offset, edge.number), (22, number));
            assert_eq!(edge.rising, number % 2 == 1);
        }
        Ok(())
    });
    drop(pins);
    let mut bytes = Vec::new();
    for (kind, number) in [(1_u32, 1_u32), (9, 0), (2, 2), (1, 3)] {
        let mut event = [0; 48];
        event[8..12].copy_from_slice(&kind.to_ne_bytes());
        event[12..16].copy_from_slice(&22_u32.to_ne_bytes());
        event[16..20].copy_from_slice(&number.to_ne_bytes());
        bytes.extend(event);
    }
    far.write_all(&bytes).unwrap();
    system.run().unwrap();
    assert_eq!((counts.records(), counts.bad()), (3, 1));
}

#[test]
fn a_line_is_a_pin_of_embedded_hal() {
    let system = System::new("pins");
    let (pins, set, _far) = simulated(&system, false);
    let mut output = Pin::new(&pins, 0).unwrap();
    output.set_high().unwrap();
    assert!(output.is_set_high().unwrap());
    output.set_low().unwrap();
    assert!(output.is_set_low().unwrap());
    let mut input = Pin::new(&pins, 2).unwrap();
    assert!(input.is_low().unwrap());
    assert!(input.set_high().is_err(), "it is an input");
    assert!(Pin::new(&pins, 3).is_none());
    assert_eq!(
        *set.lock().unwrap(),
        [Levels::NONE.with(0, true), Levels::NONE.with(0, false)]
    );
}

#[test]
fn lines_that_make_no_sense_are_refused_and_open_nothing() {
    let system = System::new("lines");
    let devices = system.devices();
    let none = Lines::new("none");
    let twice = Lines::new("twice").input(3).output(3, false);
    let many = (0..65).fold(Lines::new("many"), |lines, offset| lines.input(offset));
    for lines in [none, twice, many] {
        let opened = gpio::open_chip(&devices, "chip", &lines, || -> Result<Simulated, _> {
            panic!("{lines:?} must not be requested")
        });
        assert!(matches!(
            opened,
            Err(Error::Device(error)) if matches!(*error, DeviceError::Settings { .. })
        ));
    }
    assert_eq!(devices.list(), []);
}

/// The chip of the module `gpio-sim`, in the folder that LUNA_GPIO_SIM names, with the lines 0 and
/// 1.
#[test]
fn a_chip_of_the_kernel() {
    let _watch = watchdog();
    let Ok(folder) = std::env::var("LUNA_GPIO_SIM") else {
        return skip(
            "no simulated chip: load gpio-sim, make one of 4 lines in configfs, and set LUNA_GPIO_SIM to its folder in /sys/devices/platform and \
             LUNA_GPIO_CHIP to its file",
        );
    };
    let chip = std::env::var("LUNA_GPIO_CHIP").unwrap();
    let mut system = System::new("kernel");
    let devices = system.devices();
    let lines = Lines::new("luna-test").output(0, true).input(1);
    let pins = gpio::open(&devices, &chip, &lines).unwrap();
    let of_output = format!("{folder}/sim_gpio0/value");
    let value = || std::fs::read_to_string(&of_output).unwrap();
    assert_eq!(value().trim(), "1");
    let again = gpio::open(
        &System::new("other").devices(),
        &chip,
        &Lines::new("x").input(1),
    );
    assert!(matches!(
        again,
        Err(Error::Device(error)) if matches!(&*error, DeviceError::Busy { by: Holder::Named { name }, .. } if name == "luna-test")
    ));
    let (sender, edges) = luna::channel::<Edge>();
    let main = system.executor("main").build().unwrap();
    let input = reader(&pins, sender, gpio::FRAMING).unwrap();
    main.process("edges").spawn_ok(input);
    main.process("user").spawn_ok(async move {
        pins.set(Levels::NONE.with(0, false))?;
        for rising in [true, false] {
            let pull = if rising { "pull-up" } else { "pull-down" };
            std::fs::write(format!("{folder}/sim_gpio1/pull"), pull)?;
            let edge = edges.recv().await?;
            assert_eq!((edge.offset, edge.rising), (1, rising));
        }
        Ok(())
    });
    system.run().unwrap();
    assert_eq!(value().trim(), "1", "closing sets what is safe");
}
