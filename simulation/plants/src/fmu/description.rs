//! The parts of a modelDescription.xml that a plant needs.
//!
//! Not by the `fmi` crate: that omits the units and ranges of version 2, and refuses descriptions
//! with unknown attributes, which many tools write.

use super::error::FmuError;
use super::{Kind, Variable, Version};
use roxmltree::{Document, Node};
use std::collections::HashMap;

pub(super) struct Description {
    pub(super) version: Version,
    pub(super) model: String,
    /// guid, instantiationToken.
    pub(super) token: String,
    pub(super) identifier: String,
    pub(super) takes_any_step: bool,
    pub(super) variables: Vec<Variable>,
}

/// Defaults of a type definition for the variables that refer to it.
#[derive(Default, Clone)]
struct Defaults {
    unit: Option<String>,
    min: Option<f64>,
    max: Option<f64>,
}

fn bad(reason: impl Into<String>) -> FmuError {
    FmuError::Description {
        reason: reason.into(),
    }
}

fn required<'a>(node: Node<'a, '_>, name: &str) -> Result<&'a str, FmuError> {
    node.attribute(name)
        .ok_or_else(|| bad(format!("<{}> has no {name}", node.tag_name().name())))
}

fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|child| child.has_tag_name(name))
}

impl Defaults {
    /// The node's attributes, and for missing ones those of its type.
    fn of(node: Node<'_, '_>, types: &HashMap<&str, Defaults>) -> Result<Self, FmuError> {
        let declared = node
            .attribute("declaredType")
            .and_then(|name| types.get(name))
            .cloned()
            .unwrap_or_default();
        let number = |name: &str| match node.attribute(name) {
            None => Ok(None),
            Some(text) => match text.trim().parse::<f64>() {
                Ok(value) if !value.is_nan() => Ok(Some(value)),
                _ => Err(bad(format!("{name}=\"{text}\" is no number"))),
            },
        };
        Ok(Self {
            unit: node.attribute("unit").map(str::to_owned).or(declared.unit),
            min: number("min")?.or(declared.min),
            max: number("max")?.or(declared.max),
        })
    }
}

impl Description {
    pub(super) fn parse(xml: &str) -> Result<Self, FmuError> {
        let document = Document::parse(xml).map_err(|error| bad(error.to_string()))?;
        let root = document.root_element();
        if !root.has_tag_name("fmiModelDescription") {
            return Err(bad(format!("begins with <{}>", root.tag_name().name())));
        }
        let found = required(root, "fmiVersion")?;
        let version = match found.split('.').next() {
            Some("2") => Version::Two,
            Some("3") => Version::Three,
            _ => {
                return Err(FmuError::Version {
                    found: found.to_owned(),
                });
            }
        };
        let co_simulation = child(root, "CoSimulation").ok_or(FmuError::NoCoSimulation)?;
        let token = match version {
            Version::Two => "guid",
            Version::Three => "instantiationToken",
        };
        Ok(Self {
            version,
            model: required(root, "modelName")?.to_owned(),
            token: required(root, token)?.to_owned(),
            identifier: required(co_simulation, "modelIdentifier")?.to_owned(),
            takes_any_step: matches!(
                co_simulation.attribute("canHandleVariableCommunicationStepSize"),
                Some("true" | "1")
            ),
            variables: variables(root, version)?,
        })
    }

