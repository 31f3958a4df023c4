//! A node: its name in the graph, its participant in DDS, and the thread that sees partners come
//! and go.

use crate::graph::Graph;
use crate::{Message, Qos, Ros2Error, names};
use futures_lite::future::or;
use futures_lite::{StreamExt, pin};
use luna::Sender;
use luna_core::park;
use luna_platform::thread::{Attributes, SpawnError, Thread, spawn};
use ros2_client::dds::rustdds::{
    DomainParticipant, DomainParticipantBuilder, QosPolicies, StatusEvented, Topic, TopicKind,
};
use ros2_client::qos::QosProfile;
use ros2_client::{Context, CreateError, Name, NodeName, NodeOptions, ServiceMapping};
use std::any::Any;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// How a node is connected.
///
/// ```
/// use luna_ros2::{Options, Rmw};
///
/// let lab = Options::new().domain(7).network([192, 168, 1, 20]).rmw(Rmw::Cyclone);
/// # let _ = lab;
/// ```
#[derive(Debug, Clone)]
pub struct Options {
    domain: Option<u16>,
    networks: Option<Vec<IpAddr>>,
    rmw: Rmw,
}

/// The middleware of the other nodes, which decides how calls of services are numbered. Topics are
/// the same with both.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Rmw {
    /// `rmw_fastrtps_cpp`, ROS 2's default, and Connext with extended mapping.
    #[default]
    Fast,
    /// `rmw_cyclonedds_cpp`.
    Cyclone,
}

impl Rmw {
    pub(crate) fn mapping(self) -> ServiceMapping {
        match self {
            Rmw::Fast => ServiceMapping::Enhanced,
            Rmw::Cyclone => ServiceMapping::Cyclone,
        }
    }
}

impl Default for Options {
    fn default() -> Self {
        Self::new()
    }
}

impl Options {
    /// The domain of ROS_DOMAIN_ID, or 0; this computer alone; services as by Fast DDS.
    pub fn new() -> Self {
        Self {
            domain: None,
            networks: Some(vec![Ipv4Addr::LOCALHOST.into()]),
            rmw: Rmw::default(),
        }
    }

    /// This domain, 0 to 232, whatever the environment says. Nodes of different domains do not see
    /// each other.
    #[must_use]
    pub fn domain(mut self, domain: u16) -> Self {
        self.domain = Some(domain);
        self
    }

    /// The network of this address of the computer too. May be called several times.
    #[must_use]
    pub fn network(mut self, address: impl Into<IpAddr>) -> Self {
        if let Some(networks) = &mut self.networks {
            networks.push(address.into());
        }
        self
    }

    /// All networks of the computer.
    #[must_use]
    pub fn all_networks(mut self) -> Self {
        self.networks = None;
        self
    }

    /// The middleware of the nodes with which services are used.
    #[must_use]
    pub fn rmw(mut self, rmw: Rmw) -> Self {
        self.rmw = rmw;
        self
    }

    fn resolved_domain(&self) -> Result<u16, Ros2Error> {
        let domain = match (self.domain, std::env::var("ROS_DOMAIN_ID")) {
            (Some(domain), _) => domain,
            (None, Ok(value)) if !value.is_empty() => match value.trim().parse() {
                Ok(domain) => domain,
                Err(_) => return Err(Ros2Error::DomainVariable { value }),
            },
            _ => 0,
        };
        match domain {
            0..=232 => Ok(domain),
            domain => Err(Ros2Error::Domain { domain }),
        }
    }
}

/// A node of a ROS 2 graph. Clones are the same; it ends when they and its links are gone.
///
/// It makes publishers ([`publisher`](Self::publisher)), subscriptions
/// ([`subscription`](Self::subscription)), services ([`service`](Self::service)), clients
/// ([`client`](Self::client)) and the services of parameters ([`parameters`](Self::parameters)),
/// each with a link to be spawned.
///
/// DDS has threads of its own, of RustDDS and of each link, all at SCHED_OTHER. None runs on an
/// executor.
#[derive(Clone)]
pub struct Node {
    pub(crate) inner: Arc<Inner>,
}

pub(crate) struct Inner {
    pub(crate) name: NodeName,
    pub(crate) rmw: Rmw,
    domain: u16,
    graph: Arc<Mutex<Graph>>,
    stop: Option<Sender<()>>,
    thread: Option<Thread<()>>,
    /// Publishers and servers without a link, for what DDS has to send again.
    retired: Mutex<Vec<Box<dyn Any + Send>>>,
    participant: DomainParticipant,
    /// Dropped after the thread has ended: DDS ends with it.
    ros: Mutex<ros2_client::Node>,
}

/// A topic, before it is made.
pub(crate) struct TopicPlan {
    pub(crate) name: Name,
    pub(crate) dds_name: String,
    /// The type, as DDS names it.
    pub(crate) kind: String,
    pub(crate) profile: QosProfile,
    policies: QosPolicies,
}

