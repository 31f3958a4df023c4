//! Interfaces of the package `builtin_interfaces`.

/// A span of time. A negative one has negative seconds, and counts nanoseconds up from them.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Duration {
    /// Whole seconds.
    pub sec: i32,
    /// The rest, below 1 000 000 000.
    pub nanosec: u32,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Duration {
    fn default() -> Self {
        Self {
            sec: Default::default(),
            nanosec: Default::default(),
        }
    }
}

impl luna_ros2::Message for Duration {
    const TYPE: &'static str = "builtin_interfaces/msg/Duration";
}

/// A point in time: seconds and nanoseconds since the epoch of its clock.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Time {
    /// Whole seconds.
    pub sec: i32,
    /// The rest, below 1 000 000 000.
    pub nanosec: u32,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Time {
    fn default() -> Self {
        Self {
            sec: Default::default(),
            nanosec: Default::default(),
        }
    }
}

impl luna_ros2::Message for Time {
    const TYPE: &'static str = "builtin_interfaces/msg/Time";
}
