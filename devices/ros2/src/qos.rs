//! Quality of service: what a writer offers, and what a reader asks for.

use ros2_client::dds::rustdds::policy::ResourceLimits;
use ros2_client::dds::rustdds::{QosPolicies, QosPolicyBuilder, qos::QosPolicyId};
use ros2_client::qos::{Durability, History, QosProfile, Reliability, WhenFull};
use std::time::Duration;

/// The quality of service of a topic's publisher or subscription.
///
/// A subscription gets values from those publishers that offer at least what it asks for: a
/// reliable one gets none from a best-effort publisher. Such a mismatch is an
/// [`Incompatible`](crate::Status::last_incompatible) in the status of both sides.
///
/// The depth is that of the buffer between the link and DDS too. When it is full, the oldest value
/// is overwritten; with [`keep_all`](Self::keep_all) the sending side waits.
///
/// ```
/// use luna_ros2::Qos;
///
/// let commands = Qos::default().depth(1); // reliable; only the latest
/// let camera = Qos::sensor_data(); // best effort
/// let map = Qos::latched(); // late subscriptions get the last value
/// # let _ = (commands, camera, map);
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Qos {
    reliable: bool,
    transient_local: bool,
    depth: Option<usize>,
    deadline: Option<Duration>,
    lifespan: Option<Duration>,
    liveliness_lease: Option<Duration>,
}

/// How many values the buffer has with [`Qos::keep_all`].
const KEEP_ALL_BUFFER: usize = 64;
/// How many values RustDDS keeps then, instead of its 64.
const KEEP_ALL_CACHE: i32 = 4096;

impl Default for Qos {
    /// As in ROS 2: reliable, volatile, the last 10 values.
    fn default() -> Self {
        Self {
            reliable: true,
            transient_local: false,
            depth: Some(10),
            deadline: None,
            lifespan: None,
            liveliness_lease: None,
        }
    }
}

impl Qos {
    /// ROS 2's profile for sensors: best effort, volatile, the last 5 values.
    pub fn sensor_data() -> Self {
        Self::default().best_effort().depth(5)
    }

    /// Reliable, and a late subscription gets the last value: transient local, depth 1.
    pub fn latched() -> Self {
        Self::default().transient_local().depth(1)
    }

    /// Lost values are sent again.
    #[must_use]
    pub fn reliable(mut self) -> Self {
        self.reliable = true;
        self
    }

    /// Values may be lost.
    #[must_use]
    pub fn best_effort(mut self) -> Self {
        self.reliable = false;
        self
    }

    /// Late subscriptions get the last values, as many as the depth.
    #[must_use]
    pub fn transient_local(mut self) -> Self {
        self.transient_local = true;
        self
    }

    /// Keeps the last `depth` values, from 1.
    #[must_use]
    pub fn depth(mut self, depth: usize) -> Self {
        self.depth = Some(depth);
        self
    }

    /// Overwrites nothing in the link: a buffer of 64 values, and then the sending side waits. A
    /// publisher's process then waits for DDS, so this is not for the real-time path. What comes
    /// to a subscription waits in RustDDS, which holds no writer back: of more than 4096 values
    /// the oldest are lost there.
    #[must_use]
    pub fn keep_all(mut self) -> Self {
        self.depth = None;
        self
    }

    /// The longest time between two values that is offered or asked for.
    #[must_use]
    pub fn deadline(mut self, time: Duration) -> Self {
        self.deadline = Some(time);
        self
    }

    /// How long a value is valid: older ones are not delivered.
    #[must_use]
    pub fn lifespan(mut self, time: Duration) -> Self {
        self.lifespan = Some(time);
        self
    }

    /// After how long without a sign of life a publisher counts as gone.
    #[must_use]
    pub fn liveliness_lease(mut self, time: Duration) -> Self {
        self.liveliness_lease = Some(time);
        self
    }

    /// How many values the buffer has.
    pub(crate) fn buffer(&self) -> usize {
        self.depth.unwrap_or(KEEP_ALL_BUFFER)
    }

    pub(crate) fn is_reliable(&self) -> bool {
        self.reliable
    }

    /// Whether a full buffer is overwritten.
    pub(crate) fn overwrites(&self) -> bool {
        self.depth.is_some()
    }

    /// Of a topic: as the profile, with RustDDS's limits.
    pub(crate) fn policies(&self) -> QosPolicies {
        let policies = QosPolicies::from(self.profile());
        match self.depth {
            Some(_) => policies,
            None => policies.modify_by(
                &QosPolicyBuilder::new()
                    .resource_limits(ResourceLimits {
                        max_samples: KEEP_ALL_CACHE,
                        max_instances: 1,
                        max_samples_per_instance: KEEP_ALL_CACHE,
                    })
                    .build(),
            ),
        }
    }

    pub(crate) fn profile(&self) -> QosProfile {
        let reliability = match self.reliable {
            true => Reliability::Reliable {
                when_full: WhenFull::DEFAULT,
            },
            false => Reliability::BestEffort,
        };
        let durability = match self.transient_local {
            true => Durability::TransientLocal,
            false => Durability::Volatile,
        };
        let history = match self.depth {
            Some(depth) => History::KeepLast { depth },
            None => History::KeepAll,
        };
        QosProfile::default()
            .reliability(reliability)
            .durability(durability)
            .history(history)
            .deadline(self.deadline)
            .lifespan(self.lifespan)
            .liveliness_lease(self.liveliness_lease)
    }
}

/// Which policy two sides do not agree on, in words.
pub(crate) fn disagreement(offered: &QosPolicies, requested: &QosPolicies) -> String {
    let Some(policy) = offered.compliance_failure_wrt(requested) else {
        return "another policy".to_owned();
    };
    let both = |offered: String, requested: String| {
        format!("{offered} is offered, and {requested} is requested")
    };
    match policy {
        QosPolicyId::Reliability => both(
            format!("{:?}", offered.reliability()),
            format!("{:?}", requested.reliability()),
        ),
        QosPolicyId::Durability => both(
            format!("{:?}", offered.durability()),
            format!("{:?}", requested.durability()),
        ),
        QosPolicyId::Deadline => both(
            format!("{:?}", offered.deadline()),
            format!("{:?}", requested.deadline()),
        ),
        policy => format!("{policy:?}"),
    }
}
