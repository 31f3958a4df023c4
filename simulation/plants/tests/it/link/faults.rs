//! A plant that fails, in each way: the emergency functions run, the cause is reported, and no
//! value of it gets out any more.

use super::{MS, inputs_first, process, register, system};
use crate::spawn::SpawnOk;
use luna::{End, Error, TryRecvError};
use luna_plants::{Measured, Plant, PlantError, PlantFailure, PlantLink, Port, Side};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

/// What goes wrong, at the fourth step.
#[derive(Debug, Clone, Copy)]
enum Fault {
    Step,
    Apply,
    Measure,
    NotANumber,
    Infinite,
    OutOfRange,
    DoesNotFit,
    BadInput,
    InputOutOfRange,
}

const FAULTS: [Fault; 9] = [
    Fault::Step,
    Fault::Apply,
    Fault::Measure,
    Fault::NotANumber,
    Fault::Infinite,
    Fault::OutOfRange,
    Fault::DoesNotFit,
    Fault::BadInput,
    Fault::InputOutOfRange,
];

/// Counts its steps, and multiplies them by its input.
struct Counter {
    ports: [Port; 3],
    steps: u32,
    input: f64,
    fault: Fault,
}

impl Counter {
    fn new(fault: Fault) -> Self {
        Self {
            ports: [
                Port::new("factor", "1").range(0.0, 1.0),
                Port::new("steps", "1").range(0.0, 300.0),
                Port::new("half", "1"),
            ],
            steps: 0,
            input: 0.0,
            fault,
        }
    }

    fn fails_by(&self, fault: Fault) -> Result<(), PlantError> {
        if self.steps == 4 && self.fault as u8 == fault as u8 {
            return Err(PlantError::model("it is broken"));
        }
        Ok(())
    }
}

impl Plant for Counter {
    inputs_first!(1);

    fn apply(&mut self, inputs: &[f64]) -> Result<(), PlantError> {
        self.input = inputs[0];
        self.fails_by(Fault::Apply)
    }

    fn step(&mut self, _: Duration) -> Result<(), PlantError> {
        self.steps += 1;
        self.fails_by(Fault::Step)
    }

    fn measure(&mut self, outputs: &mut [f64]) -> Result<(), PlantError> {
        self.fails_by(Fault::Measure)?;
        outputs[0] = f64::from(self.steps.min(200)) * self.input.max(1.0);
        outputs[1] = 0.5;
        if self.steps == 4 {
            match self.fault {
                // The other output is valid, and is not sent either.
                Fault::NotANumber => outputs[1] = f64::NAN,
                Fault::Infinite => outputs[1] = f64::INFINITY,
                Fault::OutOfRange => outputs[0] = 300.5,
                Fault::DoesNotFit => outputs[0] = 290.0,
                _ => {}
            }
        }
        Ok(())
    }
}

fn expected(fault: Fault) -> PlantError {
    let not_finite = |side, port: &str, value| PlantError::NotFinite {
        side,
        port: port.into(),
        value,
    };
    match fault {
        Fault::Step | Fault::Apply | Fault::Measure => PlantError::model("it is broken"),
        Fault::NotANumber => not_finite(Side::Output, "half", f64::NAN),
        Fault::Infinite => not_finite(Side::Output, "half", f64::INFINITY),
        Fault::OutOfRange => PlantError::OutOfRange {
            side: Side::Output,
            port: Port::new("steps", "1").range(0.0, 300.0),
            value: 300.5,
        },
        Fault::DoesNotFit => PlantError::DoesNotFit {
            side: Side::Output,
            port: "steps".into(),
            value: 290.0,
            into: "u8",
        },
        Fault::BadInput => not_finite(Side::Input, "factor", f64::NAN),
        Fault::InputOutOfRange => PlantError::OutOfRange {
            side: Side::Input,
            port: Port::new("factor", "1").range(0.0, 1.0),
            value: 1.5,
        },
    }
}

