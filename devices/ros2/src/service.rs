//! Services as call channels.

use crate::carrier::Stop;
use crate::graph::{Role, Side, Watched};
use crate::link::Link;
use crate::message::{Payload, Wire};
use crate::node::Inner;
use crate::{Node, Qos, Ros2Error, Service, Status, names};
use futures_lite::StreamExt;
use futures_lite::future::or;
use luna::channel::{CallError, ChannelEnd, Client, Server, call_channel};
use luna::{Error, RecvError};
use luna_platform::clock::Instant;
use ros2_client::{Name, ServiceTypeName};
use std::collections::HashSet;
use std::time::Duration;

/// How long a client waits for a reply if it does not say.
const PATIENCE: Duration = Duration::from_secs(5);

pub(crate) type RosServer<Q, A> = ros2_client::Server<Wire<Q>, Wire<A>>;
type RosClient<Q, A> = ros2_client::Client<Wire<Q>, Wire<A>>;

impl Node {
    /// Serves the service `name`: calls from the graph come to the server of a call channel.
    ///
    /// One call is under way at a time, and the others wait in DDS. A call that is dropped without
    /// a reply is [counted](Status::unanswered); its client gets nothing, since ROS 2 has no reply
    /// for that. When the last server is gone, the service stays in the graph until its node ends,
    /// and answers nothing: DDS may have to send the last reply again. Priorities are not inherited: the client is another program.
    ///
    /// A client of the same node does not find it: use an ordinary call channel there.
    ///
    /// Not for the real-time path: as [`publisher`](Self::publisher). To accept and to reply is,
    /// with types without heap.
    ///
    /// # Errors
    ///
    /// As for [`publisher`](Self::publisher).
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna_ros2::msg::std_srvs::{Trigger, TriggerReply};
    /// use luna_ros2::{Node, Options};
    ///
    /// let node = Node::new("/", "lamp", Options::new().domain(80))?;
    /// let (switch, to_graph) = node.service::<Trigger>("/lamp/switch")?;
    /// # let user = Node::new("/", "user", Options::new().domain(80))?;
    /// let (client, from_graph) = user.client::<Trigger>("/lamp/switch")?;
    /// # let other = to_graph.status();
    /// let status = from_graph.status();
    /// let mut system = System::new("lamp");
    /// let main = system.executor("main").build()?;
    /// main.process("link of the server").spawn(to_graph)?;
    /// main.process("link of the client").spawn(from_graph)?;
    /// main.process("lamp").spawn(async move {
    ///     let call = switch.accept().await?;
    ///     let reply = TriggerReply { success: true, message: "on".into() };
    ///     call.reply(reply).ok();
    ///     Ok(())
    /// })?;
    /// main.process("user").spawn(async move {
    ///     status.wait_for_partners(1).await;
    /// #   other.wait_for_partners(1).await;
    ///     let reply = client.call(Default::default()).await.map_err(luna::Error::from)?;
    ///     assert_eq!(reply.message, "on");
    ///     Ok(())
    /// })?;
    /// system.run()?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    #[expect(clippy::type_complexity, reason = "an end and its link, as for all")]
    pub fn service<S: Service>(
        &self,
        name: &str,
    ) -> Result<(Server<S::Request, S::Reply>, Link), Ros2Error> {
        let name = names::resolve(name, &self.inner.name, "service")?;
        let kind = names::service(S::TYPE)?;
        let status = Status::new();
        // Under the lock, so that no match is missed.
        let mut graph = self.inner.graph();
        let (ros, sides) = self.inner.serve::<S::Request, S::Reply>(&name, &kind)?;
        graph.watch(Watched {
            status: status.clone(),
            sides,
        });
        drop(graph);
        let name = name.to_string();
        let (client, server) = call_channel();
        let client = client.external();
        let (counts, node) = (status.clone(), self.inner.clone());
        let work = move |stop: &Stop| {
            let served = stop.wait(serve(&ros, &client, &counts));
            match &served {
                // DDS may have to send the last reply again.
                Some(Ok(())) => node.retire(ros),
                Some(Err(_)) => client.poison(),
                None => {}
            }
            served.unwrap_or(Ok(()))
        };
        let server = server.named(&name);
        let link = Link::new(self.inner.clone(), name, status, Box::new(work));
        Ok((server, link))
    }

    /// A client of the service `name`, which waits at most 5 s for a reply:
    /// [`client_with_patience`](Self::client_with_patience).
    ///
    /// # Errors
    ///
    /// As for [`publisher`](Self::publisher).
    #[expect(clippy::type_complexity, reason = "an end and its link, as for all")]
    pub fn client<S: Service>(
        &self,
        name: &str,
    ) -> Result<(Client<S::Request, S::Reply>, Link), Ros2Error> {
        self.client_with_patience::<S>(name, PATIENCE)
    }

