/// Interfaces of the package `tank_msgs`.
pub mod tank_msgs {
luna_ros2::message! {
    /// A tank.
    pub struct Tank: "tank_msgs/msg/Tank" {
        /// How full it is.
        pub state: u8,
        /// of the tank
        pub name: luna_ros2::arrayvec::ArrayString<16>,
        /// `levels`.
        pub levels: [f64; 3],
        /// `history`.
        #[serde(with = "luna_ros2::big_array")]
        pub history: [f64; 40],
        /// `alarms`.
        pub alarms: luna_ros2::arrayvec::ArrayVec<i16, 4>,
        /// `type`.
        pub r#type: bool,
        /// `valves`.
        pub valves: Vec<Valve>,
        /// `header`.
        pub header: luna_ros2::msg::std_msgs::Header,
        /// `place`.
        pub place: luna_ros2::msg::geometry_msgs::Point,
    }
}

impl Tank {
    /// `EMPTY`.
    pub const EMPTY: u8 = 0;
    /// to the brim
    pub const FULL: u8 = 2;
    /// `UNIT`.
    pub const UNIT: &'static str = "m # of water";
    /// `HALF`.
    pub const HALF: f32 = 0.5;
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Tank {
    fn default() -> Self {
        Self {
            state: 1,
            name: luna_ros2::arrayvec::ArrayString::from("main").unwrap_or_default(),
            levels: [1.0, 2.0, 3.0],
            history: std::array::from_fn(|_| Default::default()),
            alarms: Default::default(),
            r#type: Default::default(),
            valves: Default::default(),
            header: Default::default(),
            place: Default::default(),
        }
    }
}

luna_ros2::message! {
    /// A message of `tank_msgs/Valve`.
    #[derive(Copy, Default)]
    pub struct Valve: "tank_msgs/msg/Valve" {
        /// `open`.
        pub open: bool,
    }
}

luna_ros2::message! {
    /// A request of `tank_msgs/Fill`.
    #[derive(Copy, Default)]
    pub struct FillRequest {
        /// `to`.
        pub to: f64,
    }
}

luna_ros2::message! {
    /// A reply of `tank_msgs/Fill`.
    #[derive(Copy, Default)]
    pub struct FillReply {
        /// Without meaning.
        pub structure_needs_at_least_one_member: u8,
    }
}

/// The service `tank_msgs/srv/Fill`.
#[derive(Debug)]
pub enum Fill {}

impl luna_ros2::Service for Fill {
    type Request = FillRequest;
    type Reply = FillReply;
    const TYPE: &'static str = "tank_msgs/srv/Fill";
}
}
