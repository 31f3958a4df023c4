//! Interfaces of the package `std_msgs`.

luna_ros2::message! {
    /// One value of type `bool`.
    #[derive(Copy, Default)]
    pub struct Bool: "std_msgs/msg/Bool" {
        /// The value.
        pub data: bool,
    }
}

luna_ros2::message! {
    /// One value of type `byte`.
    #[derive(Copy, Default)]
    pub struct Byte: "std_msgs/msg/Byte" {
        /// The value.
        pub data: u8,
    }
}

luna_ros2::message! {
    /// One value of type `char`.
    #[derive(Copy, Default)]
    pub struct Char: "std_msgs/msg/Char" {
        /// The value.
        pub data: u8,
    }
}

luna_ros2::message! {
    /// A color with its opacity, each part from 0 to 1.
    #[derive(Copy, Default)]
    pub struct ColorRGBA: "std_msgs/msg/ColorRGBA" {
        /// Red.
        pub r: f32,
        /// Green.
        pub g: f32,
        /// Blue.
        pub b: f32,
        /// Opacity.
        pub a: f32,
    }
}

luna_ros2::message! {
    /// An event without a value.
    #[derive(Copy, Default)]
    pub struct Empty: "std_msgs/msg/Empty" {
        /// Without meaning.
        pub structure_needs_at_least_one_member: u8,
    }
}

luna_ros2::message! {
    /// One value of type `float32`.
    #[derive(Copy, Default)]
    pub struct Float32: "std_msgs/msg/Float32" {
        /// The value.
        pub data: f32,
    }
}

luna_ros2::message! {
    /// One value of type `float64`.
    #[derive(Copy, Default)]
    pub struct Float64: "std_msgs/msg/Float64" {
        /// The value.
        pub data: f64,
    }
}

luna_ros2::message! {
    /// Numbers in an array of several dimensions.
    #[derive(Default)]
    pub struct Float64MultiArray: "std_msgs/msg/Float64MultiArray" {
        /// How they lie.
        pub layout: MultiArrayLayout,
        /// The numbers.
        pub data: Vec<f64>,
    }
}

luna_ros2::message! {
    /// When and where data was taken.
    #[derive(Default)]
    pub struct Header: "std_msgs/msg/Header" {
        /// When.
        pub stamp: super::builtin_interfaces::Time,
        /// The frame of reference.
        pub frame_id: std::string::String,
    }
}

luna_ros2::message! {
    /// One value of type `int16`.
    #[derive(Copy, Default)]
    pub struct Int16: "std_msgs/msg/Int16" {
        /// The value.
        pub data: i16,
    }
}

luna_ros2::message! {
    /// One value of type `int32`.
    #[derive(Copy, Default)]
    pub struct Int32: "std_msgs/msg/Int32" {
        /// The value.
        pub data: i32,
    }
}

luna_ros2::message! {
    /// One value of type `int64`.
    #[derive(Copy, Default)]
    pub struct Int64: "std_msgs/msg/Int64" {
        /// The value.
        pub data: i64,
    }
}

luna_ros2::message! {
    /// One value of type `int8`.
    #[derive(Copy, Default)]
    pub struct Int8: "std_msgs/msg/Int8" {
        /// The value.
        pub data: i8,
    }
}

luna_ros2::message! {
    /// One dimension of an array.
    #[derive(Default)]
    pub struct MultiArrayDimension: "std_msgs/msg/MultiArrayDimension" {
        /// Its name.
        pub label: std::string::String,
        /// Its length in elements.
        pub size: u32,
        /// Elements from one index to the next of the dimension before.
        pub stride: u32,
    }
}

luna_ros2::message! {
    /// How an array of several dimensions lies in a list.
    #[derive(Default)]
    pub struct MultiArrayLayout: "std_msgs/msg/MultiArrayLayout" {
        /// The dimensions, the outermost first.
        pub dim: Vec<MultiArrayDimension>,
        /// Elements before the first.
        pub data_offset: u32,
    }
}

luna_ros2::message! {
    /// One value of type `string`.
    #[derive(Default)]
    pub struct String: "std_msgs/msg/String" {
        /// The value.
        pub data: std::string::String,
    }
}

luna_ros2::message! {
    /// One value of type `uint16`.
    #[derive(Copy, Default)]
    pub struct UInt16: "std_msgs/msg/UInt16" {
        /// The value.
        pub data: u16,
    }
}

luna_ros2::message! {
    /// One value of type `uint32`.
    #[derive(Copy, Default)]
    pub struct UInt32: "std_msgs/msg/UInt32" {
        /// The value.
        pub data: u32,
    }
}

luna_ros2::message! {
    /// One value of type `uint64`.
    #[derive(Copy, Default)]
    pub struct UInt64: "std_msgs/msg/UInt64" {
        /// The value.
        pub data: u64,
    }
}

luna_ros2::message! {
    /// One value of type `uint8`.
    #[derive(Copy, Default)]
    pub struct UInt8: "std_msgs/msg/UInt8" {
        /// The value.
        pub data: u8,
    }
}
