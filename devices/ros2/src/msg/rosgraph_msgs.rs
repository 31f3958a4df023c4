//! Interfaces of the package `rosgraph_msgs`.

luna_ros2::message! {
    /// The time of a simulation.
    #[derive(Copy, Default)]
    pub struct Clock: "rosgraph_msgs/msg/Clock" {
        /// Now.
        pub clock: super::builtin_interfaces::Time,
    }
}
