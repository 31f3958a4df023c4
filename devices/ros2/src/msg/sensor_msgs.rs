//! Interfaces of the package `sensor_msgs`.

luna_ros2::message! {
    /// What an inertial sensor measures. A covariance whose first element is -1 belongs to no
    /// estimate.
    #[derive(Default)]
    pub struct Imu: "sensor_msgs/msg/Imu" {
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
}

luna_ros2::message! {
    /// The state of joints. Each list is as long as the names, or empty if that quantity is not
    /// known.
    #[derive(Default)]
    pub struct JointState: "sensor_msgs/msg/JointState" {
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
}
