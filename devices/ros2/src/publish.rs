//! From a channel to a topic.

use crate::carrier::Stop;
use crate::graph::{Role, Side, Watched};
use crate::link::Link;
use crate::message::Wire;
use crate::{Message, Node, Qos, Ros2Error, Status};
use luna::realtime::off_path;
use luna::{Buffer, Error, Process, Receiver, Sender, alt};
use ros2_client::{Publisher, WriteError};
use std::collections::HashSet;
use std::fmt;

/// The link of a publisher, made by [`Node::publisher`]: a process, to be spawned.
///
/// It takes each value at once, stores it in a buffer as large as the QoS's depth, and wakes a
/// thread of its own at SCHED_OTHER, which encodes it and gives it to DDS. In a full buffer it
/// overwrites the oldest value, and [counts](Status::overwritten) it; with [`Qos::keep_all`] it
/// waits. It ends as a [`Link`] does; if the last sender is gone, when the rest of the buffer is
/// with DDS. A reliable publisher then stays in the graph until its node ends, so that DDS can send
/// again what was lost: keep the [`Node`] as long as that may take.
///
/// Real-time path: yes, from its `run` on, except with `keep_all`; no allocation, and one system
/// call to wake the thread if it sleeps. A value that is overwritten is dropped here: a message
/// without heap costs nothing.
#[must_use = "a link is a process: spawn it"]
pub struct PublisherLink<M: Message> {
    link: Link,
    near: Option<Near<M>>,
}

struct Near<M> {
    values: Receiver<M>,
    buffer: Sender<M>,
    /// To make room.
    oldest: Receiver<M>,
    overwrites: bool,
}

impl Node {
    /// A publisher of `topic`, as a sender and a link.
    ///
    /// The name may be absolute (`/chatter`), relative to the node's namespace (`joints`), or
    /// below the node (`~/state`). A send is a rendezvous with the link, and says nothing of
    /// subscriptions: publishing is asynchronous. Until one is [connected](Status::partners),
    /// values go nowhere, unless the QoS is [latched](Qos::latched).
    ///
    /// Not for the real-time path: call it before the system runs, or in [`luna::blocking`].
    ///
    /// # Errors
    ///
    /// [`Ros2Error`]: a name or depth that cannot be, or DDS's refusal.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna_ros2::msg::geometry_msgs::Twist;
    /// use luna_ros2::{Node, Options, Qos};
    ///
    /// let node = Node::new("/", "driver", Options::new().domain(77))?;
    /// let (velocity, link) = node.publisher::<Twist>("/cmd_vel", Qos::default().depth(1))?;
    /// let mut system = System::new("robot");
    /// let main = system.executor("main").build()?;
    /// main.process("link").priority(2).spawn(link)?;
    /// main.process("driver").spawn(async move {
    ///     let mut twist = Twist::default();
    ///     twist.linear.x = 0.2;
    ///     velocity.send(twist).await?;
    ///     Ok(())
    /// })?;
    /// system.run()?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn publisher<M: Message>(
        &self,
        topic: &str,
        qos: Qos,
    ) -> Result<(Sender<M>, PublisherLink<M>), Ros2Error> {
        let topic = self.inner.topic::<M>(topic, &qos)?;
        let status = Status::new();
        // Under the lock, so that no match is missed.
        let mut graph = self.inner.graph();
        let publisher = self.inner.create("publisher", &topic.name, |ros| {
            let made = self.inner.make_topic(&topic)?;
            ros.create_publisher(&made, Some(topic.profile.clone()))
        })?;
        graph.watch(Watched {
            status: status.clone(),
            sides: vec![Side {
                role: Role::Writer,
                guid: Some(publisher.guid()),
                topic: topic.dds_name,
                kind: topic.kind,
                partners: HashSet::new(),
            }],
        });
        drop(graph);
        let name = topic.name.to_string();
        let (sender, values) = luna::channel();
        let (buffer, far) = luna::buffered(Buffer::fifo(qos.buffer()));
        let near = Near {
            values: values.external(),
            buffer: buffer.external(),
            oldest: far.clone(),
            overwrites: qos.overwrites(),
        };
        let counts = status.clone();
        let (node, reliable) = (self.inner.clone(), qos.is_reliable());
        let work = move |stop: &Stop| {
            let drained = stop.wait(carry(&far, &publisher, &counts)).is_some();
            if drained && reliable {
                // DDS sends again what was lost, as long as the publisher is there.
                node.retire(publisher);
            }
            Ok(())
        };
        let link = PublisherLink {
            link: Link::new(self.inner.clone(), name.clone(), status, Box::new(work)),
            near: Some(near),
        };
        Ok((sender.named(&name), link))
    }
}

impl<M: Message> PublisherLink<M> {
    /// What it has done, and its partners.
    pub fn status(&self) -> Status {
        self.link.status()
    }
}

impl<M: Message> Near<M> {
    /// Until the last sender is gone.
    async fn run(&self, status: &Status, done: &Receiver<luna::Result<()>>) -> luna::Result<()> {
        loop {
            let value = alt! {
                value = self.values.recv() => match value {
                    Ok(value) => value,
                    Err(error) if error.is_closed() => return Ok(()),
                    Err(error) => return Err(error.into()),
                },
                // It goes on until the buffer's sender is gone, so it has failed.
                _ = done.recv() => return Err(Error::Closed),
            };
            if self.overwrites {
                self.overwrite(value, status);
            } else {
                // If the thread has failed meanwhile, the next turn sees it.
                let failed = async {
                    done.ended().await;
                };
                let _ = self.buffer.send_unless(value, failed).await;
            }
        }
    }

    fn overwrite(&self, mut value: M, status: &Status) {
        // Nobody else sends, so there is room the second time.
        for _ in 0..2 {
            match self.buffer.try_send(value) {
                Err(error) if error.is_full() => {
                    value = error.into_inner();
                    if self.oldest.try_recv().is_ok() {
                        status.overwrite();
                    }
                }
                _ => return,
            }
        }
    }
}

/// What the thread does.
async fn carry<M: Message>(values: &Receiver<M>, publisher: &Publisher<Wire<M>>, status: &Status) {
    while let Ok(value) = values.recv().await {
        match publisher.async_publish(Wire(value)).await {
            Ok(()) => {
                status.carry();
            }
            Err(WriteError::WouldBlock { .. }) => {
                status.refuse("the readers have not acknowledged the values before it");
            }
            Err(error) => status.refuse(error),
        }
    }
}

impl<M: Message> Process for PublisherLink<M> {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.link.pre_run()
    }

    async fn run(&mut self) -> luna::Result<()> {
        let done = off_path(|| self.link.done())?;
        let Some(near) = self.near.take() else {
            return Err(off_path(|| self.link.run_twice()));
        };
        let ended = near.run(&self.link.status(), &done).await;
        if ended.as_ref().is_err_and(|error| !error.is_poisoned()) {
            near.values.poison();
            return Err(self.link.ended());
        }
        off_path(|| drop(near)); // The thread ends with the rest of the buffer.
        ended?;
        match done.recv().await {
            Ok(result) => result,
            Err(_) => Err(self.link.ended()),
        }
    }

    fn post_run(&mut self) {
        self.near = None;
        self.link.post_run();
    }
}

impl<M: Message> fmt::Debug for PublisherLink<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("PublisherLink").field(&self.link).finish()
    }
}