    /// A client of the service `name`: calls of the call channel go to the graph.
    ///
    /// One call is under way at a time, and the most urgent of those that wait is next. A call
    /// fails as [`Unanswered`](CallError::Unanswered) if no server is connected
    /// ([`Status::wait_for_partners`] waits for one), or if none has replied within `patience`; the
    /// request may have been served then. If there are several servers, the first reply counts.
    ///
    /// Not for the real-time path: as [`publisher`](Self::publisher). To call is, with types
    /// without heap; how long it takes is up to the network and the server.
    ///
    /// # Errors
    ///
    /// As for [`publisher`](Self::publisher).
    #[expect(clippy::type_complexity, reason = "an end and its link, as for all")]
    pub fn client_with_patience<S: Service>(
        &self,
        name: &str,
        patience: Duration,
    ) -> Result<(Client<S::Request, S::Reply>, Link), Ros2Error> {
        let name = names::resolve(name, &self.inner.name, "service")?;
        let kind = names::service(S::TYPE)?;
        let status = Status::new();
        let profile = Qos::default().profile();
        let mut graph = self.inner.graph();
        let ros: RosClient<S::Request, S::Reply> = self.inner.create("client", &name, |ros| {
            let mapping = self.inner.rmw.mapping();
            ros.create_client(mapping, &name, &kind, profile.clone(), profile)
        })?;
        let sides = self.inner.sides(&name, &kind, Role::Writer);
        graph.watch(Watched {
            status: status.clone(),
            sides,
        });
        drop(graph);
        let name = name.to_string();
        let (client, server) = call_channel();
        let server = server.external();
        let counts = status.clone();
        let work = move |stop: &Stop| call(&ros, &server, &counts, patience, stop);
        let client = client.named(&name);
        let link = Link::new(self.inner.clone(), name, status, Box::new(work));
        Ok((client, link))
    }
}

impl Inner {
    /// A server, and its two topics. The graph is locked meanwhile.
    pub(crate) fn serve<Q: Payload, A: Payload>(
        &self,
        name: &Name,
        kind: &ServiceTypeName,
    ) -> Result<(RosServer<Q, A>, Vec<Side>), Ros2Error> {
        let profile = Qos::default().profile();
        let server = self.create("service", name, |ros| {
            let mapping = self.rmw.mapping();
            ros.create_server(mapping, name, kind, profile.clone(), profile)
        })?;
        Ok((server, self.sides(name, kind, Role::Reader)))
    }

    /// The two topics of a service, for the side that has this role for requests.
    fn sides(&self, name: &Name, kind: &ServiceTypeName, requests: Role) -> Vec<Side> {
        let replies = match requests {
            Role::Writer => Role::Reader,
            Role::Reader => Role::Writer,
        };
        let side = |role, prefix: &str, suffix: &str, part: &str| Side {
            role,
            guid: None,
            topic: name.to_dds_name(prefix, &self.name, suffix),
            kind: format!(
                "{}::srv::dds_::{}_{part}_",
                kind.package_name(),
                kind.type_name()
            ),
            partners: HashSet::new(),
        };
        vec![
            side(requests, "rq", "Request", "Request"),
            side(replies, "rr", "Reply", "Response"),
        ]
    }
}

/// Carries requests to the channel, and replies back.
async fn serve<Q: Payload, A: Payload>(
    ros: &RosServer<Q, A>,
    client: &Client<Q, A>,
    status: &Status,
) -> luna::Result<()> {
    let mut requests = ros.receive_request_stream();
    loop {
        let next = or(async { Err(client.ended().await) }, async {
            Ok(requests.next().await)
        });
        let (id, Wire(request)) = match next.await {
            Ok(Some(Ok(request))) => request,
            Ok(Some(Err(error))) => {
                status.malformed_one(error);
                continue;
            }
            Ok(None) => return Err(Error::other("no more requests come")),
            Err(ChannelEnd::Closed) => return Ok(()),
            Err(ChannelEnd::Poisoned) => return Err(Error::Poisoned),
        };
        status.carry();
        match client.call(request).await {
            Ok(answer) => {
                if let Err(error) = ros.async_send_response(id, Wire(answer)).await {
                    status.refuse(error);
                }
            }
            Err(CallError::Unanswered) => status.unanswer(),
            // The next turn sees the end.
            Err(_) => {}
        }
    }
}

/// Carries calls of the channel to the graph, one after the other.
fn call<Q: Payload, A: Payload>(
    ros: &RosClient<Q, A>,
    server: &Server<Q, A>,
    status: &Status,
    patience: Duration,
    stop: &Stop,
) -> luna::Result<()> {
    loop {
        let call = match stop.wait(server.accept()) {
            None => return Ok(()),
            Some(Ok(call)) => call,
            Some(Err(RecvError::Poisoned)) => return Err(Error::Poisoned),
            Some(Err(_)) => return Ok(()),
        };
        if status.partners() == 0 {
            status.unanswer();
            continue; // The call is dropped.
        }
        let (request, reply) = call.into_parts();
        let answered = async {
            let id = match ros.async_send_request(Wire(request)).await {
                Ok(id) => id,
                Err(error) => {
                    status.refuse(error);
                    return None;
                }
            };
            status.carry();
            loop {
                match ros.async_receive_response(id).await {
                    Ok(Wire(answer)) => return Some(answer),
                    // It may be the reply to another client.
                    Err(error) => status.malformed_one(error),
                }
            }
        };
        match stop.wait_until(answered, Instant::now_real() + patience) {
            None => return Ok(()),
            Some(Some(Some(answer))) => {
                // Its client may have gone.
                let _ = reply.send(answer);
            }
            Some(_) => status.unanswer(),
        }
    }
}
