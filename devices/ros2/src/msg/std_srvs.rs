//! Interfaces of the package `std_srvs`.

luna_ros2::message! {
    /// A request of `std_srvs/Empty`.
    #[derive(Copy, Default)]
    pub struct EmptyRequest {
        /// Without meaning.
        pub structure_needs_at_least_one_member: u8,
    }
}

luna_ros2::message! {
    /// A reply of `std_srvs/Empty`.
    #[derive(Copy, Default)]
    pub struct EmptyReply {
        /// Without meaning.
        pub structure_needs_at_least_one_member: u8,
    }
}

/// The service `std_srvs/srv/Empty`.
#[derive(Debug)]
pub enum Empty {}

impl luna_ros2::Service for Empty {
    type Request = EmptyRequest;
    type Reply = EmptyReply;
    const TYPE: &'static str = "std_srvs/srv/Empty";
}

luna_ros2::message! {
    /// A request of `std_srvs/SetBool`.
    #[derive(Copy, Default)]
    pub struct SetBoolRequest {
        /// On or off.
        pub data: bool,
    }
}

luna_ros2::message! {
    /// A reply of `std_srvs/SetBool`.
    #[derive(Default)]
    pub struct SetBoolReply {
        /// Whether it was done.
        pub success: bool,
        /// What happened, in words.
        pub message: std::string::String,
    }
}

/// The service `std_srvs/srv/SetBool`.
#[derive(Debug)]
pub enum SetBool {}

impl luna_ros2::Service for SetBool {
    type Request = SetBoolRequest;
    type Reply = SetBoolReply;
    const TYPE: &'static str = "std_srvs/srv/SetBool";
}

luna_ros2::message! {
    /// A request of `std_srvs/Trigger`.
    #[derive(Copy, Default)]
    pub struct TriggerRequest {
        /// Without meaning.
        pub structure_needs_at_least_one_member: u8,
    }
}

luna_ros2::message! {
    /// A reply of `std_srvs/Trigger`.
    #[derive(Default)]
    pub struct TriggerReply {
        /// Whether it was done.
        pub success: bool,
        /// What happened, in words.
        pub message: std::string::String,
    }
}

/// The service `std_srvs/srv/Trigger`.
#[derive(Debug)]
pub enum Trigger {}

impl luna_ros2::Service for Trigger {
    type Request = TriggerRequest;
    type Reply = TriggerReply;
    const TYPE: &'static str = "std_srvs/srv/Trigger";
}
