//! Values and calls between this program and CycloneDDS, another implementation of DDS, which uses
//! ROS 2's names and types: `tests/cyclone.py`.

use crate::{domain, node, shared};
use luna::prelude::*;
use luna_ros2::msg::builtin_interfaces::Time;
use luna_ros2::msg::sensor_msgs::JointState;
use luna_ros2::msg::std_msgs::{self, Header};
use luna_ros2::{Qos, Service};
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

luna_ros2::message! {
    /// Of the example of ROS 2.
    pub struct Two { pub a: i64, pub b: i64 }
}
luna_ros2::message! {
    /// Its answer.
    pub struct Sum { pub sum: i64 }
}
enum AddTwoInts {}
impl Service for AddTwoInts {
    type Request = Two;
    type Reply = Sum;
    const TYPE: &'static str = "example_interfaces/srv/AddTwoInts";
}

/// The other program.
struct Cyclone {
    child: Child,
    lines: BufReader<ChildStdout>,
    input: Option<ChildStdin>,
}

impl Cyclone {
    /// `None` where it cannot run, and it says so.
    fn start(domain: u16, arguments: &[&str]) -> Option<Self> {
        let python = std::env::var("LUNA_ROS2_PYTHON").unwrap_or_else(|_| "python3".to_owned());
        let probe = Command::new(&python)
            .args(["-c", "import cyclonedds.domain"])
            .stderr(Stdio::null())
            .status();
        match probe {
            Err(error) => {
                shared::skip(&format!("`{python}` does not start: {error}"));
                return None;
            }
            Ok(status) if !status.success() => {
                shared::skip(&format!(
                    "`{python}` has no package cyclonedds (pip install cyclonedds; LUNA_ROS2_PYTHON names another python)"
                ));
                return None;
            }
            Ok(_) => {}
        }
        let mut child = Command::new(python)
            .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/cyclone.py"))
            .arg(domain.to_string())
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap());
        let input = child.stdin.take();
        Some(Self {
            child,
            lines,
            input,
        })
    }

    /// Its next line, without its end; empty when it has ended.
    fn line(&mut self) -> String {
        let mut line = String::new();
        self.lines.read_line(&mut line).unwrap();
        line.trim_end().to_owned()
    }

    /// Each side finds the other by itself: when both have, it goes on.
    async fn begin(mut self, status: luna_ros2::Status) -> Self {
        status.wait_for_partners(1).await;
        let begun = luna::blocking(move || {
            assert_eq!(self.line(), "\"ready\"");
            self.input.as_ref().unwrap().write_all(b"go\n").unwrap();
            self
        });
        begun.await
    }

    /// Its last lines, before it ends without an error.
    async fn lines(mut self, count: usize) -> Vec<String> {
        let lines = luna::blocking(move || {
            let lines = (0..count).map(|_| self.line()).collect();
            self.end();
            lines
        });
        lines.await
    }

    fn end(mut self) {
        self.input = None;
        let status = self.child.wait().unwrap();
        assert!(status.success(), "{status}");
    }
}

fn joints(number: i32) -> JointState {
    JointState {
        header: Header {
            stamp: Time {
                sec: number,
                nanosec: 500,
            },
            frame_id: "base".to_owned(),
        },
        name: vec!["shoulder".to_owned(), "elbow".to_owned()],
        position: vec![f64::from(number) + 0.25, -1.5],
        velocity: vec![0.5],
        effort: vec![],
    }
}

fn hello(number: i32) -> std_msgs::String {
    std_msgs::String {
        data: format!("hello {number}"),
    }
}

