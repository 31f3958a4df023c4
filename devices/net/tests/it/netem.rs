//! A network that loses and delays packets: two namespaces of this computer's own, and netem.

use crate::child::Program;
use crate::kill::{check, folder, wait_for_progress};
use crate::shared::{skip, watchdog};
use std::process::Command;

/// Two namespaces that a pair of interfaces connects. Removed when dropped.
struct Namespaces([String; 2]);

fn ip(arguments: &str) -> Result<(), String> {
    let mut words = arguments.split_whitespace();
    let run = Command::new(words.next().unwrap_or_default())
        .args(words)
        .output();
    let output = run.map_err(|error| format!("`{arguments}`: {error}"))?;
    match output.status.success() {
        true => Ok(()),
        false => {
            let why = String::from_utf8_lossy(&output.stderr);
            Err(format!("`{arguments}`: {}", why.trim()))
        }
    }
}

impl Namespaces {
    fn new() -> Result<Self, String> {
        let pid = std::process::id();
        let names = ["a", "b"].map(|side| format!("luna-net-{pid}-{side}"));
        let made = Self(names);
        let [a, b] = &made.0;
        for name in [a, b] {
            ip(&format!("ip netns add {name}"))?;
        }
        ip(&format!(
            "ip -n {a} link add eth0 type veth peer name eth0 netns {b}"
        ))?;
        for (name, number) in [(a, 1), (b, 2)] {
            ip(&format!(
                "ip -n {name} addr add 10.99.0.{number}/24 dev eth0"
            ))?;
            ip(&format!("ip -n {name} link set eth0 up"))?;
            let netem = "root netem delay 5ms 2ms loss 3%";
            ip(&format!("tc -n {name} qdisc add dev eth0 {netem}"))?;
        }
        Ok(made)
    }
}

impl Drop for Namespaces {
    fn drop(&mut self) {
        for name in &self.0 {
            let _ = ip(&format!("ip netns del {name}"));
        }
    }
}

#[test]
fn no_value_is_lost_or_doubled_where_packets_are() {
    let _watchdog = watchdog();
    let namespaces = match Namespaces::new() {
        Ok(namespaces) => namespaces,
        Err(why) => return skip(&format!("no network with loss and delay: {why}")),
    };
    let folder = folder("netem");
    let place = folder.to_str().unwrap();
    let [a, b] = &namespaces.0;
    let start = |name: &str, task| {
        let command = ["ip", "netns", "exec", name];
        Program::start_by(&command, task, &["tcp/10.99.0.1:7447", place])
    };
    let mut programs = [start(a, "send"), start(b, "receive")];
    wait_for_progress(&folder.join("taken"), 8 * 200);
    std::fs::write(folder.join("stop"), "").unwrap();
    for program in &mut programs {
        assert!(program.wait().success());
    }
    check(&folder, "5 ms delay, 3 % loss");
}
