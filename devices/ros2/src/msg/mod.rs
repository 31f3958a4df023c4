//! The usual messages and services, one module for each package of ROS 2.
//!
//! They are generated from the files in this crate's folder `msg`, which has the same layout as
//! those of [`generate`](crate::generate). Messages of numbers alone are `Copy`. Those with a
//! `String` or `Vec` have heap: on the real-time path define the same message with
//! `luna_ros2::arrayvec`, under the same name of ROS 2.
//!
//! ```
//! use luna_ros2::arrayvec::{ArrayString, ArrayVec};
//! use luna_ros2::msg::builtin_interfaces::Time;
//!
//! luna_ros2::message! {
//!     /// The header, without heap.
//!     pub struct Header { pub stamp: Time, pub frame_id: ArrayString<32> }
//! }
//! luna_ros2::message! {
//!     /// The state of six joints at most.
//!     pub struct Joints: "sensor_msgs/msg/JointState" {
//!         pub header: Header,
//!         pub name: ArrayVec<ArrayString<32>, 6>,
//!         pub position: ArrayVec<f64, 6>,
//!         pub velocity: ArrayVec<f64, 6>,
//!         pub effort: ArrayVec<f64, 6>,
//!     }
//! }
//! ```

pub mod builtin_interfaces;
pub mod geometry_msgs;
pub mod rcl_interfaces;
pub mod rosgraph_msgs;
pub mod sensor_msgs;
pub mod std_msgs;
pub mod std_srvs;
pub mod trajectory_msgs;

use builtin_interfaces::{Duration, Time};

const NANOS: i64 = 1_000_000_000;

impl Time {
    /// From nanoseconds since the epoch of its clock, which may be negative. Saturates in 2038, as
    /// the type does.
    ///
    /// ```
    /// use luna_ros2::msg::builtin_interfaces::Time;
    ///
    /// let time = Time::from_nanos(-1);
    /// assert_eq!((time.sec, time.nanosec), (-1, 999_999_999));
    /// assert_eq!(time.to_nanos(), -1);
    /// ```
    pub fn from_nanos(nanos: i64) -> Self {
        let (sec, nanosec) = split(nanos);
        Self { sec, nanosec }
    }

    /// In nanoseconds since the epoch of its clock.
    pub fn to_nanos(self) -> i64 {
        i64::from(self.sec) * NANOS + i64::from(self.nanosec)
    }
}

impl Duration {
    /// From nanoseconds, which may be negative. Saturates after 68 years.
    pub fn from_nanos(nanos: i64) -> Self {
        let (sec, nanosec) = split(nanos);
        Self { sec, nanosec }
    }

    /// In nanoseconds.
    pub fn to_nanos(self) -> i64 {
        i64::from(self.sec) * NANOS + i64::from(self.nanosec)
    }
}

fn split(nanos: i64) -> (i32, u32) {
    let (seconds, rest) = (nanos.div_euclid(NANOS), nanos.rem_euclid(NANOS));
    match i32::try_from(seconds) {
        Ok(seconds) => (seconds, rest as u32),
        Err(_) if seconds < 0 => (i32::MIN, 0),
        Err(_) => (i32::MAX, 999_999_999),
    }
}
