//! Interfaces of the package `rcl_interfaces`.

/// What a number may be.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct FloatingPointRange {
    /// The least.
    pub from_value: f64,
    /// The most.
    pub to_value: f64,
    /// Steps between; 0 for all in between.
    pub step: f64,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for FloatingPointRange {
    fn default() -> Self {
        Self {
            from_value: Default::default(),
            to_value: Default::default(),
            step: Default::default(),
        }
    }
}

impl luna_ros2::Message for FloatingPointRange {
    const TYPE: &'static str = "rcl_interfaces/msg/FloatingPointRange";
}

/// What a whole number may be.
#[derive(
    Debug, Clone, Copy, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize,
)]
#[serde(crate = "luna_ros2::serde")]
pub struct IntegerRange {
    /// The least.
    pub from_value: i64,
    /// The most.
    pub to_value: i64,
    /// Steps between; 0 for all in between.
    pub step: u64,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for IntegerRange {
    fn default() -> Self {
        Self {
            from_value: Default::default(),
            to_value: Default::default(),
            step: Default::default(),
        }
    }
}

impl luna_ros2::Message for IntegerRange {
    const TYPE: &'static str = "rcl_interfaces/msg/IntegerRange";
}

/// Names of parameters.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct ListParametersResult {
    /// The names.
    pub names: Vec<std::string::String>,
    /// The prefixes that they have.
    pub prefixes: Vec<std::string::String>,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for ListParametersResult {
    fn default() -> Self {
        Self {
            names: Default::default(),
            prefixes: Default::default(),
        }
    }
}

impl luna_ros2::Message for ListParametersResult {
    const TYPE: &'static str = "rcl_interfaces/msg/ListParametersResult";
}

/// A parameter.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct Parameter {
    /// Its name.
    pub name: std::string::String,
    /// Its value.
    pub value: ParameterValue,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for Parameter {
    fn default() -> Self {
        Self {
            name: Default::default(),
            value: Default::default(),
        }
    }
}

impl luna_ros2::Message for Parameter {
    const TYPE: &'static str = "rcl_interfaces/msg/Parameter";
}

/// What is known of a parameter.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct ParameterDescriptor {
    /// Its name.
    pub name: std::string::String,
    /// Its type: see the constants of `ParameterValue`.
    pub r#type: u8,
    /// What it is.
    pub description: std::string::String,
    /// What else it has to fulfil.
    pub additional_constraints: std::string::String,
    /// Whether it cannot be set.
    pub read_only: bool,
    /// Whether its type may change.
    pub dynamic_typing: bool,
    /// Its range, if it is a number and has one.
    pub floating_point_range: luna_ros2::arrayvec::ArrayVec<FloatingPointRange, 1>,
    /// Its range, if it is a whole number and has one.
    pub integer_range: luna_ros2::arrayvec::ArrayVec<IntegerRange, 1>,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for ParameterDescriptor {
    fn default() -> Self {
        Self {
            name: Default::default(),
            r#type: Default::default(),
            description: Default::default(),
            additional_constraints: Default::default(),
            read_only: false,
            dynamic_typing: false,
            floating_point_range: Default::default(),
            integer_range: Default::default(),
        }
    }
}

impl luna_ros2::Message for ParameterDescriptor {
    const TYPE: &'static str = "rcl_interfaces/msg/ParameterDescriptor";
}

/// A parameter's value: the member that the type says.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct ParameterValue {
    /// Which member it is: see the constants.
    pub r#type: u8,
    /// If it is a bool.
    pub bool_value: bool,
    /// If it is a whole number.
    pub integer_value: i64,
    /// If it is a number.
    pub double_value: f64,
    /// If it is text.
    pub string_value: std::string::String,
    /// If it is bytes.
    pub byte_array_value: Vec<u8>,
    /// If it is a list of bools.
    pub bool_array_value: Vec<bool>,
    /// If it is a list of whole numbers.
    pub integer_array_value: Vec<i64>,
    /// If it is a list of numbers.
    pub double_array_value: Vec<f64>,
    /// If it is a list of texts.
    pub string_array_value: Vec<std::string::String>,
}

