//! FMUs of both versions, built here from C: they behave as their model, and each fault is reported
//! by name.

mod build;
mod given;
mod reference;

use crate::spawn::SpawnOk;
use build::{Odd, fmu};
use luna::End;
use luna::prelude::*;
use luna_plants::fmu::{Fmu, FmuError, FmuFault, FmuPlant, FmuStatus, Version};
use luna_plants::{Checked, FirstOrderLag, Plant, PlantError, PlantFailure, PlantLink, Port, Side};
use std::time::Duration;

const VERSIONS: [Version; 2] = [Version::Two, Version::Three];
const MS: Duration = Duration::from_millis(1);

pub(crate) fn open(version: Version) -> Fmu {
    Fmu::open(fmu(version, Odd::default())).unwrap()
}

pub(crate) fn odd(version: Version, odd: Odd) -> Result<FmuPlant, FmuError> {
    Fmu::open(fmu(version, odd))?.instantiate("odd", &["u"], &["y"])
}

#[test]
fn it_is_the_model() {
    for version in VERSIONS {
        let fmu = open(version)
            .parameter("gain", 3.0)
            .unwrap()
            .parameter("T", 0.05)
            .unwrap();
        assert_eq!(fmu.version(), version);
        let plant = fmu
            .instantiate("lag", &["invert", "u"], &["y", "steps", "is high"])
            .unwrap();
        let mut plant = Checked::new(plant);
        let lag = FirstOrderLag::new(Port::new("u", "V"), Port::new("y", "rad/s"), 3.0, 50 * MS);
        let mut lag = Checked::new(lag);
        for n in 0..1000 {
            let voltage = 5.0 * (f64::from(n) * 0.05).sin();
            let invert = n % 100 > 50;
            plant.set("u", voltage).unwrap();
            plant.set("invert", f64::from(u8::from(invert))).unwrap();
            lag.set("u", if invert { -voltage } else { voltage })
                .unwrap();
            let time = MS * (1 + n % 3);
            plant.step(time).unwrap();
            lag.step(time).unwrap();
            let (is, expected) = (plant.get("y").unwrap(), lag.get("y").unwrap());
            assert!(
                (is - expected).abs() < 1e-9,
                "{version}, step {n}: {is}, {expected}"
            );
            assert_eq!(plant.get("steps"), Ok(f64::from(n + 1)));
            assert_eq!(plant.get("is high"), Ok(f64::from(u8::from(is > 1.0))));
        }
    }
}

#[test]
fn units_and_ranges_are_those_of_the_description() {
    for version in VERSIONS {
        let fmu = open(version);
        let text = fmu.to_string();
        assert!(text.starts_with(&format!("Lag ({version})\n")), "{text}");
        assert!(text.contains(": u in V, -10 to 10\n"), "{text}");
        assert!(text.contains(": y in rad/s, -1000 to 1000\n"), "{text}");
        let mut plant = Checked::new(fmu.instantiate("lag", &["u"], &["y"]).unwrap());
        assert_eq!(
            plant.plant().inputs()[0].to_string(),
            "u in V, -10 to 10, saturates"
        );
        plant.set("u", 1e9).unwrap();
        plant.step(Duration::from_secs(100)).unwrap();
        // The input was saturated.
        assert!((plant.get("y").unwrap() - 10.0).abs() < 1e-9);
        assert!(plant.set("u", f64::NAN).is_err());
    }
}

#[test]
fn two_instances_of_one_do_not_know_of_each_other() {
    for version in VERSIONS {
        let path = fmu(version, Odd::default());
        let make = || {
            let fmu = Fmu::open(&path).unwrap();
            Checked::new(fmu.instantiate("lag", &["u"], &["y"]).unwrap())
        };
        let (mut one, mut other) = (make(), make());
        one.set("u", 1.0).unwrap();
        for _ in 0..10 {
            one.step(MS).unwrap();
            other.step(MS).unwrap();
        }
        assert!(one.get("y").unwrap() > 0.0);
        drop(one);
        assert_eq!(other.get("y"), Ok(0.0));
        other.step(MS).unwrap();
    }
}

