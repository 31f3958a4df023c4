//! Interfaces of the package `builtin_interfaces`.

luna_ros2::message! {
    /// A span of time. A negative one has negative seconds, and counts nanoseconds up from them.
    #[derive(Copy, Default)]
    pub struct Duration: "builtin_interfaces/msg/Duration" {
        /// Whole seconds.
        pub sec: i32,
        /// The rest, below 1 000 000 000.
        pub nanosec: u32,
    }
}

luna_ros2::message! {
    /// A point in time: seconds and nanoseconds since the epoch of its clock.
    #[derive(Copy, Default)]
    pub struct Time: "builtin_interfaces/msg/Time" {
        /// Whole seconds.
        pub sec: i32,
        /// The rest, below 1 000 000 000.
        pub nanosec: u32,
    }
}