impl ParameterValue {
    /// There is no such parameter.
    pub const NOT_SET: u8 = 0;
    /// `bool_value`.
    pub const BOOL: u8 = 1;
    /// `integer_value`.
    pub const INTEGER: u8 = 2;
    /// `double_value`.
    pub const DOUBLE: u8 = 3;
    /// `string_value`.
    pub const STRING: u8 = 4;
    /// `byte_array_value`.
    pub const BYTE_ARRAY: u8 = 5;
    /// `bool_array_value`.
    pub const BOOL_ARRAY: u8 = 6;
    /// `integer_array_value`.
    pub const INTEGER_ARRAY: u8 = 7;
    /// `double_array_value`.
    pub const DOUBLE_ARRAY: u8 = 8;
    /// `string_array_value`.
    pub const STRING_ARRAY: u8 = 9;
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for ParameterValue {
    fn default() -> Self {
        Self {
            r#type: Default::default(),
            bool_value: Default::default(),
            integer_value: Default::default(),
            double_value: Default::default(),
            string_value: Default::default(),
            byte_array_value: Default::default(),
            bool_array_value: Default::default(),
            integer_array_value: Default::default(),
            double_array_value: Default::default(),
            string_array_value: Default::default(),
        }
    }
}

impl luna_ros2::Message for ParameterValue {
    const TYPE: &'static str = "rcl_interfaces/msg/ParameterValue";
}

/// What became of a set.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct SetParametersResult {
    /// Whether it was taken.
    pub successful: bool,
    /// Why not.
    pub reason: std::string::String,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for SetParametersResult {
    fn default() -> Self {
        Self {
            successful: Default::default(),
            reason: Default::default(),
        }
    }
}

impl luna_ros2::Message for SetParametersResult {
    const TYPE: &'static str = "rcl_interfaces/msg/SetParametersResult";
}

/// A request of `rcl_interfaces/DescribeParameters`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct DescribeParametersRequest {
    /// Whose descriptions.
    pub names: Vec<std::string::String>,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for DescribeParametersRequest {
    fn default() -> Self {
        Self {
            names: Default::default(),
        }
    }
}

/// A reply of `rcl_interfaces/DescribeParameters`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct DescribeParametersReply {
    /// As many, in the same order.
    pub descriptors: Vec<ParameterDescriptor>,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for DescribeParametersReply {
    fn default() -> Self {
        Self {
            descriptors: Default::default(),
        }
    }
}

/// The service `rcl_interfaces/srv/DescribeParameters`.
#[derive(Debug)]
pub enum DescribeParameters {}

impl luna_ros2::Service for DescribeParameters {
    type Request = DescribeParametersRequest;
    type Reply = DescribeParametersReply;
    const TYPE: &'static str = "rcl_interfaces/srv/DescribeParameters";
}

/// A request of `rcl_interfaces/GetParameterTypes`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct GetParameterTypesRequest {
    /// Whose types.
    pub names: Vec<std::string::String>,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for GetParameterTypesRequest {
    fn default() -> Self {
        Self {
            names: Default::default(),
        }
    }
}

/// A reply of `rcl_interfaces/GetParameterTypes`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct GetParameterTypesReply {
    /// As many, in the same order: see the constants of `ParameterValue`.
    pub types: Vec<u8>,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for GetParameterTypesReply {
    fn default() -> Self {
        Self {
            types: Default::default(),
        }
    }
}

/// The service `rcl_interfaces/srv/GetParameterTypes`.
#[derive(Debug)]
pub enum GetParameterTypes {}

impl luna_ros2::Service for GetParameterTypes {
    type Request = GetParameterTypesRequest;
    type Reply = GetParameterTypesReply;
    const TYPE: &'static str = "rcl_interfaces/srv/GetParameterTypes";
}

/// A request of `rcl_interfaces/GetParameters`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct GetParametersRequest {
    /// Whose values.
    pub names: Vec<std::string::String>,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for GetParametersRequest {
    fn default() -> Self {
        Self {
            names: Default::default(),
        }
    }
}

/// A reply of `rcl_interfaces/GetParameters`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct GetParametersReply {
    /// As many, in the same order.
    pub values: Vec<ParameterValue>,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for GetParametersReply {
    fn default() -> Self {
        Self {
            values: Default::default(),
        }
    }
}

/// The service `rcl_interfaces/srv/GetParameters`.
#[derive(Debug)]
pub enum GetParameters {}

impl luna_ros2::Service for GetParameters {
    type Request = GetParametersRequest;
    type Reply = GetParametersReply;
    const TYPE: &'static str = "rcl_interfaces/srv/GetParameters";
}

/// A request of `rcl_interfaces/ListParameters`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct ListParametersRequest {
    /// Whose prefixes; of all if there are none.
    pub prefixes: Vec<std::string::String>,
    /// How many parts a name may have below its prefix; 0 for any.
    pub depth: u64,
}