#[test]
fn one_that_takes_steps_of_one_length_is_given_such() {
    let any = "canHandleVariableCommunicationStepSize=\"true\"";
    for version in VERSIONS {
        let odd = Odd {
            replaced: Some((any, "")),
            ..Odd::default()
        };
        let fmu = Fmu::open(fmu(version, odd)).unwrap();
        let mut plant = Checked::new(fmu.instantiate("lag", &["u"], &["steps"]).unwrap());
        for (time, steps) in [(2, 1.0), (2, 2.0), (10, 7.0)] {
            plant.step(time * MS).unwrap();
            assert_eq!(plant.get("steps"), Ok(steps));
        }
        let error = PlantError::Fmu(FmuFault::StepSize {
            first: 2 * MS,
            step: 3 * MS,
        });
        assert_eq!(plant.step(3 * MS), Err(error));
    }
}

#[test]
fn a_failure_names_its_call_and_status() {
    let call = |call, status| PlantError::Fmu(FmuFault::Call { call, status });
    let out_of_range = PlantError::OutOfRange {
        side: Side::Output,
        port: Port::new("y", "rad/s").range(-1000.0, 1000.0),
        value: 1e6,
    };
    // The numbers of `fault` in model.c.
    let faults = [
        (1.0, Some(call("doStep", FmuStatus::Discard))),
        (2.0, Some(call("doStep", FmuStatus::Error))),
        // From then on it must not be called at all: it would end this program.
        (3.0, Some(call("doStep", FmuStatus::Fatal))),
        (5.0, Some(call("doStep", FmuStatus::Unknown))),
        (8.0, Some(call("get", FmuStatus::Error))),
        (9.0, Some(call("set", FmuStatus::Error))),
        (11.0, None),
        (12.0, Some(out_of_range)),
        // It logs null texts with an invalid status, although debug logging is off.
        (13.0, None),
        (16.0, None),
        (15.0, Some(call("doStep", FmuStatus::Unknown))),
    ];
    let of_three = [
        (6.0, Some(call("doStep", FmuStatus::Ended))),
        (7.0, Some(call("doStep", FmuStatus::Ended))),
    ];
    for version in VERSIONS {
        let more = if version == Version::Three {
            &of_three[..]
        } else {
            &[]
        };
        for (fault, expected) in faults.iter().chain(more) {
            let fmu = open(version).parameter("fault", *fault).unwrap();
            let mut plant = Checked::new(fmu.instantiate("lag", &["u"], &["y"]).unwrap());
            let failed = (0..6).find_map(|n| {
                let set = plant.set("u", f64::from(n));
                set.and_then(|()| plant.step(MS))
                    .err()
                    .map(|error| (n, error))
            });
            // The fourth step is number 3; values set before it are applied before the fifth.
            let at = if *fault == 9.0 { 4 } else { 3 };
            let expected = expected.clone().map(|error| (at, error));
            assert_eq!(failed, expected, "{version}, fault {fault}");
        }
        let fmu = open(version).parameter("fault", 4.0).unwrap();
        let mut plant = Checked::new(fmu.instantiate("lag", &["u"], &["y"]).unwrap());
        let error = (0..6).find_map(|_| plant.step(MS).err()).unwrap();
        assert_eq!(error.to_string(), "output `y` is NaN");
    }
}

