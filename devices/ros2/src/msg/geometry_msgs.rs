//! Interfaces of the package `geometry_msgs`.

luna_ros2::message! {
    /// A place in free space, in metres.
    #[derive(Copy, Default)]
    pub struct Point: "geometry_msgs/msg/Point" {
        /// Along the first axis.
        pub x: f64,
        /// Along the second axis.
        pub y: f64,
        /// Along the third axis.
        pub z: f64,
    }
}

luna_ros2::message! {
    /// Place and orientation.
    #[derive(Copy, Default)]
    pub struct Pose: "geometry_msgs/msg/Pose" {
        /// The place.
        pub position: Point,
        /// The orientation.
        pub orientation: Quaternion,
    }
}

luna_ros2::message! {
    /// A pose with its time and frame.
    #[derive(Default)]
    pub struct PoseStamped: "geometry_msgs/msg/PoseStamped" {
        /// When and where.
        pub header: super::std_msgs::Header,
        /// The pose.
        pub pose: Pose,
    }
}

luna_ros2::message! {
    /// A pose with its uncertainty.
    #[derive(Copy)]
    pub struct PoseWithCovariance: "geometry_msgs/msg/PoseWithCovariance" {
        /// The pose.
        pub pose: Pose,
        /// Rows of the covariance of x, y, z and the rotations about them.
        #[serde(with = "luna_ros2::big_array")]
        pub covariance: [f64; 36],
    }
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

luna_ros2::message! {
    /// An orientation in free space; no rotation if not stated.
    #[derive(Copy)]
    pub struct Quaternion: "geometry_msgs/msg/Quaternion" {
        /// First imaginary part.
        pub x: f64,
        /// Second imaginary part.
        pub y: f64,
        /// Third imaginary part.
        pub z: f64,
        /// Real part.
        pub w: f64,
    }
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

luna_ros2::message! {
    /// A change of frame.
    #[derive(Copy, Default)]
    pub struct Transform: "geometry_msgs/msg/Transform" {
        /// The shift in metres.
        pub translation: Vector3,
        /// The rotation.
        pub rotation: Quaternion,
    }
}

luna_ros2::message! {
    /// A change from the frame of the header to a child frame.
    #[derive(Default)]
    pub struct TransformStamped: "geometry_msgs/msg/TransformStamped" {
        /// When, and from which frame.
        pub header: super::std_msgs::Header,
        /// To which frame.
        pub child_frame_id: std::string::String,
        /// The change.
        pub transform: Transform,
    }
}

luna_ros2::message! {
    /// A velocity.
    #[derive(Copy, Default)]
    pub struct Twist: "geometry_msgs/msg/Twist" {
        /// In m/s.
        pub linear: Vector3,
        /// In rad/s, about each axis.
        pub angular: Vector3,
    }
}

luna_ros2::message! {
    /// A velocity with its time and frame.
    #[derive(Default)]
    pub struct TwistStamped: "geometry_msgs/msg/TwistStamped" {
        /// When and where.
        pub header: super::std_msgs::Header,
        /// The velocity.
        pub twist: Twist,
    }
}

luna_ros2::message! {
    /// A velocity with its uncertainty.
    #[derive(Copy)]
    pub struct TwistWithCovariance: "geometry_msgs/msg/TwistWithCovariance" {
        /// The velocity.
        pub twist: Twist,
        /// Rows of the covariance of the six parts.
        #[serde(with = "luna_ros2::big_array")]
        pub covariance: [f64; 36],
    }
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

luna_ros2::message! {
    /// A vector in free space.
    #[derive(Copy, Default)]
    pub struct Vector3: "geometry_msgs/msg/Vector3" {
        /// Along the first axis.
        pub x: f64,
        /// Along the second axis.
        pub y: f64,
        /// Along the third axis.
        pub z: f64,
    }
}

luna_ros2::message! {
    /// A force and a torque.
    #[derive(Copy, Default)]
    pub struct Wrench: "geometry_msgs/msg/Wrench" {
        /// In newtons.
        pub force: Vector3,
        /// In newton metres.
        pub torque: Vector3,
    }
}
