//! Interfaces of the package `std_srvs`.

/// A request of `std_srvs/Empty`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct EmptyRequest {
    /// Without meaning.
    pub structure_needs_at_least_one_member: u8,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for EmptyRequest {
    fn default() -> Self {
        Self {
            structure_needs_at_least_one_member: 0,
        }
    }
}

/// A reply of `std_srvs/Empty`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct EmptyReply {
    /// Without meaning.
    pub structure_needs_at_least_one_member: u8,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for EmptyReply {
    fn default() -> Self {
        Self {
            structure_needs_at_least_one_member: 0,
        }
    }
}

/// The service `std_srvs/srv/Empty`.
#[derive(Debug)]
pub enum Empty {}

impl luna_ros2::Service for Empty {
    type Request = EmptyRequest;
    type Reply = EmptyReply;
    const TYPE: &'static str = "std_srvs/srv/Empty";
}

/// A request of `std_srvs/SetBool`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct SetBoolRequest {
    /// On or off.
    pub data: bool,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for SetBoolRequest {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

/// A reply of `std_srvs/SetBool`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct SetBoolReply {
    /// Whether it was done.
    pub success: bool,
    /// What happened, in words.
    pub message: std::string::String,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for SetBoolReply {
    fn default() -> Self {
        Self {
            success: Default::default(),
            message: Default::default(),
        }
    }
}

/// The service `std_srvs/srv/SetBool`.
#[derive(Debug)]
pub enum SetBool {}

impl luna_ros2::Service for SetBool {
    type Request = SetBoolRequest;
    type Reply = SetBoolReply;
    const TYPE: &'static str = "std_srvs/srv/SetBool";
}

/// A request of `std_srvs/Trigger`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct TriggerRequest {
    /// Without meaning.
    pub structure_needs_at_least_one_member: u8,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for TriggerRequest {
    fn default() -> Self {
        Self {
            structure_needs_at_least_one_member: 0,
        }
    }
}

/// A reply of `std_srvs/Trigger`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct TriggerReply {
    /// Whether it was done.
    pub success: bool,
    /// What happened, in words.
    pub message: std::string::String,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for TriggerReply {
    fn default() -> Self {
        Self {
            success: Default::default(),
            message: Default::default(),
        }
    }
}

/// The service `std_srvs/srv/Trigger`.
#[derive(Debug)]
pub enum Trigger {}

impl luna_ros2::Service for Trigger {
    type Request = TriggerRequest;
    type Reply = TriggerReply;
    const TYPE: &'static str = "std_srvs/srv/Trigger";
}