    /// A description reduced to what the `fmi` crate needs to load and instantiate.
    pub(super) fn for_loader(&self) -> String {
        let (version, token) = match self.version {
            Version::Two => ("2.0", "guid"),
            Version::Three => ("3.0", "instantiationToken"),
        };
        format!(
            "<fmiModelDescription fmiVersion=\"{version}\" modelName=\"{}\" {token}=\"{}\">\
             <CoSimulation modelIdentifier=\"{}\"/><ModelVariables/><ModelStructure/></fmiModelDescription>",
            escaped(&self.model),
            escaped(&self.token),
            escaped(&self.identifier),
        )
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

fn variables(root: Node<'_, '_>, version: Version) -> Result<Vec<Variable>, FmuError> {
    let none = HashMap::new();
    let mut types = HashMap::new();
    for one in child(root, "TypeDefinitions")
        .into_iter()
        .flat_map(|node| node.children().filter(Node::is_element))
    {
        // In version 2 the properties are those of a child.
        let properties = match version {
            Version::Two => one.first_element_child(),
            Version::Three => Some(one),
        };
        if let (Some(name), Some(properties)) = (one.attribute("name"), properties) {
            types.insert(name, Defaults::of(properties, &none)?);
        }
    }
    let listed = child(root, "ModelVariables").ok_or_else(|| bad("it has no <ModelVariables>"))?;
    listed
        .children()
        .filter(Node::is_element)
        .map(|node| variable(node, version, &types))
        .collect()
}

fn variable(
    node: Node<'_, '_>,
    version: Version,
    types: &HashMap<&str, Defaults>,
) -> Result<Variable, FmuError> {
    let name = required(node, "name")?;
    // In version 2 the type is a child, in version 3 the element itself.
    let typed = match version {
        Version::Two => node
            .children()
            .find(|child| child.is_element() && !child.has_tag_name("Annotations"))
            .ok_or_else(|| bad(format!("`{name}` has no type")))?,
        Version::Three => node,
    };
    let is_array = child(node, "Dimension").is_some();
    let type_name = typed.tag_name().name();
    let kind = match (version, type_name) {
        _ if is_array => None,
        (Version::Two, "Real") | (Version::Three, "Float64") => Some(Kind::Real),
        (Version::Two, "Integer") | (Version::Three, "Int32") => Some(Kind::Integer),
        (_, "Boolean") => Some(Kind::Boolean),
        _ => None,
    };
    let properties = Defaults::of(typed, types)?;
    let (least, greatest) = match kind {
        Some(Kind::Integer) => (i32::MIN.into(), i32::MAX.into()),
        Some(Kind::Boolean) => (0.0, 1.0),
        _ => (f64::NEG_INFINITY, f64::INFINITY),
    };
    let min = properties.min.unwrap_or(least).max(least);
    let max = properties.max.unwrap_or(greatest).min(greatest);
    if min > max {
        return Err(bad(format!("`{name}` has no range from {min} to {max}")));
    }
    let reference = required(node, "valueReference")?;
    Ok(Variable {
        name: name.to_owned(),
        reference: reference
            .parse()
            .map_err(|_| bad(format!("valueReference=\"{reference}\" is no number")))?,
        causality: node.attribute("causality").unwrap_or("local").to_owned(),
        type_name: if is_array {
            format!("{type_name} array")
        } else {
            type_name.to_owned()
        },
        kind,
        // None is a ratio, by the standard.
        unit: properties.unit.unwrap_or_else(|| "1".to_owned()),
        min,
        max,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two(variables: &str) -> Result<Description, FmuError> {
        Description::parse(&format!(
            "<fmiModelDescription fmiVersion='2.0' modelName='m' guid='{{&amp;}}' vendor='x'>\
             <CoSimulation modelIdentifier='id' canHandleVariableCommunicationStepSize='true'/>\
             <TypeDefinitions><SimpleType name='Angle'><Real unit='rad' min='-3' max='3'/></SimpleType></TypeDefinitions>\
             <ModelVariables>{variables}</ModelVariables></fmiModelDescription>"
        ))
    }

    #[test]
    fn units_and_ranges_are_the_variables_or_their_types() {
        let description = two(
            "<ScalarVariable name='a' valueReference='1' causality='input' canHandleMultipleSetPerTimeInstant='true'>\
             <Annotations/><Real declaredType='Angle' max='2'/></ScalarVariable>\
             <ScalarVariable name='b' valueReference='2'><Real/></ScalarVariable>\
             <ScalarVariable name='c' valueReference='3'><String/></ScalarVariable>",
        )
        .unwrap();
        let of = |n: usize| {
            let v: &Variable = &description.variables[n];
            (v.unit.as_str(), v.min, v.max, v.kind, v.causality.as_str())
        };
        assert_eq!(of(0), ("rad", -3.0, 2.0, Some(Kind::Real), "input"));
        let (least, greatest) = (f64::NEG_INFINITY, f64::INFINITY);
        assert_eq!(of(1), ("1", least, greatest, Some(Kind::Real), "local"));
        assert_eq!(of(2).3, None);
        // The passed-on description can be read again.
        assert!(description.for_loader().contains("guid=\"{&amp;}\""));
        Document::parse(&description.for_loader()).unwrap();
    }

    #[test]
    fn arrays_and_ranges_of_version_3() {
        let description = Description::parse(
            "<fmiModelDescription fmiVersion='3.0.1' modelName='m' instantiationToken='t'><CoSimulation modelIdentifier='id'/>\
             <TypeDefinitions><Float64Type name='U' unit='V' min='0'/></TypeDefinitions><ModelVariables>\
             <Float64 name='u' valueReference='0' causality='input' declaredType='U'/>\
             <Float64 name='v' valueReference='1'><Dimension start='3'/></Float64>\
             <Boolean name='w' valueReference='2'/></ModelVariables></fmiModelDescription>",
        )
        .unwrap();
        let [u, v, w] = &description.variables[..] else {
            panic!("three")
        };
        assert_eq!((u.unit.as_str(), u.min, u.max), ("V", 0.0, f64::INFINITY));
        assert_eq!((v.kind, v.type_name.as_str()), (None, "Float64 array"));
        assert_eq!((w.kind, w.min, w.max), (Some(Kind::Boolean), 0.0, 1.0));
        assert!(!description.takes_any_step);
    }

    #[test]
    fn malformed_descriptions_are_reported() {
        let reason = |text: Result<Description, FmuError>| text.err().unwrap().to_string();
        let variable = |text: &str| reason(two(text));
        assert!(
            variable("<ScalarVariable name='a'><Real/></ScalarVariable>")
                .contains("has no valueReference")
        );
        assert!(
            variable("<ScalarVariable name='a' valueReference='1'/>").contains("`a` has no type")
        );
        assert!(variable("<ScalarVariable name='a' valueReference='1'><Real min='2' max='1'/></ScalarVariable>").contains("no range from 2 to 1"));
        assert!(
            variable(
                "<ScalarVariable name='a' valueReference='1'><Real min='nan'/></ScalarVariable>"
            )
            .contains("is no number")
        );
        assert!(reason(Description::parse("<html/>")).contains("begins with <html>"));
        assert!(reason(Description::parse("<html>")).contains("description"));
        let version = Description::parse("<fmiModelDescription fmiVersion='1.0'/>");
        assert_eq!(
            version.err(),
            Some(FmuError::Version {
                found: "1.0".to_owned()
            })
        );
        let exchange = Description::parse(
            "<fmiModelDescription fmiVersion='2.0'><ModelExchange/></fmiModelDescription>",
        );
        assert_eq!(exchange.err(), Some(FmuError::NoCoSimulation));
    }
}