#[test]
fn in_a_system_its_failure_is_the_emergency_and_no_value_gets_out() {
    for version in VERSIONS {
        for fault in [1.0, 2.0, 3.0, 4.0, 5.0, 12.0] {
            let mut system = System::new("fmu");
            let main = system.executor("main").build().unwrap();
            // Foreign code gets a thread of its own.
            let own = system.thread("plant");
            let (voltage, voltages) = luna::channel::<f64>();
            let (speed, speeds) = luna::channel::<f64>();
            let fmu = open(version).parameter("fault", fault).unwrap();
            let mut link =
                PlantLink::new("motor", fmu.instantiate("motor", &["u"], &["y"]).unwrap());
            link.actuator("u", voltages).unwrap();
            link.sensor("y", speed).unwrap();
            own.process("plant").spawn_ok(link.lock_step(MS).unwrap());
            main.process("control").spawn_ok(async move {
                for _ in 0..4 {
                    speeds.recv().await?;
                    voltage.send(1.0).await?;
                }
                // That of the fourth step.
                assert!(speeds.recv().await.is_err());
                Ok(())
            });
            let error = system.run().unwrap_err();
            assert_eq!(system.report().unwrap().end, End::Emergency, "{error}");
            let luna::Error::Process { source, .. } = &error else {
                panic!("{error}")
            };
            let luna::Error::Other(other) = &**source else {
                panic!("{error}")
            };
            assert!(other.get().is::<PlantFailure>(), "{error}");
        }
    }
}

#[test]
fn files_that_are_no_fmu() {
    assert!(matches!(
        Fmu::open("/nowhere/lag.fmu"),
        Err(FmuError::File { .. })
    ));
    let text = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("text.fmu");
    std::fs::write(&text, "no archive").unwrap();
    let error = Fmu::open(&text).unwrap_err().to_string();
    assert!(
        error.contains("text.fmu is no FMU that can be read"),
        "{error}"
    );
    for version in VERSIONS {
        let mute = Odd {
            is_mute: true,
            ..Odd::default()
        };
        let error = Fmu::open(fmu(version, mute)).unwrap_err();
        assert!(matches!(error, FmuError::Description { .. }), "{error}");
    }
}

#[test]
fn versions_and_kinds_that_are_not_read() {
    for (version, says) in [
        (Version::Two, "fmiVersion=\"2.0\""),
        (Version::Three, "fmiVersion=\"3.0\""),
    ] {
        let replaced = |replaced| Odd {
            replaced: Some(replaced),
            ..Odd::default()
        };
        let error = odd(version, replaced((says, "fmiVersion=\"1.0\""))).unwrap_err();
        assert_eq!(
            error,
            FmuError::Version {
                found: "1.0".to_owned()
            }
        );
        let exchange = replaced(("<CoSimulation", "<ModelExchange"));
        assert_eq!(
            odd(version, exchange).unwrap_err(),
            FmuError::NoCoSimulation
        );
    }
    // The description is of another version than the code.
    let error = odd(
        Version::Two,
        Odd {
            flag: Some("-DOTHER_VERSION"),
            ..Odd::default()
        },
    );
    assert_eq!(
        error.unwrap_err().to_string(),
        "the FMU's description is of FMI 2.0, and its code of FMI 1.0"
    );
}

#[test]
fn code_that_does_not_say_its_version() {
    for version in VERSIONS {
        let flagged = |flag| {
            let flag = Some(flag);
            odd(
                version,
                Odd {
                    flag,
                    ..Odd::default()
                },
            )
            .unwrap_err()
        };
        assert_eq!(
            flagged("-DNO_VERSION").to_string(),
            "the FMU's code cannot be loaded: it does not say its version"
        );
        let error = flagged("-DNO_TEXT");
        assert!(matches!(error, FmuError::VersionOfCode { .. }), "{error}");
    }
}

#[test]
fn a_byte_that_is_no_boolean_is_a_failure() {
    let fmu = open(Version::Three).parameter("fault", 14.0).unwrap();
    let mut plant = Checked::new(fmu.instantiate("lag", &["u"], &["is high"]).unwrap());
    let error = (0..6).find_map(|_| plant.step(MS).and_then(|()| plant.get("is high")).err());
    let error = error.unwrap().to_string();
    assert!(error.contains("output `is high` is 2"), "{error}");
}

