//! A system's parameters, as the scope lists and sets them.

use crate::parameters::{Parameter, Parameters};
use luna_config::parameters::{Info, Parameters as OfSystem, Value};
use serde_json::{Number, Value as Json};

impl Parameters for OfSystem {
    fn list(&self) -> Vec<Parameter> {
        self.list().iter().map(shown).collect()
    }

    fn set(&self, name: &str, value: &Json) -> Result<(), String> {
        let value =
            read(value).ok_or("it must be a number, a text, true or false, or a list of them")?;
        match self.set([(name, value)]) {
            Ok(_) => Ok(()),
            Err(error) => Err(error.to_string()),
        }
    }
}

fn shown(info: &Info) -> Parameter {
    let mut description = info.description.clone();
    if !info.choices.is_empty() {
        let gap = if description.is_empty() { "" } else { ": " };
        description.push_str(&format!("{gap}one of {}", info.choices.join(", ")));
    }
    let parameter = Parameter::new(info.name.as_str(), written(&info.value))
        .unit(info.unit.as_str())
        .description(description);
    match (
        info.least.as_ref().and_then(number),
        info.most.as_ref().and_then(number),
    ) {
        (Some(least), Some(most)) => parameter.range(least, most),
        _ => parameter,
    }
}

fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Float(number) => Some(*number),
        Value::Integer(number) => Some(*number as f64),
        _ => None,
    }
}

fn written(value: &Value) -> Json {
    match value {
        Value::Float(number) => (*number).into(),
        // All that a parameter can have fits.
        Value::Integer(number) => Number::from_i128(*number).into(),
        Value::Bool(is) => (*is).into(),
        Value::List(values) => values.iter().map(written).collect(),
        text => text.to_string().into(),
    }
}

/// None for a value that no parameter can have.
fn read(value: &Json) -> Option<Value> {
    Some(match value {
        Json::Bool(is) => Value::Bool(*is),
        Json::Number(number) => match number.as_i128() {
            Some(number) => Value::Integer(number),
            None => Value::Float(number.as_f64()?),
        },
        // As the parameter's type asks: a choice, or a number of more digits than a page can keep.
        Json::String(text) => Value::Written(text.clone()),
        Json::Array(values) => Value::List(values.iter().map(read).collect::<Option<_>>()?),
        Json::Null | Json::Object(_) => return None,
    })
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use luna::parameters::Choice;
    use luna::prelude::*;
    use serde_json::json;

    #[derive(Clone, Copy, PartialEq)]
    enum Mode {
        Position,
        Speed,
    }

    impl Choice for Mode {
        const CHOICES: &'static [(&'static str, Mode)] =
            &[("position", Mode::Position), ("speed", Mode::Speed)];
    }

    #[test]
    fn parameters_of_each_type_are_listed_and_set() -> luna::Result<()> {
        let mut system = System::new("axis");
        system.virtual_clock();
        let of_system: Box<dyn Parameters> = Box::new(system.parameters());
        assert!(of_system.list().is_empty());
        assert!(of_system.set("kp", &json!(1)).is_err());
        let main = system.executor("main").build()?;
        let axis = main.process("axis");
        let kp = axis
            .parameter("kp", 2.0)
            .unit("1/rad")
            .range(0.0..=50.0)
            .description("of pan")
            .register()?;
        let mode = axis
            .parameter("mode", Mode::Position)
            .description("what is controlled")
            .register()?;
        let gains = axis.parameter("gains", [1.0, 0.5]).register()?;
        let count = axis.parameter("count", u64::MAX).register()?;
        let is_on = axis.parameter("is on", false).register()?;
        axis.spawn(async move {
            let list = json!(of_system.list());
            assert_eq!(
                list,
                json!([
                    {"name": "count", "value": u64::MAX, "unit": "", "description": ""},
                    {"name": "gains", "value": [1.0, 0.5], "unit": "", "description": ""},
                    {"name": "is on", "value": false, "unit": "", "description": ""},
                    {"name": "kp", "value": 2.0, "unit": "1/rad", "description": "of pan", "least": 0.0, "greatest": 50.0},
                    {"name": "mode", "value": "position", "unit": "", "description": "what is controlled: one of position, speed"},
                ])
            );
            // As the page sends them: a number has no point if it needs none.
            for (name, value, then) in [
                ("kp", json!(3), json!(3.0)),
                ("kp", json!("4.5"), json!(4.5)),
                ("mode", json!("speed"), json!("speed")),
                ("gains", json!([2, 0.25]), json!([2.0, 0.25])),
                ("gains", json!("[1, 2]"), json!([1.0, 2.0])),
                ("count", json!(7), json!(7)),
                ("is on", json!(true), json!(true)),
            ] {
                of_system.set(name, &value).map_err(luna::Error::other)?;
                let list = of_system.list();
                let found = list.iter().find(|parameter| parameter.name == name);
                assert_eq!(
                    found.map(|parameter| &parameter.value),
                    Some(&then),
                    "{name}"
                );
            }
            for (name, value, why) in [
                ("kp", json!(50.5), "it must be 0.0 to 50.0"),
                ("kp", json!(null), "it must be a number, a text"),
                ("kp", json!({}), "it must be a number, a text"),
                ("kq", json!(1), "did you mean `kp`?"),
                ("mode", json!("torque"), "it must be one of position, speed"),
                ("gains", json!([1]), "it must have 2 elements"),
                ("count", json!(-1), "it must be 0 to 18446744073709551615"),
            ] {
                let error = of_system.set(name, &value).unwrap_err();
                assert!(error.contains(why), "{name}: {error}");
            }
            kp.latch();
            assert_eq!((kp.get(), gains.get(), count.get()), (4.5, [1.0, 2.0], 7));
            assert!(mode.get() == Mode::Speed && is_on.get());
            Ok(())
        })?;
        drop(main);
        system.run()?;
        Ok(())
    }
}
