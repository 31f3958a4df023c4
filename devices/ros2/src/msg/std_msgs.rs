//! Interfaces of the package `std_msgs`.

/// One value of type `bool`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Bool {
    /// The value.
    pub data: bool,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Bool {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for Bool {
    const TYPE: &'static str = "std_msgs/msg/Bool";
}

/// One value of type `byte`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Byte {
    /// The value.
    pub data: u8,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Byte {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for Byte {
    const TYPE: &'static str = "std_msgs/msg/Byte";
}

/// One value of type `char`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Char {
    /// The value.
    pub data: u8,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Char {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for Char {
    const TYPE: &'static str = "std_msgs/msg/Char";
}

/// A color with its opacity, each part from 0 to 1.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct ColorRGBA {
    /// Red.
    pub r: f32,
    /// Green.
    pub g: f32,
    /// Blue.
    pub b: f32,
    /// Opacity.
    pub a: f32,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for ColorRGBA {
    fn default() -> Self {
        Self {
            r: Default::default(),
            g: Default::default(),
            b: Default::default(),
            a: Default::default(),
        }
    }
}

impl luna_ros2::Message for ColorRGBA {
    const TYPE: &'static str = "std_msgs/msg/ColorRGBA";
}

/// An event without a value.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Empty {
    /// Without meaning.
    pub structure_needs_at_least_one_member: u8,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Empty {
    fn default() -> Self {
        Self {
            structure_needs_at_least_one_member: 0,
        }
    }
}

impl luna_ros2::Message for Empty {
    const TYPE: &'static str = "std_msgs/msg/Empty";
}

/// One value of type `float32`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Float32 {
    /// The value.
    pub data: f32,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Float32 {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for Float32 {
    const TYPE: &'static str = "std_msgs/msg/Float32";
}

/// One value of type `float64`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Float64 {
    /// The value.
    pub data: f64,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Float64 {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for Float64 {
    const TYPE: &'static str = "std_msgs/msg/Float64";
}

/// Numbers in an array of several dimensions.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct Float64MultiArray {
    /// How they lie.
    pub layout: MultiArrayLayout,
    /// The numbers.
    pub data: Vec<f64>,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Float64MultiArray {
    fn default() -> Self {
        Self {
            layout: Default::default(),
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for Float64MultiArray {
    const TYPE: &'static str = "std_msgs/msg/Float64MultiArray";
}

/// When and where data was taken.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct Header {
    /// When.
    pub stamp: super::builtin_interfaces::Time,
    /// The frame of reference.
    pub frame_id: std::string::String,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Header {
    fn default() -> Self {
        Self {
            stamp: Default::default(),
            frame_id: Default::default(),
        }
    }
}

impl luna_ros2::Message for Header {
    const TYPE: &'static str = "std_msgs/msg/Header";
}

/// One value of type `int16`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Int16 {
    /// The value.
    pub data: i16,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Int16 {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for Int16 {
    const TYPE: &'static str = "std_msgs/msg/Int16";
}

/// One value of type `int32`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Int32 {
    /// The value.
    pub data: i32,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Int32 {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for Int32 {
    const TYPE: &'static str = "std_msgs/msg/Int32";
}

/// One value of type `int64`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Int64 {
    /// The value.
    pub data: i64,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Int64 {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for Int64 {
    const TYPE: &'static str = "std_msgs/msg/Int64";
}

/// One value of type `int8`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct Int8 {
    /// The value.
    pub data: i8,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Int8 {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for Int8 {
    const TYPE: &'static str = "std_msgs/msg/Int8";
}

/// One dimension of an array.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct MultiArrayDimension {
    /// Its name.
    pub label: std::string::String,
    /// Its length in elements.
    pub size: u32,
    /// Elements from one index to the next of the dimension before.
    pub stride: u32,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for MultiArrayDimension {
    fn default() -> Self {
        Self {
            label: Default::default(),
            size: Default::default(),
            stride: Default::default(),
        }
    }
}

impl luna_ros2::Message for MultiArrayDimension {
    const TYPE: &'static str = "std_msgs/msg/MultiArrayDimension";
}

/// How an array of several dimensions lies in a list.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct MultiArrayLayout {
    /// The dimensions, the outermost first.
    pub dim: Vec<MultiArrayDimension>,
    /// Elements before the first.
    pub data_offset: u32,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for MultiArrayLayout {
    fn default() -> Self {
        Self {
            dim: Default::default(),
            data_offset: Default::default(),
        }
    }
}

impl luna_ros2::Message for MultiArrayLayout {
    const TYPE: &'static str = "std_msgs/msg/MultiArrayLayout";
}

/// One value of type `string`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct String {
    /// The value.
    pub data: std::string::String,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for String {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for String {
    const TYPE: &'static str = "std_msgs/msg/String";
}

/// One value of type `uint16`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct UInt16 {
    /// The value.
    pub data: u16,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for UInt16 {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for UInt16 {
    const TYPE: &'static str = "std_msgs/msg/UInt16";
}

/// One value of type `uint32`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct UInt32 {
    /// The value.
    pub data: u32,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for UInt32 {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for UInt32 {
    const TYPE: &'static str = "std_msgs/msg/UInt32";
}

/// One value of type `uint64`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct UInt64 {
    /// The value.
    pub data: u64,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for UInt64 {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for UInt64 {
    const TYPE: &'static str = "std_msgs/msg/UInt64";
}

/// One value of type `uint8`.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct UInt8 {
    /// The value.
    pub data: u8,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for UInt8 {
    fn default() -> Self {
        Self {
            data: Default::default(),
        }
    }
}

impl luna_ros2::Message for UInt8 {
    const TYPE: &'static str = "std_msgs/msg/UInt8";
}