#[test]
fn code_that_cannot_be_loaded() {
    for version in VERSIONS {
        let elsewhere = Odd {
            platform: Some("riscv64-vms"),
            ..Odd::default()
        };
        let error = odd(version, elsewhere).unwrap_err();
        assert!(matches!(error, FmuError::Library { .. }), "{error}");
        // It compares the token of the description with its own.
        let foreign = Odd {
            flag: Some("-DTOKEN=\"other\""),
            ..Odd::default()
        };
        let error = odd(version, foreign).unwrap_err();
        let FmuError::Refused { call, status, said } = error else {
            panic!("{error}")
        };
        assert_eq!((call, status), ("instantiate", FmuStatus::Error));
        assert!(said.starts_with("the token is another one"), "{said}");
        let fmu = open(version).parameter("fault", 10.0).unwrap();
        let error = fmu.instantiate("lag", &["u"], &["y"]).unwrap_err();
        let FmuError::Refused { call, status, said } = &error else {
            panic!("{error}")
        };
        assert_eq!(
            (*call, *status),
            ("enterInitializationMode", FmuStatus::Error)
        );
        assert!(said.starts_with("it does not converge"), "{said}");
        let text = error.to_string();
        assert!(
            text.starts_with("the FMU's enterInitializationMode returns an error: it does not"),
            "{text}"
        );
        let mute = Odd {
            flag: Some("-DMUTE"),
            ..Odd::default()
        };
        let text = odd(version, mute).unwrap_err().to_string();
        assert!(text.contains("it has logged no reason"), "{text}");
    }
    let lacking = Odd {
        flag: Some("-DNO_STEP"),
        ..Odd::default()
    };
    assert_eq!(
        odd(Version::Two, lacking).unwrap_err().to_string(),
        "the FMU's code cannot be loaded: it has no function fmi2DoStep"
    );
}

#[test]
fn variables_that_are_not_there_or_not_such() {
    for version in VERSIONS {
        let instantiate = |inputs: &[&str], outputs: &[&str]| {
            open(version)
                .instantiate("lag", inputs, outputs)
                .unwrap_err()
                .to_string()
        };
        assert_eq!(
            instantiate(&["v"], &["y"]),
            "the FMU has no `v`; it has `u`, `invert`"
        );
        assert_eq!(
            instantiate(&["u"], &["z"]),
            "the FMU has no `z`; it has `y`, `steps`, `is high`, `text`"
        );
        assert_eq!(
            instantiate(&["y"], &[]),
            "`y` of the FMU is no input, but of causality output"
        );
        assert_eq!(
            instantiate(&[], &["secret"]),
            "`secret` of the FMU is no output, but of causality local"
        );
        assert_eq!(
            instantiate(&[], &["text"]),
            "`text` of the FMU is a String; reals, 32-bit integers and booleans can be connected"
        );
        let parameter = |name, value| {
            open(version)
                .parameter(name, value)
                .unwrap_err()
                .to_string()
        };
        assert_eq!(
            parameter("u", 1.0),
            "`u` of the FMU is no parameter, but of causality input"
        );
        assert_eq!(
            parameter("T", 0.0),
            "parameter `T` of the FMU cannot be 0: it is within 0.000001 to inf"
        );
        assert_eq!(
            parameter("fault", 1.5),
            "parameter `fault` of the FMU cannot be 1.5: it is integer"
        );
        assert!(parameter("gain", f64::NAN).contains("cannot be NaN"));
        // A boolean has no value in between.
        let plant = open(version)
            .instantiate("lag", &["invert"], &["y"])
            .unwrap();
        let mut plant = Checked::new(plant);
        plant.set("invert", 0.5).unwrap();
        let error = plant.step(MS).unwrap_err();
        assert_eq!(
            error.to_string(),
            "input `invert` is 0.5, which is no boolean"
        );
    }
}
