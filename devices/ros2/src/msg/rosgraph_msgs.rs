//! Interfaces of the package `rosgraph_msgs`.

/// The time of a simulation.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Clock {
    /// Now.
    pub clock: super::builtin_interfaces::Time,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Clock {
    fn default() -> Self {
        Self {
            clock: Default::default(),
        }
    }
}

impl luna_ros2::Message for Clock {
    const TYPE: &'static str = "rosgraph_msgs/msg/Clock";
}