impl Node {
    /// Joins the graph as the node `name` in `namespace`, such as `/` or `/arm`.
    ///
    /// **Without [`Options::network`] only nodes of this computer are found**, and nothing is sent
    /// elsewhere. The sockets of RustDDS are open on all networks all the same: it cannot bind them
    /// to one, so a packet that comes from elsewhere is read. A firewall is what keeps them out.
    /// There is no SROS2 security here: any program that reaches the ports can publish.
    ///
    /// Not for the real-time path: it opens sockets, makes threads and waits for them. They have no
    /// real-time priority, whatever the calling thread has.
    ///
    /// # Errors
    ///
    /// [`Ros2Error`]: a name or domain that cannot be, or DDS's refusal.
    ///
    /// ```
    /// use luna_ros2::{Node, Options};
    ///
    /// let node = Node::new("/arm", "driver", Options::new().domain(79))?;
    /// assert_eq!(node.name(), "/arm/driver");
    /// assert!(Node::new("/arm", "two words", Options::new()).is_err());
    /// # Ok::<(), luna_ros2::Ros2Error>(())
    /// ```
    pub fn new(namespace: &str, name: &str, options: Options) -> Result<Self, Ros2Error> {
        let name = names::node(namespace, name)?;
        let domain = options.resolved_domain()?;
        let whole = name.fully_qualified_name();
        let failed = |reason: String| Ros2Error::Create {
            what: "participant",
            name: whole.clone(),
            reason,
        };
        let graph = Arc::new(Mutex::new(Graph::default()));
        let (stop, stopped) = luna::channel::<()>();
        let (stop, stopped) = (stop.external(), stopped.external());
        let made = Arc::new(Mutex::new(None));
        let (given, seen) = (made.clone(), graph.clone());
        let own = name.clone();
        // DDS's threads inherit what this thread has: no priority.
        let set_up = move |_: &_| {
            let mut builder = DomainParticipantBuilder::new(domain);
            if let Some(networks) = options.networks {
                builder = builder.with_only_networks(networks);
            }
            let participant = builder.build().map_err(|error| error.to_string())?;
            let context = Context::from_domain_participant(participant.clone())
                .map_err(|error| error.to_string())?;
            let plain = NodeOptions::new()
                .enable_rosout(false)
                .start_parameter_services(false);
            let ros = context
                .new_node(own, plain)
                .map_err(|error| error.to_string())?;
            *lock(&given) = Some((participant.clone(), ros));
            Ok::<_, String>(participant)
        };
        let body = move |participant: DomainParticipant| {
            let listener = participant.status_listener();
            let events = listener.as_async_status_stream();
            let watch = async {
                pin!(events);
                while let Some(event) = events.next().await {
                    lock(&seen).take(event);
                }
            };
            let stopped = async {
                // Nothing is sent: it ends.
                let _ = stopped.recv().await;
            };
            park::block_on(or(stopped, watch));
        };
        let thread = spawn(Attributes::new("ros2 graph"), set_up, body);
        let thread = thread.map_err(|error| match error {
            SpawnError::SetUp(reason) => failed(reason),
            other => Ros2Error::Thread {
                name: whole.clone(),
                reason: other.to_string(),
            },
        })?;
        let made = lock(&made).take();
        let (participant, ros) = made.ok_or_else(|| failed("it is gone".to_owned()))?;
        Ok(Self {
            inner: Arc::new(Inner {
                name,
                rmw: options.rmw,
                domain,
                graph,
                stop: Some(stop),
                thread: Some(thread),
                retired: Mutex::default(),
                participant,
                ros: Mutex::new(ros),
            }),
        })
    }

    /// Its whole name, such as `/arm/driver`.
    pub fn name(&self) -> String {
        self.inner.name.fully_qualified_name()
    }

    /// Its domain.
    pub fn domain(&self) -> u16 {
        self.inner.domain
    }
}

impl Inner {
    pub(crate) fn graph(&self) -> MutexGuard<'_, Graph> {
        lock(&self.graph)
    }

    pub(crate) fn topic<M: Message>(&self, name: &str, qos: &Qos) -> Result<TopicPlan, Ros2Error> {
        if qos.buffer() == 0 {
            let name = name.to_owned();
            return Err(Ros2Error::Depth { name });
        }
        let name = names::resolve(name, &self.name, "topic")?;
        Ok(TopicPlan {
            dds_name: name.to_dds_name("rt", &self.name, ""),
            name,
            kind: names::message(M::TYPE)?.dds_msg_type(),
            profile: qos.profile(),
            policies: qos.policies(),
        })
    }

    /// Makes a topic of DDS, with limits that ros2-client does not know.
    pub(crate) fn make_topic(&self, plan: &TopicPlan) -> Result<Topic, CreateError> {
        let (name, kind) = (plan.dds_name.clone(), plan.kind.clone());
        let topic = &self.participant;
        Ok(topic.create_topic(name, kind, &plan.policies, TopicKind::NoKey)?)
    }

    /// Keeps a publisher or server until the node ends.
    pub(crate) fn retire(&self, writer: impl Any + Send) {
        lock(&self.retired).push(Box::new(writer));
    }

    /// Makes something of DDS.
    pub(crate) fn create<T>(
        &self,
        what: &'static str,
        name: &Name,
        make: impl FnOnce(&mut ros2_client::Node) -> Result<T, CreateError>,
    ) -> Result<T, Ros2Error> {
        make(&mut lock(&self.ros)).map_err(|error| Ros2Error::Create {
            what,
            name: name.to_string(),
            reason: error.to_string(),
        })
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        self.stop = None;
        if let Some(thread) = self.thread.take() {
            // Its panic was reported by the hook.
            let _ = thread.join();
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

luna_platform::debug_fields!(Node, |node| name: node.name(), domain: node.inner.domain);
