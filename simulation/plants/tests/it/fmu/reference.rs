//! The Reference FMUs of the Modelica Association: made by the authors of the standard, to try
//! importers with.
//!
//! `.ci/run night` takes them from a package that has them, and names their folder, with `fmi2` and
//! `fmi3` in it, in `LUNA_REFERENCE_FMUS`.

use super::VERSIONS;
use luna_plants::fmu::{Fmu, FmuError, FmuPlant, Version};
use luna_plants::{Checked, PlantError};
use std::path::PathBuf;
use std::time::Duration;

const STEP: Duration = Duration::from_millis(100);

fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("LUNA_REFERENCE_FMUS").map(PathBuf::from);
    if folder.is_none() {
        eprintln!("skipped: the Reference FMUs: set LUNA_REFERENCE_FMUS to their folder");
    }
    folder
}

fn open(version: Version, name: &str) -> Option<Fmu> {
    let of = match version {
        Version::Two => "fmi2",
        Version::Three => "fmi3",
    };
    let fmu = Fmu::open(folder()?.join(of).join(format!("{name}.fmu"))).unwrap();
    assert_eq!(fmu.version(), version);
    Some(fmu)
}

fn plant(fmu: Fmu, inputs: &[&str], outputs: &[&str]) -> Checked<FmuPlant> {
    Checked::new(fmu.instantiate("reference", inputs, outputs).unwrap())
}

/// x' = -k x, by Euler's method with steps of 0.1 s.
#[test]
fn dahlquist_is_its_equation() {
    for version in VERSIONS {
        let Some(fmu) = open(version, "Dahlquist") else {
            return;
        };
        let mut plant = plant(fmu.parameter("k", 2.0).unwrap(), &[], &["x"]);
        let mut expected = 1.0;
        for step in 0..50 {
            let x = plant.get("x").unwrap();
            assert!((x - expected).abs() < 1e-9, "{version}, step {step}: {x}");
            plant.step(STEP).unwrap();
            expected *= 1.0 - 2.0 * 0.1;
        }
    }
}

#[test]
fn a_ball_bounces_lower_each_time() {
    for version in VERSIONS {
        let Some(fmu) = open(version, "BouncingBall") else {
            return;
        };
        let mut plant = plant(fmu.parameter("e", 0.5).unwrap(), &[], &["h", "v"]);
        let (mut highest, mut bounces, mut rises) = (1.0_f64, 0, false);
        let mut since = 0.0_f64;
        for _ in 0..200 {
            plant.step(STEP / 10).unwrap();
            let (h, v) = (plant.get("h").unwrap(), plant.get("v").unwrap());
            assert!((-0.05..=1.0).contains(&h), "{version}: {h}");
            if v > 0.0 && !rises {
                bounces += 1;
                assert!(
                    bounces == 1 || since < highest,
                    "{version}: {since} {highest}"
                );
                (highest, since) = (if bounces == 1 { 1.0 } else { since }, 0.0);
            }
            rises = v > 0.0;
            since = since.max(h);
        }
        assert!(bounces >= 3, "{version}: {bounces}");
    }
}

#[test]
fn what_goes_in_comes_out() {
    for version in VERSIONS {
        let Some(fmu) = open(version, "Feedthrough") else {
            return;
        };
        let fmu = fmu.parameter("Float64_fixed_parameter", 3.5).unwrap();
        let inputs = ["Float64_continuous_input", "Int32_input", "Boolean_input"];
        let outputs = [
            "Float64_continuous_output",
            "Int32_output",
            "Boolean_output",
        ];
        let mut plant = plant(fmu, &inputs, &outputs);
        for (real, integer, truth) in [(0.5, -3.0, 1.0), (-1e9, 2e9, 0.0)] {
            for (input, value) in inputs.iter().zip([real, integer, truth]) {
                plant.set(input, value).unwrap();
            }
            plant.step(STEP).unwrap();
            for (output, value) in outputs.iter().zip([real, integer, truth]) {
                assert_eq!(plant.get(output), Ok(value), "{version}: {output}");
            }
        }
        let text = open(version, "Feedthrough").unwrap();
        let error = text
            .instantiate("text", &["String_input"], &[])
            .unwrap_err();
        assert!(matches!(error, FmuError::Type { .. }), "{error}");
    }
}

/// It counts seconds, and asks for the end of the simulation at 10.
#[test]
fn a_stair_ends_the_simulation() {
    for version in VERSIONS {
        let Some(fmu) = open(version, "Stair") else {
            return;
        };
        let mut plant = plant(fmu, &[], &["counter"]);
        let mut failed = None;
        for step in 1..=120 {
            if let Err(error) = plant.step(STEP) {
                failed = Some((step, error));
                break;
            }
            let counter = plant.get("counter").unwrap();
            let seconds = f64::from(step) * 0.1;
            assert!(
                (counter - 1.0 - seconds).abs() <= 1.1,
                "{version}: {counter} at {seconds}"
            );
        }
        let (step, error) = failed.expect("it ends");
        assert!((80..=101).contains(&step), "{version}: step {step}");
        assert!(matches!(error, PlantError::Fmu(_)), "{error}");
    }
}

#[test]
fn van_der_pol_oscillates() {
    for version in VERSIONS {
        let Some(fmu) = open(version, "VanDerPol") else {
            return;
        };
        let mut plant = plant(fmu, &[], &["x0", "x1"]);
        let (mut least, mut most) = (f64::MAX, f64::MIN);
        for _ in 0..200 {
            plant.step(STEP).unwrap();
            let x = plant.get("x0").unwrap();
            (least, most) = (least.min(x), most.max(x));
        }
        // The limit cycle's amplitude is 2.009, of Euler's method a little more.
        assert!(
            (1.9..2.2).contains(&most) && (-2.2..-1.9).contains(&least),
            "{version}: {least} to {most}"
        );
    }
}

/// The reason of a refusal is theirs: a token of another model.
#[test]
fn a_reference_fmu_says_why_it_refuses() {
    for version in VERSIONS {
        let Some(folder) = folder() else { return };
        let (of, attribute) = match version {
            Version::Two => ("fmi2", "guid"),
            Version::Three => ("fmi3", "instantiationToken"),
        };
        let from = folder.join(of).join("Dahlquist.fmu");
        let mut archive = zip::ZipArchive::new(std::fs::File::open(from).unwrap()).unwrap();
        let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("token-{of}.fmu"));
        let mut changed = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
        for number in 0..archive.len() {
            let mut file = archive.by_index(number).unwrap();
            let name = file.name().to_owned();
            if file.is_dir() {
                continue;
            }
            let mut bytes = Vec::new();
            std::io::copy(&mut file, &mut bytes).unwrap();
            if name == "modelDescription.xml" {
                let text = String::from_utf8(bytes).unwrap();
                let other = format!("{attribute}=\"{{0");
                bytes = text
                    .replace(&format!("{attribute}=\"{{2"), &other)
                    .into_bytes();
            }
            let options = zip::write::SimpleFileOptions::default();
            changed.start_file(name, options).unwrap();
            std::io::Write::write_all(&mut changed, &bytes).unwrap();
        }
        changed.finish().unwrap();
        let error = Fmu::open(&path)
            .unwrap()
            .instantiate("token", &[], &["x"])
            .unwrap_err();
        let FmuError::Refused { said, .. } = &error else {
            panic!("{error}")
        };
        assert!(!said.is_empty(), "{version}: {error}");
        eprintln!("{error}");
    }
}
