//! Interfaces of the package `rcl_interfaces`.

luna_ros2::message! {
    /// What a number may be.
    #[derive(Copy, Default)]
    pub struct FloatingPointRange: "rcl_interfaces/msg/FloatingPointRange" {
        /// The least.
        pub from_value: f64,
        /// The most.
        pub to_value: f64,
        /// Steps between; 0 for all in between.
        pub step: f64,
    }
}

luna_ros2::message! {
    /// What a whole number may be.
    #[derive(Copy, Default)]
    pub struct IntegerRange: "rcl_interfaces/msg/IntegerRange" {
        /// The least.
        pub from_value: i64,
        /// The most.
        pub to_value: i64,
        /// Steps between; 0 for all in between.
        pub step: u64,
    }
}

luna_ros2::message! {
    /// Names of parameters.
    #[derive(Default)]
    pub struct ListParametersResult: "rcl_interfaces/msg/ListParametersResult" {
        /// The names.
        pub names: Vec<std::string::String>,
        /// The prefixes that they have.
        pub prefixes: Vec<std::string::String>,
    }
}

luna_ros2::message! {
    /// A parameter.
    #[derive(Default)]
    pub struct Parameter: "rcl_interfaces/msg/Parameter" {
        /// Its name.
        pub name: std::string::String,
        /// Its value.
        pub value: ParameterValue,
    }
}

luna_ros2::message! {
    /// What is known of a parameter.
    pub struct ParameterDescriptor: "rcl_interfaces/msg/ParameterDescriptor" {
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

luna_ros2::message! {
    /// A parameter's value: the member that the type says.
    #[derive(Default)]
    pub struct ParameterValue: "rcl_interfaces/msg/ParameterValue" {
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

luna_ros2::message! {
    /// What became of a set.
    #[derive(Default)]
    pub struct SetParametersResult: "rcl_interfaces/msg/SetParametersResult" {
        /// Whether it was taken.
        pub successful: bool,
        /// Why not.
        pub reason: std::string::String,
    }
}

luna_ros2::message! {
    /// A request of `rcl_interfaces/DescribeParameters`.
    #[derive(Default)]
    pub struct DescribeParametersRequest {
        /// Whose descriptions.
        pub names: Vec<std::string::String>,
    }
}

luna_ros2::message! {
    /// A reply of `rcl_interfaces/DescribeParameters`.
    #[derive(Default)]
    pub struct DescribeParametersReply {
        /// As many, in the same order.
        pub descriptors: Vec<ParameterDescriptor>,
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

luna_ros2::message! {
    /// A request of `rcl_interfaces/GetParameterTypes`.
    #[derive(Default)]
    pub struct GetParameterTypesRequest {
        /// Whose types.
        pub names: Vec<std::string::String>,
    }
}

luna_ros2::message! {
    /// A reply of `rcl_interfaces/GetParameterTypes`.
    #[derive(Default)]
    pub struct GetParameterTypesReply {
        /// As many, in the same order: see the constants of `ParameterValue`.
        pub types: Vec<u8>,
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

luna_ros2::message! {
    /// A request of `rcl_interfaces/GetParameters`.
    #[derive(Default)]
    pub struct GetParametersRequest {
        /// Whose values.
        pub names: Vec<std::string::String>,
    }
}

luna_ros2::message! {
    /// A reply of `rcl_interfaces/GetParameters`.
    #[derive(Default)]
    pub struct GetParametersReply {
        /// As many, in the same order.
        pub values: Vec<ParameterValue>,
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

luna_ros2::message! {
    /// A request of `rcl_interfaces/ListParameters`.
    #[derive(Default)]
    pub struct ListParametersRequest {
        /// Whose prefixes; of all if there are none.
        pub prefixes: Vec<std::string::String>,
        /// How many parts a name may have below its prefix; 0 for any.
        pub depth: u64,
    }
}

impl ListParametersRequest {
    /// Any depth.
    pub const DEPTH_RECURSIVE: u64 = 0;
}

luna_ros2::message! {
    /// A reply of `rcl_interfaces/ListParameters`.
    #[derive(Default)]
    pub struct ListParametersReply {
        /// What was found.
        pub result: ListParametersResult,
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

luna_ros2::message! {
    /// A request of `rcl_interfaces/SetParameters`.
    #[derive(Default)]
    pub struct SetParametersRequest {
        /// Names and values.
        pub parameters: Vec<Parameter>,
    }
}

luna_ros2::message! {
    /// A reply of `rcl_interfaces/SetParameters`.
    #[derive(Default)]
    pub struct SetParametersReply {
        /// As many, in the same order.
        pub results: Vec<SetParametersResult>,
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

luna_ros2::message! {
    /// A request of `rcl_interfaces/SetParametersAtomically`.
    #[derive(Default)]
    pub struct SetParametersAtomicallyRequest {
        /// Names and values.
        pub parameters: Vec<Parameter>,
    }
}

luna_ros2::message! {
    /// A reply of `rcl_interfaces/SetParametersAtomically`.
    #[derive(Default)]
    pub struct SetParametersAtomicallyReply {
        /// Of all together.
        pub result: SetParametersResult,
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