#[test]
fn each_ends_in_the_emergency_and_no_value_gets_out() {
    for lock_step in [true, false] {
        for fault in FAULTS {
            let (mut system, main) = system("faults");
            let calls = Arc::new(AtomicU32::new(0));
            let counted = calls.clone();
            system.on_emergency("count", move || {
                counted.fetch_add(1, Ordering::Relaxed);
            });
            let (factor, factors) = register::<f64>();
            // In lock-step a reader that takes its time finds nothing left either.
            let (step, steps) = register::<u8>();
            let (half, halves) = register::<f64>();
            let mut link = PlantLink::new("counter", Counter::new(fault));
            link.actuator("factor", factors).unwrap();
            link.sensor("steps", step).unwrap();
            link.sensor("half", half).unwrap();
            main.process("plant")
                .priority(20)
                .spawn_ok(process(link, lock_step));
            main.process("control").priority(10).spawn_ok(async move {
                loop {
                    // All values are right, up to the last; then there is none, not even one
                    // that a register held.
                    let steps = match steps.recv().await {
                        Ok(steps) => steps,
                        Err(error) => {
                            assert!(error.is_poisoned(), "{error}");
                            assert!(halves.try_recv().unwrap_err().is_poisoned());
                            return Ok(());
                        }
                    };
                    // Faults of inputs come one exchange later, and by the clock perhaps some
                    // slots.
                    let of_input = matches!(
                        fault,
                        Fault::Apply | Fault::BadInput | Fault::InputOutOfRange
                    );
                    assert!(steps < 4 || of_input && (steps == 4 || !lock_step));
                    let value = match fault {
                        Fault::BadInput if steps >= 3 => f64::NAN,
                        Fault::InputOutOfRange if steps >= 3 => 1.5,
                        _ => 1.0,
                    };
                    match factor.send(value).await {
                        Ok(()) => {}
                        Err(error) => {
                            assert!(error.is_poisoned());
                            return Ok(());
                        }
                    }
                    let _ = halves.try_recv();
                }
            });
            let error = system.run().unwrap_err();
            let context = format!("{fault:?}, lock-step {lock_step}: {error}");
            let Error::Process { name, source } = &error else {
                panic!("{context}")
            };
            assert_eq!(name, "plant");
            let Error::Other(other) = &**source else {
                panic!("{context}")
            };
            let failure = other.get().downcast_ref::<PlantFailure>().expect(&context);
            assert_eq!(&*failure.plant, "counter");
            // By its text, since NaN is not equal to itself.
            assert_eq!(
                format!("{:?}", failure.error),
                format!("{:?}", expected(fault)),
                "{context}"
            );
            assert_eq!(system.report().unwrap().end, End::Emergency, "{context}");
            assert_eq!(calls.load(Ordering::Relaxed), 1, "{context}");
        }
    }
}

/// A value with a slow drop: it gives the functions of a raised emergency time to run.
struct Half;

/// Whether those of the test below have run.
static HAVE_RUN: AtomicBool = AtomicBool::new(false);

impl Measured for Half {
    const NAME: &str = "half";

    fn from_value(_: f64) -> Option<Self> {
        Some(Self)
    }
}

impl Drop for Half {
    fn drop(&mut self) {
        let end = luna::now() + 40 * MS;
        while !HAVE_RUN.load(Ordering::Acquire) && luna::now() < end {
            std::thread::yield_now();
        }
    }
}

#[test]
fn what_is_left_over_is_gone_before_the_emergency() {
    let (mut system, main) = system("left over");
    let (factor, factors) = register::<f64>();
    let (half, _halves) = register::<Half>();
    let (step, steps) = register::<u8>();
    let mut link = PlantLink::new("counter", Counter::new(Fault::Step));
    link.actuator("factor", factors).unwrap();
    // It is poisoned first, which drops the value that it still holds.
    link.sensor("half", half).unwrap();
    link.sensor("steps", step).unwrap();
    main.process("plant").spawn_ok(process(link, true));
    main.process("control").spawn_ok(async move {
        while factor.send(1.0).await.is_ok() {}
        Ok(())
    });
    let (result, results) = std::sync::mpsc::channel();
    system.on_emergency("look", move || {
        result.send(steps.try_recv()).unwrap();
        HAVE_RUN.store(true, Ordering::Release);
    });
    system.run().unwrap_err();
    assert_eq!(results.recv().unwrap(), Err(TryRecvError::Poisoned));
}

#[test]
fn one_that_fails_before_it_begins_delivers_nothing() {
    struct Dead {
        ports: [Port; 1],
    }

    impl Plant for Dead {
        inputs_first!(0);

        fn apply(&mut self, _: &[f64]) -> Result<(), PlantError> {
            Ok(())
        }

        fn step(&mut self, _: Duration) -> Result<(), PlantError> {
            Ok(())
        }

        fn measure(&mut self, _: &mut [f64]) -> Result<(), PlantError> {
            // Leaves its output as it was.
            Ok(())
        }
    }

    for lock_step in [true, false] {
        let (system, main) = system("dead");
        let (value, values) = luna::channel::<f64>();
        let mut link = PlantLink::new(
            "dead",
            Dead {
                ports: [Port::new("y", "1")],
            },
        );
        link.sensor("y", value).unwrap();
        main.process("plant").spawn_ok(process(link, lock_step));
        main.process("reader").spawn_ok(async move {
            assert!(values.recv().await.is_err());
            Ok(())
        });
        assert_eq!(
            system.run().unwrap_err().to_string(),
            "process `plant`: plant `dead` failed: output `y` is NaN"
        );
    }
}
