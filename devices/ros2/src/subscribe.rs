//! From a topic to a channel.

use crate::carrier::Stop;
use crate::graph::{Role, Side, Watched};
use crate::link::Link;
use crate::message::Wire;
use crate::{Message, Node, Qos, Ros2Error, Status};
use futures_lite::future::or;
use futures_lite::{StreamExt, pin};
use luna::channel::ChannelEnd;
use luna::{Buffer, Error, Receiver, Sender};
use luna_platform::clock::Instant;
use ros2_client::{MessageInfo, ROSTime, Subscription};
use std::collections::HashSet;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// A value of a subscription, and how old it is.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Received<M> {
    /// The value.
    pub value: M,
    /// Its number, from 1, among the values that came over this link. A gap shows how many were
    /// overwritten in the buffer.
    pub number: u64,
    /// When it was sent, by the sender's wall clock; `None` if it does not say.
    pub sent: Option<SystemTime>,
    /// When it came to this computer's DDS, by this system's clock.
    pub received: luna::Instant,
}

impl<M> Received<M> {
    /// The time since it came. Real-time path: yes; reads the clock.
    pub fn age(&self) -> Duration {
        Instant::now_real() - self.received
    }

    /// The time since it was sent, by the two computers' wall clocks: only as good as these are
    /// set. `None` if the sender does not say, or its clock is ahead. Real-time path: yes.
    pub fn age_by_wall_clock(&self) -> Option<Duration> {
        SystemTime::now().duration_since(self.sent?).ok()
    }
}

impl Node {
    /// A subscription to `topic`, as a receiver and a link. Names are as for
    /// [`publisher`](Self::publisher).
    ///
    /// Values wait in a buffer as large as the QoS's depth. A new one overwrites the oldest, on the
    /// link's thread; with [`Qos::keep_all`] it waits in DDS, whose limits apply. The receiver is
    /// an input guard as any other.
    ///
    /// Not for the real-time path: call it before the system runs, or in [`luna::blocking`]. To
    /// receive is for it. A message with a `String` or `Vec` is freed by the process that drops it:
    /// on the real-time path use a type without heap, see [`Message`].
    ///
    /// # Errors
    ///
    /// As for [`publisher`](Self::publisher).
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna_ros2::msg::std_msgs::Float64;
    /// use luna_ros2::{Node, Options, Qos};
    /// use std::time::Duration;
    ///
    /// let node = Node::new("/", "controller", Options::new().domain(78))?;
    /// let (setpoint, link) = node.subscription::<Float64>("/setpoint", Qos::sensor_data())?;
    /// let mut system = System::new("controller");
    /// let main = system.executor("main").build()?;
    /// main.process("link").spawn(link)?;
    /// main.process("controller").spawn(async move {
    ///     alt! {
    ///         received = setpoint.recv() => {
    ///             let received = received?;
    ///             println!("{}, {:?} old", received.value.data, received.age());
    ///         },
    ///         _ = luna::after(Duration::from_millis(1)) => println!("no setpoint"),
    ///     }
    ///     Ok(())
    /// })?;
    /// system.run()?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn subscription<M: Message>(
        &self,
        topic: &str,
        qos: Qos,
    ) -> Result<(Receiver<Received<M>>, Link), Ros2Error> {
        let topic = self.inner.topic::<M>(topic, &qos)?;
        let status = Status::new();
        // Under the lock, so that no match is missed.
        let mut graph = self.inner.graph();
        let subscription = self.inner.create("subscription", &topic.name, |ros| {
            let made = self.inner.make_topic(&topic)?;
            ros.create_subscription::<Wire<M>>(&made, Some(topic.profile.clone()))
        })?;
        graph.watch(Watched {
            status: status.clone(),
            sides: vec![Side {
                role: Role::Reader,
                guid: Some(subscription.guid()),
                topic: topic.dds_name,
                kind: topic.kind,
                partners: HashSet::new(),
            }],
        });
        drop(graph);
        let name = topic.name.to_string();
        let buffer = match qos.overwrites() {
            true => Buffer::overwrite_oldest(qos.buffer()),
            false => Buffer::fifo(qos.buffer()),
        };
        let (sender, receiver) = luna::buffered(buffer);
        let (sender, receiver) = (sender.external(), receiver.named(&name));
        let (counts, topic) = (status.clone(), name.clone());
        let work = move |stop: &Stop| {
            let carried = stop.wait(carry(&subscription, &sender, &counts, &topic));
            carried.unwrap_or(Ok(()))
        };
        let link = Link::new(self.inner.clone(), name, status, Box::new(work));
        Ok((receiver, link))
    }
}

/// What the thread does, until its channel ends.
async fn carry<M: Message>(
    subscription: &Subscription<Wire<M>>,
    sender: &Sender<Received<M>>,
    status: &Status,
    topic: &str,
) -> luna::Result<()> {
    let values = subscription.async_stream();
    pin!(values);
    loop {
        let next = or(async { Err(sender.ended().await) }, async {
            Ok(values.next().await)
        });
        match next.await {
            Ok(Some(Ok((Wire(value), info)))) => {
                let received = Received {
                    value,
                    number: status.carry(),
                    sent: info.source_timestamp().and_then(wall_clock),
                    received: arrival(&info),
                };
                // If it fails the channel has ended, which the next turn sees.
                let _ = sender.send(received).await;
            }
            Ok(Some(Err(error))) => status.malformed_one(error),
            Ok(None) => {
                sender.poison();
                return Err(Ros2Error::Ended {
                    name: topic.to_owned(),
                    reason: "no more values come".to_owned(),
                }
                .into());
            }
            Err(ChannelEnd::Closed) => return Ok(()),
            Err(ChannelEnd::Poisoned) => return Err(Error::Poisoned),
        }
    }
}

fn wall_clock(time: ROSTime) -> Option<SystemTime> {
    let nanos = u64::try_from(time.to_nanos()).ok()?;
    Some(UNIX_EPOCH + Duration::from_nanos(nanos))
}

/// DDS notes it by the wall clock, and this thread may have come late.
fn arrival(info: &MessageInfo) -> Instant {
    let waited = info.received_timestamp().and_then(wall_clock);
    let waited = waited.and_then(|came| SystemTime::now().duration_since(came).ok());
    Instant::now_real() - waited.unwrap_or_default()
}