/// What Cyclone publishes comes here.
fn from_cyclone<M>(kind: &str, topic: &str, expected: impl Fn(i32) -> M + Send + 'static)
where
    M: luna_ros2::Message + PartialEq + std::fmt::Debug,
{
    let domain = domain();
    let node = node(domain, "listener");
    let (receiver, link) = node
        .subscription::<M>(topic, Qos::default().depth(100))
        .unwrap();
    let status = link.status();
    let (begun, name) = (status.clone(), topic.trim_start_matches('/'));
    let Some(cyclone) = Cyclone::start(domain, &["publish", name, kind, "20"]) else {
        return;
    };
    let body = async move {
        let cyclone = cyclone.begin(begun).await;
        for number in 0..20 {
            let received = receiver.recv().await?;
            assert_eq!(received.value, expected(number));
            assert!(received.sent.is_some());
        }
        assert_eq!(cyclone.lines(1).await, ["\"sent\""]);
        Ok(())
    };
    crate::run([link], body).unwrap();
    assert_eq!((status.carried(), status.malformed()), (20, 0));
}

#[test]
fn strings_come_from_cyclone() {
    own_process!();
    from_cyclone("string", "/chatter", hello);
}

#[test]
fn joint_states_come_from_cyclone() {
    own_process!();
    from_cyclone("joints", "/arm/joint_states", joints);
}

/// What is published here comes to Cyclone.
fn to_cyclone<M: luna_ros2::Message>(
    kind: &str,
    make: impl Fn(i32) -> M + Send + Sync + 'static,
    expected: impl Fn(i32) -> String + Send + 'static,
) {
    let domain = domain();
    let node = node(domain, "talker");
    let (sender, link) = node
        .publisher::<M>("/from_luna", Qos::default().depth(100))
        .unwrap();
    let status = link.status();
    let arguments = ["subscribe", "from_luna", kind, "20"];
    let Some(cyclone) = Cyclone::start(domain, &arguments) else {
        return;
    };
    let body = async move {
        // What comes before a first heartbeat is dropped there.
        let (heard, is_heard) = luna::channel::<()>();
        let begin = async {
            let cyclone = cyclone.begin(status).await;
            drop(heard);
            Ok::<_, luna::Error>(cyclone)
        };
        let warm_up = async {
            while is_heard.try_recv().is_err_and(|error| error.is_empty()) {
                sender.send(make(-1)).await?;
                luna::after(Duration::from_millis(10)).await;
            }
            Ok(())
        };
        let (cyclone, ()) = par!(begin, warm_up).await?;
        for number in 0..20 {
            sender.send(make(number)).await?;
        }
        for (number, line) in (0..).zip(cyclone.lines(20).await) {
            assert_eq!(line, expected(number));
        }
        Ok(())
    };
    crate::run([link], body).unwrap();
}

#[test]
fn strings_go_to_cyclone() {
    own_process!();
    to_cyclone("string", hello, |number| format!("\"hello {number}\""));
}

#[test]
fn joint_states_go_to_cyclone() {
    own_process!();
    to_cyclone("joints", joints, |number| {
        format!(
            "[{number}, 500, \"base\", [\"shoulder\", \"elbow\"], [{number}.25, -1.5], [0.5], []]"
        )
    });
}

#[test]
fn cyclone_calls_a_service_of_this_program() {
    own_process!();
    let domain = domain();
    let node = node(domain, "adder");
    let (server, link) = node.service::<AddTwoInts>("/add_two_ints").unwrap();
    let status = link.status();
    let arguments = ["call", "add_two_ints", "10"];
    let Some(cyclone) = Cyclone::start(domain, &arguments) else {
        return;
    };
    let body = async move {
        let cyclone = cyclone.begin(status).await;
        let (over, is_over) = luna::channel::<()>();
        let serve = async {
            loop {
                alt! {
                    call = server.accept() => {
                        let call = call?;
                        let sum = call.a + call.b;
                        // The thread of the link waits for it.
                        call.reply(Sum { sum }).unwrap();
                    },
                    _ = is_over.recv() => return Ok(()),
                }
            }
        };
        let compare = async {
            for (number, line) in (1..).zip(cyclone.lines(10).await) {
                assert_eq!(line, (number + 40).to_string());
            }
            drop(over);
            Ok::<(), luna::Error>(())
        };
        par!(serve, compare).await?;
        Ok(())
    };
    crate::run([link], body).unwrap();
}

#[test]
fn this_program_calls_a_service_of_cyclone() {
    own_process!();
    let domain = domain();
    let node = node(domain, "asker");
    let patience = Duration::from_secs(2);
    let (client, link) = node
        .client_with_patience::<AddTwoInts>("/add_two_ints", patience)
        .unwrap();
    let status = link.status();
    let arguments = ["serve", "add_two_ints"];
    let Some(cyclone) = Cyclone::start(domain, &arguments) else {
        return;
    };
    let body = async move {
        let cyclone = cyclone.begin(status).await;
        for number in 0..10 {
            // The first one may be lost, as at any start: then again.
            let reply = loop {
                match client.call(Two { a: number, b: -5 }).await {
                    Ok(reply) => break reply,
                    Err(error) => assert!(error.is_unanswered() && number == 0, "{error}"),
                }
            };
            assert_eq!(reply.sum, number - 5);
        }
        assert!(cyclone.lines(0).await.is_empty());
        Ok(())
    };
    crate::run([link], body).unwrap();
}
