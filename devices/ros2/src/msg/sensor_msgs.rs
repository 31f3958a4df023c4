//! Interfaces of the package `sensor_msgs`.

/// What an inertial sensor measures. A covariance whose first element is -1 belongs to no estimate.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct Imu {
    /// When and where.
    pub header: super::std_msgs::Header,
    /// The orientation.
    pub orientation: super::geometry_msgs::Quaternion,
    /// Rows of its covariance.
    pub orientation_covariance: [f64; 9],
    /// In rad/s.
    pub angular_velocity: super::geometry_msgs::Vector3,
    /// Rows of its covariance.
    pub angular_velocity_covariance: [f64; 9],
    /// In m/s².
    pub linear_acceleration: super::geometry_msgs::Vector3,
    /// Rows of its covariance.
    pub linear_acceleration_covariance: [f64; 9],
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Imu {
    fn default() -> Self {
        Self {
            header: Default::default(),
            orientation: Default::default(),
            orientation_covariance: std::array::from_fn(|_| Default::default()),
            angular_velocity: Default::default(),
            angular_velocity_covariance: std::array::from_fn(|_| Default::default()),
            linear_acceleration: Default::default(),
            linear_acceleration_covariance: std::array::from_fn(|_| Default::default()),
        }
    }
}

impl luna_ros2::Message for Imu {
    const TYPE: &'static str = "sensor_msgs/msg/Imu";
}

/// The state of joints. Each list is as long as the names, or empty if that quantity is not known.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct JointState {
    /// When, and where.
    pub header: super::std_msgs::Header,
    /// The joints.
    pub name: Vec<std::string::String>,
    /// Angles in rad, or places in m.
    pub position: Vec<f64>,
    /// In rad/s or m/s.
    pub velocity: Vec<f64>,
    /// Torques in Nm, or forces in N.
    pub effort: Vec<f64>,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for JointState {
    fn default() -> Self {
        Self {
            header: Default::default(),
            name: Default::default(),
            position: Default::default(),
            velocity: Default::default(),
            effort: Default::default(),
        }
    }
}

impl luna_ros2::Message for JointState {
    const TYPE: &'static str = "sensor_msgs/msg/JointState";
}
