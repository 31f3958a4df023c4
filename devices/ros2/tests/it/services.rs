//! Services and clients of nodes of this program.

use crate::{domain, node};
use luna::channel::CallError;
use luna::prelude::*;
use luna_ros2::msg::std_srvs::{SetBool, SetBoolReply, SetBoolRequest};
use luna_ros2::{Node, Options, Rmw};
use std::time::Duration;

fn on(data: bool) -> SetBoolRequest {
    SetBoolRequest { data }
}

/// Of each kind of middleware.
fn nodes(rmw: Rmw) -> (Node, Node) {
    let options = Options::new().domain(domain()).rmw(rmw);
    let server = Node::new("/", "server", options.clone()).unwrap();
    (server, Node::new("/", "client", options).unwrap())
}

fn call_and_reply(rmw: Rmw) {
    let (here, there) = nodes(rmw);
    let (switch, to_graph) = here.service::<SetBool>("/lamp/switch").unwrap();
    let (client, from_graph) = there.client::<SetBool>("/lamp/switch").unwrap();
    let (served, called) = (to_graph.status(), from_graph.status());
    let (there, here) = (to_graph.status(), from_graph.status());
    let mut system = System::new("test");
    let main = system.executor("main").build().unwrap();
    main.process("to").priority(2).spawn(to_graph).unwrap();
    main.process("from").priority(2).spawn(from_graph).unwrap();
    main.process("lamp")
        .spawn(async move {
            for count in 0..20 {
                let call = switch.accept().await?;
                let reply = SetBoolReply {
                    success: call.data,
                    message: format!("call {count}"),
                };
                call.reply(reply).unwrap();
            }
            Ok(())
        })
        .unwrap();
    main.process("user")
        .spawn(async move {
            there.wait_for_partners(1).await;
            here.wait_for_partners(1).await;
            for count in 0..20 {
                let reply = client.call(on(count % 2 == 0)).await.unwrap();
                assert_eq!(reply.message, format!("call {count}"));
                assert_eq!(reply.success, count % 2 == 0);
            }
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    assert_eq!((served.carried(), called.carried()), (20, 20));
    assert_eq!((served.unanswered(), called.unanswered()), (0, 0));
}

#[test]
fn calls_are_answered_as_by_fast_dds() {
    own_process!();
    call_and_reply(Rmw::Fast);
}

#[test]
fn calls_are_answered_as_by_cyclone() {
    own_process!();
    call_and_reply(Rmw::Cyclone);
}

#[test]
fn a_call_without_a_server_is_unanswered() {
    own_process!();
    let node = node(domain(), "alone");
    let (client, link) = node.client::<SetBool>("/nobody").unwrap();
    let status = link.status();
    let body = async move {
        let error = client.call(on(true)).await.unwrap_err();
        assert!(matches!(error, CallError::Unanswered), "{error}");
        Ok(())
    };
    crate::run([link], body).unwrap();
    assert_eq!((status.carried(), status.unanswered()), (0, 1));
}

#[test]
fn a_server_that_does_not_reply_costs_the_clients_patience() {
    own_process!();
    let (here, there) = nodes(Rmw::Fast);
    let (switch, to_graph) = here.service::<SetBool>("/deaf").unwrap();
    let patience = Duration::from_millis(200);
    let (client, from_graph) = there
        .client_with_patience::<SetBool>("/deaf", patience)
        .unwrap();
    let served = to_graph.status();
    let (far, near) = (to_graph.status(), from_graph.status());
    let mut system = System::new("test");
    let main = system.executor("main").build().unwrap();
    main.process("to").priority(2).spawn(to_graph).unwrap();
    main.process("from").priority(2).spawn(from_graph).unwrap();
    main.process("deaf")
        .spawn(async move {
            drop(switch.accept().await?); // no reply
            let call = switch.accept().await?;
            let reply = SetBoolReply {
                success: true,
                message: "the second".to_owned(),
            };
            call.reply(reply).unwrap();
            Ok(())
        })
        .unwrap();
    main.process("user")
        .spawn(async move {
            far.wait_for_partners(1).await;
            near.wait_for_partners(1).await;
            let begin = luna::now();
            assert!(client.call(on(true)).await.unwrap_err().is_unanswered());
            assert!(luna::now() - begin >= patience);
            // A reply that is late on a busy machine is not this test's subject.
            loop {
                match client.call(on(true)).await {
                    Ok(reply) => {
                        assert_eq!(reply.message, "the second");
                        return Ok(());
                    }
                    Err(error) => assert!(error.is_unanswered(), "{error}"),
                }
            }
        })
        .unwrap();
    system.run().unwrap();
    assert_eq!(served.unanswered(), 1);
}
