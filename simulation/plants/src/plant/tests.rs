//! Whatever a plant does wrong, no value of it gets out.

use super::*;

/// A plant that follows a script.
struct Scripted {
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    step: Result<(), PlantError>,
    measure: Result<(), PlantError>,
    value: Option<f64>,
    applied: Vec<f64>,
}

impl Scripted {
    fn new(input: Port, output: Port) -> Self {
        Self {
            inputs: vec![input],
            outputs: vec![output],
            step: Ok(()),
            measure: Ok(()),
            value: Some(0.0),
            applied: Vec::new(),
        }
    }
}

impl Plant for Scripted {
    fn inputs(&self) -> &[Port] {
        &self.inputs
    }

    fn outputs(&self) -> &[Port] {
        &self.outputs
    }

    fn apply(&mut self, inputs: &[f64]) -> Result<(), PlantError> {
        self.applied = inputs.to_vec();
        Ok(())
    }

    fn step(&mut self, _: Duration) -> Result<(), PlantError> {
        self.step.clone()
    }

    fn measure(&mut self, outputs: &mut [f64]) -> Result<(), PlantError> {
        if let Some(value) = self.value {
            outputs[0] = value;
        }
        self.measure.clone()
    }
}

const STEP: Duration = Duration::from_millis(1);

fn plain() -> Scripted {
    Scripted::new(Port::new("u", "V"), Port::new("y", "rad").range(-1.0, 1.0))
}

/// Fails with `error`, at once and for ever.
fn fails(plant: Scripted, error: &PlantError) {
    let mut checked = Checked::new(plant);
    assert_eq!(checked.step(STEP).as_ref(), Err(error));
    checked.plant.step = Ok(());
    checked.plant.measure = Ok(());
    checked.plant.value = Some(0.5);
    assert_eq!(checked.outputs().err().as_ref(), Some(error));
    assert_eq!(checked.step(STEP).as_ref(), Err(error));
    assert_eq!(checked.set("u", 0.0).as_ref(), Err(error));
    assert_eq!(checked.failure(), Some(error));
}

#[test]
fn errors_of_step_and_measure_are_final() {
    let error = PlantError::model("no solution");
    fails(
        Scripted {
            step: Err(error.clone()),
            ..plain()
        },
        &error,
    );
    fails(
        Scripted {
            measure: Err(error.clone()),
            ..plain()
        },
        &error,
    );
}

#[test]
fn an_output_that_is_no_number_is_refused() {
    for value in [f64::INFINITY, f64::NEG_INFINITY] {
        let error = PlantError::NotFinite {
            side: Side::Output,
            port: "y".into(),
            value,
        };
        fails(
            Scripted {
                value: Some(value),
                ..plain()
            },
            &error,
        );
    }
    // NaN is not equal to itself.
    for value in [Some(f64::NAN), None] {
        let mut checked = Checked::new(Scripted { value, ..plain() });
        assert_eq!(
            checked.step(STEP).unwrap_err().to_string(),
            "output `y` is NaN"
        );
        checked.plant.value = Some(0.0);
        assert!(checked.outputs().is_err());
    }
}

#[test]
fn an_output_out_of_range_fails_unless_it_saturates() {
    let port = plain().outputs[0].clone();
    let error = PlantError::OutOfRange {
        side: Side::Output,
        port: port.clone(),
        value: 1.5,
    };
    assert_eq!(
        error.to_string(),
        "output `y` is 1.5 rad, outside of -1 to 1 rad"
    );
    fails(
        Scripted {
            value: Some(1.5),
            ..plain()
        },
        &error,
    );

    let saturates = Scripted::new(Port::new("u", "V"), port.outside(Outside::Saturate));
    let mut checked = Checked::new(Scripted {
        value: Some(1.5),
        ..saturates
    });
    assert_eq!(checked.outputs(), Ok(&[1.0][..]));
    checked.plant.value = Some(f64::NAN);
    assert!(checked.step(STEP).is_err());
}

#[test]
fn inputs_saturate_or_fail_by_their_port() {
    let duty = Port::new("u", "1").range(-1.0, 1.0);
    let saturates = Scripted::new(duty.clone().outside(Outside::Saturate), Port::new("y", "1"));
    let mut checked = Checked::new(saturates);
    for (given, applied) in [(0.3, 0.3), (7.0, 1.0), (f64::NEG_INFINITY, -1.0)] {
        checked.set("u", given).unwrap();
        checked.step(STEP).unwrap();
        assert_eq!(checked.plant.applied, [applied]);
    }
    assert_eq!(
        checked.set("u", f64::NAN).unwrap_err().to_string(),
        "input `u` is NaN"
    );
    assert!(checked.step(STEP).is_err());

    let mut checked = Checked::new(Scripted::new(duty.clone(), Port::new("y", "1")));
    let error = PlantError::OutOfRange {
        side: Side::Input,
        port: duty,
        value: 1.1,
    };
    assert_eq!(checked.set("u", 1.1), Err(error));
}

#[test]
fn inputs_begin_next_to_zero() {
    let valve = Port::new("u", "%").range(20.0, 100.0);
    let mut checked = Checked::new(Scripted::new(valve, Port::new("y", "1")));
    checked.set("u", 70.0).unwrap();
    checked.set_neutral(0);
    checked.step(STEP).unwrap();
    assert_eq!(checked.plant.applied, [20.0]);
}
