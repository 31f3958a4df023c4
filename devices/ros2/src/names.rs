//! Names of nodes, topics, services and types.

use crate::Ros2Error;
use ros2_client::{MessageTypeName, Name, NodeName, ServiceTypeName};

pub(crate) fn node(namespace: &str, name: &str) -> Result<NodeName, Ros2Error> {
    NodeName::new(namespace, name).map_err(|error| Ros2Error::Name {
        name: format!("{namespace} {name}"),
        what: "node",
        reason: error.to_string(),
    })
}

/// The whole name of a topic or service: `name` may be relative to the node's namespace, or begin
/// with `~/` for the node itself.
pub(crate) fn resolve(name: &str, node: &NodeName, what: &'static str) -> Result<Name, Ros2Error> {
    let whole = match (name.strip_prefix("~/"), name.starts_with('/')) {
        (Some(own), _) => format!("{}/{own}", node.fully_qualified_name()),
        (None, true) => name.to_owned(),
        (None, false) => format!("{}/{name}", node.namespace().trim_end_matches('/')),
    };
    Name::parse(&whole).map_err(|error| Ros2Error::Name {
        name: name.to_owned(),
        what,
        reason: error.to_string(),
    })
}

pub(crate) fn message(name: &'static str) -> Result<MessageTypeName, Ros2Error> {
    let (package, name) = split(name, "msg")?;
    Ok(MessageTypeName::new(package, name))
}

pub(crate) fn service(name: &'static str) -> Result<ServiceTypeName, Ros2Error> {
    let (package, name) = split(name, "srv")?;
    Ok(ServiceTypeName::new(package, name))
}

fn split(
    whole: &'static str,
    kind: &'static str,
) -> Result<(&'static str, &'static str), Ros2Error> {
    let mut parts = whole.split('/');
    match (parts.next(), parts.next(), parts.next(), parts.next()) {
        (Some(package), Some(middle), Some(name), None)
            if middle == kind && !package.is_empty() && !name.is_empty() =>
        {
            Ok((package, name))
        }
        _ => Err(Ros2Error::Type { name: whole, kind }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_resolved_by_the_rules_of_ros_2() {
        let node = node("/arm", "driver").unwrap();
        let whole = |name| resolve(name, &node, "topic").map(|name| name.to_string());
        assert_eq!(whole("/chatter").unwrap(), "/chatter");
        assert_eq!(whole("joints").unwrap(), "/arm/joints");
        assert_eq!(whole("~/state").unwrap(), "/arm/driver/state");
        for wrong in ["", "/", "a//b", "2nd", "a b", "a/", "~"] {
            let error = whole(wrong).unwrap_err().to_string();
            assert!(error.contains(&format!("`{wrong}`")), "{error}");
        }
        assert!(message("std_msgs/String").is_err() && service("a/msg/B").is_err());
    }

    #[test]
    fn a_node_in_the_root_has_its_topics_there() {
        let node = node("/", "talker").unwrap();
        let name = resolve("chatter", &node, "topic").unwrap();
        assert_eq!(name.to_dds_name("rt", &node, ""), "rt/chatter");
        assert!(super::node("/", "two words").is_err());
    }
}
