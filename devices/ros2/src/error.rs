//! What can go wrong.

use thiserror::Error;

/// Why something of a node cannot be made, or why its link has ended.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Ros2Error {
    /// A name breaks ROS 2's rules.
    #[error(
        "`{name}` cannot be the name of a {what}: {reason}; use letters, digits, single `_` and `/`, each part beginning with a letter or `_`"
    )]
    Name {
        /// The name.
        name: String,
        /// Of what.
        what: &'static str,
        /// What is wrong.
        reason: String,
    },
    /// A type's name is not of the form that ROS 2 has.
    #[error("`{name}` is no type; write PACKAGE/{kind}/NAME")]
    Type {
        /// The name.
        name: &'static str,
        /// `msg` or `srv`.
        kind: &'static str,
    },
    /// The environment's variable for the domain is wrong.
    #[error("ROS_DOMAIN_ID is `{value}`; it must be a number from 0 to 232")]
    DomainVariable {
        /// What it is.
        value: String,
    },
    /// The domain has no ports.
    #[error("domain {domain} has no ports; use one from 0 to 232")]
    Domain {
        /// The domain.
        domain: u16,
    },
    /// A queue without room.
    #[error("the QoS of `{name}` keeps the last 0 values; use a depth from 1")]
    Depth {
        /// The topic.
        name: String,
    },
    /// DDS has refused it.
    #[error("DDS made no {what} for `{name}`: {reason}")]
    Create {
        /// What.
        what: &'static str,
        /// For which topic, service or node.
        name: String,
        /// Its words.
        reason: String,
    },
    /// No thread could be made.
    #[error("no thread for `{name}`: {reason}")]
    Thread {
        /// Of what.
        name: String,
        /// Why.
        reason: String,
    },
    /// DDS has ended under a link.
    #[error("the DDS side of `{name}` has ended: {reason}; make the node again")]
    Ended {
        /// The topic or service.
        name: String,
        /// Its words.
        reason: String,
    },
    /// The system runs on a virtual clock.
    #[error(
        "the link of `{name}` takes real time, which a virtual clock does not wait for: use an ordinary channel in a simulation"
    )]
    VirtualClock {
        /// The topic or service.
        name: String,
    },
    /// A link was run again.
    #[error("the link of `{name}` has run already; make another one")]
    RunTwice {
        /// The topic or service.
        name: String,
    },
}

impl From<Ros2Error> for luna::Error {
    fn from(error: Ros2Error) -> Self {
        luna::Error::other(error)
    }
}