impl ListParametersRequest {
    /// Any depth.
    pub const DEPTH_RECURSIVE: u64 = 0;
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for ListParametersRequest {
    fn default() -> Self {
        Self {
            prefixes: Default::default(),
            depth: Default::default(),
        }
    }
}

/// A reply of `rcl_interfaces/ListParameters`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct ListParametersReply {
    /// What was found.
    pub result: ListParametersResult,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for ListParametersReply {
    fn default() -> Self {
        Self {
            result: Default::default(),
        }
    }
}

/// The service `rcl_interfaces/srv/ListParameters`.
#[derive(Debug)]
pub enum ListParameters {}

impl luna_ros2::Service for ListParameters {
    type Request = ListParametersRequest;
    type Reply = ListParametersReply;
    const TYPE: &'static str = "rcl_interfaces/srv/ListParameters";
}

/// A request of `rcl_interfaces/SetParameters`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct SetParametersRequest {
    /// Names and values.
    pub parameters: Vec<Parameter>,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for SetParametersRequest {
    fn default() -> Self {
        Self {
            parameters: Default::default(),
        }
    }
}

/// A reply of `rcl_interfaces/SetParameters`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct SetParametersReply {
    /// As many, in the same order.
    pub results: Vec<SetParametersResult>,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for SetParametersReply {
    fn default() -> Self {
        Self {
            results: Default::default(),
        }
    }
}

/// The service `rcl_interfaces/srv/SetParameters`.
#[derive(Debug)]
pub enum SetParameters {}

impl luna_ros2::Service for SetParameters {
    type Request = SetParametersRequest;
    type Reply = SetParametersReply;
    const TYPE: &'static str = "rcl_interfaces/srv/SetParameters";
}

/// A request of `rcl_interfaces/SetParametersAtomically`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct SetParametersAtomicallyRequest {
    /// Names and values.
    pub parameters: Vec<Parameter>,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for SetParametersAtomicallyRequest {
    fn default() -> Self {
        Self {
            parameters: Default::default(),
        }
    }
}

/// A reply of `rcl_interfaces/SetParametersAtomically`.
#[derive(Debug, Clone, PartialEq, luna_ros2::serde::Serialize, luna_ros2::serde::Deserialize)]
#[serde(crate = "luna_ros2::serde")]
pub struct SetParametersAtomicallyReply {
    /// Of all together.
    pub result: SetParametersResult,
}

#[allow(clippy::derivable_impls, reason = "generated")]
impl Default for SetParametersAtomicallyReply {
    fn default() -> Self {
        Self {
            result: Default::default(),
        }
    }
}

/// The service `rcl_interfaces/srv/SetParametersAtomically`.
#[derive(Debug)]
pub enum SetParametersAtomically {}

impl luna_ros2::Service for SetParametersAtomically {
    type Request = SetParametersAtomicallyRequest;
    type Reply = SetParametersAtomicallyReply;
    const TYPE: &'static str = "rcl_interfaces/srv/SetParametersAtomically";
}
