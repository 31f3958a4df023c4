//! Interfaces of the package `trajectory_msgs`.

/// The motion of several joints.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct JointTrajectory {
    /// When it starts.
    pub header: super::std_msgs::Header,
    /// The joints, in the order of the points' lists.
    pub joint_names: Vec<std::string::String>,
    /// The points, by rising time.
    pub points: Vec<JointTrajectoryPoint>,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for JointTrajectory {
    fn default() -> Self {
        Self {
            header: Default::default(),
            joint_names: Default::default(),
            points: Default::default(),
        }
    }
}

impl luna_ros2::Message for JointTrajectory {
    const TYPE: &'static str = "trajectory_msgs/msg/JointTrajectory";
}

/// A point of a trajectory. Each list is as long as the names of the joints, or empty.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct JointTrajectoryPoint {
    /// In rad or m.
    pub positions: Vec<f64>,
    /// In rad/s or m/s.
    pub velocities: Vec<f64>,
    /// In rad/s² or m/s².
    pub accelerations: Vec<f64>,
    /// In Nm or N.
    pub effort: Vec<f64>,
    /// From the start of the trajectory.
    pub time_from_start: super::builtin_interfaces::Duration,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for JointTrajectoryPoint {
    fn default() -> Self {
        Self {
            positions: Default::default(),
            velocities: Default::default(),
            accelerations: Default::default(),
            effort: Default::default(),
            time_from_start: Default::default(),
        }
    }
}

impl luna_ros2::Message for JointTrajectoryPoint {
    const TYPE: &'static str = "trajectory_msgs/msg/JointTrajectoryPoint";
}
