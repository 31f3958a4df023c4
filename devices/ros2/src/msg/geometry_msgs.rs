//! Interfaces of the package `geometry_msgs`.

/// A place in free space, in metres.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Point {
    /// Along the first axis.
    pub x: f64,
    /// Along the second axis.
    pub y: f64,
    /// Along the third axis.
    pub z: f64,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Point {
    fn default() -> Self {
        Self {
            x: Default::default(),
            y: Default::default(),
            z: Default::default(),
        }
    }
}

impl luna_ros2::Message for Point {
    const TYPE: &'static str = "geometry_msgs/msg/Point";
}

/// Place and orientation.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Pose {
    /// The place.
    pub position: Point,
    /// The orientation.
    pub orientation: Quaternion,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Pose {
    fn default() -> Self {
        Self {
            position: Default::default(),
            orientation: Default::default(),
        }
    }
}

impl luna_ros2::Message for Pose {
    const TYPE: &'static str = "geometry_msgs/msg/Pose";
}

/// A pose with its time and frame.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct PoseStamped {
    /// When and where.
    pub header: super::std_msgs::Header,
    /// The pose.
    pub pose: Pose,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for PoseStamped {
    fn default() -> Self {
        Self {
            header: Default::default(),
            pose: Default::default(),
        }
    }
}

impl luna_ros2::Message for PoseStamped {
    const TYPE: &'static str = "geometry_msgs/msg/PoseStamped";
}

/// A pose with its uncertainty.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct PoseWithCovariance {
    /// The pose.
    pub pose: Pose,
    /// Rows of the covariance of x, y, z and the rotations about them.
    #[serde(with = "luna_ros2::big_array")]
    pub covariance: [f64; 36],
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for PoseWithCovariance {
    fn default() -> Self {
        Self {
            pose: Default::default(),
            covariance: std::array::from_fn(|_| Default::default()),
        }
    }
}

impl luna_ros2::Message for PoseWithCovariance {
    const TYPE: &'static str = "geometry_msgs/msg/PoseWithCovariance";
}

/// An orientation in free space; no rotation if not stated.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Quaternion {
    /// First imaginary part.
    pub x: f64,
    /// Second imaginary part.
    pub y: f64,
    /// Third imaginary part.
    pub z: f64,
    /// Real part.
    pub w: f64,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Quaternion {
    fn default() -> Self {
        Self {
            x: 0.0,
            y: 0.0,
            z: 0.0,
            w: 1.0,
        }
    }
}

impl luna_ros2::Message for Quaternion {
    const TYPE: &'static str = "geometry_msgs/msg/Quaternion";
}

/// A change of frame.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Transform {
    /// The shift in metres.
    pub translation: Vector3,
    /// The rotation.
    pub rotation: Quaternion,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Transform {
    fn default() -> Self {
        Self {
            translation: Default::default(),
            rotation: Default::default(),
        }
    }
}

impl luna_ros2::Message for Transform {
    const TYPE: &'static str = "geometry_msgs/msg/Transform";
}

/// A change from the frame of the header to a child frame.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct TransformStamped {
    /// When, and from which frame.
    pub header: super::std_msgs::Header,
    /// To which frame.
    pub child_frame_id: std::string::String,
    /// The change.
    pub transform: Transform,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for TransformStamped {
    fn default() -> Self {
        Self {
            header: Default::default(),
            child_frame_id: Default::default(),
            transform: Default::default(),
        }
    }
}

impl luna_ros2::Message for TransformStamped {
    const TYPE: &'static str = "geometry_msgs/msg/TransformStamped";
}

/// A velocity.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Twist {
    /// In m/s.
    pub linear: Vector3,
    /// In rad/s, about each axis.
    pub angular: Vector3,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Twist {
    fn default() -> Self {
        Self {
            linear: Default::default(),
            angular: Default::default(),
        }
    }
}

impl luna_ros2::Message for Twist {
    const TYPE: &'static str = "geometry_msgs/msg/Twist";
}

/// A velocity with its time and frame.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct TwistStamped {
    /// When and where.
    pub header: super::std_msgs::Header,
    /// The velocity.
    pub twist: Twist,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for TwistStamped {
    fn default() -> Self {
        Self {
            header: Default::default(),
            twist: Default::default(),
        }
    }
}

impl luna_ros2::Message for TwistStamped {
    const TYPE: &'static str = "geometry_msgs/msg/TwistStamped";
}

/// A velocity with its uncertainty.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct TwistWithCovariance {
    /// The velocity.
    pub twist: Twist,
    /// Rows of the covariance of the six parts.
    #[serde(with = "luna_ros2::big_array")]
    pub covariance: [f64; 36],
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for TwistWithCovariance {
    fn default() -> Self {
        Self {
            twist: Default::default(),
            covariance: std::array::from_fn(|_| Default::default()),
        }
    }
}

impl luna_ros2::Message for TwistWithCovariance {
    const TYPE: &'static str = "geometry_msgs/msg/TwistWithCovariance";
}

/// A vector in free space.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Vector3 {
    /// Along the first axis.
    pub x: f64,
    /// Along the second axis.
    pub y: f64,
    /// Along the third axis.
    pub z: f64,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Vector3 {
    fn default() -> Self {
        Self {
            x: Default::default(),
            y: Default::default(),
            z: Default::default(),
        }
    }
}

impl luna_ros2::Message for Vector3 {
    const TYPE: &'static str = "geometry_msgs/msg/Vector3";
}

/// A force and a torque.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Wrench {
    /// In newtons.
    pub force: Vector3,
    /// In newton metres.
    pub torque: Vector3,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Wrench {
    fn default() -> Self {
        Self {
            force: Default::default(),
            torque: Default::default(),
        }
    }
}

impl luna_ros2::Message for Wrench {
    const TYPE: &'static str = "geometry_msgs/msg/Wrench";
}
