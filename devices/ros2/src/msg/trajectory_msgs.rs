//! Interfaces of the package `trajectory_msgs`.

luna_ros2::message! {
    /// The motion of several joints.
    #[derive(Default)]
    pub struct JointTrajectory: "trajectory_msgs/msg/JointTrajectory" {
        /// When it starts.
        pub header: super::std_msgs::Header,
        /// The joints, in the order of the points' lists.
        pub joint_names: Vec<std::string::String>,
        /// The points, by rising time.
        pub points: Vec<JointTrajectoryPoint>,
    }
}

luna_ros2::message! {
    /// A point of a trajectory. Each list is as long as the names of the joints, or empty.
    #[derive(Default)]
    pub struct JointTrajectoryPoint: "trajectory_msgs/msg/JointTrajectoryPoint" {
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
}
