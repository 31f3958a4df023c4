//! Six hosts: network namespaces of this computer, connected by a bridge. A unit in one of them
//! reaches the others by its network alone, as on a computer of its own.

use super::{Cell, Children, Program, Settings, of_a_program, operated, system_of};
use crate::links::Hosts;
use crate::parameters::Unit;
use crate::unit;
use luna::prelude::*;
use luna_net::{Config, Network};
use std::fmt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::str::FromStr;
use std::time::Duration;

const PORT: u16 = 7447;
/// After this silence a unit is lost: well before a neighbour could reach it.
const LOST_AFTER: Duration = Duration::from_millis(400);

/// The addresses of a cell's hosts: 10.213.`n`.1 to .6 for the units, .254 for the operator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Subnet(u8);

impl Subnet {
    fn host(self, host: u8) -> String {
        format!("10.213.{}.{host}", self.0)
    }

    fn unit(self, unit: Unit) -> String {
        self.host(unit as u8 + 1)
    }

    fn operator(self) -> String {
        self.host(254)
    }
}

impl fmt::Display for Subnet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl FromStr for Subnet {
    type Err = std::num::ParseIntError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        text.parse().map(Self)
    }
}

fn config(listens: &str) -> Config {
    Config::network()
        .listen(&format!("tcp/{listens}:{PORT}"))
        .lost_after(LOST_AFTER)
}

fn connected(config: Config, to: &str) -> Config {
    config.connect(&format!("tcp/{to}:{PORT}"))
}

/// Adds the operator of a cell to `system`, and starts its six units, each in a network namespace
/// of its own. Needs root and the command `ip` (iproute2). The namespaces are removed when the
/// result is dropped.
///
/// # Errors
///
/// A namespace or a program cannot be made, the network cannot be opened, or those of building the
/// system.
pub fn on_six_hosts(
    system: &mut System,
    program: Program,
    settings: Settings,
) -> luna::Result<Cell> {
    let subnet = Subnet((std::process::id() % 250) as u8);
    let namespaces = Namespaces::make(subnet)?;
    let network = Network::open(&config(&subnet.operator())).map_err(luna::Error::other)?;
    let children = Children::start_all(move |unit| {
        let mut command = Command::new("ip");
        command
            .args(["netns", "exec", &namespaces.name(unit)])
            .arg(&program.file)
            .args(&program.arguments)
            .args([unit.name(), &subnet.to_string()]);
        command
    })?;
    let executor = system.executor("operator").policy(Policy::Other).build()?;
    let mut links = Hosts::new(&executor, network);
    operated(&executor, &mut links, children, settings)
}

/// Runs one unit on a host, until its operator ends it, or is gone.
///
/// # Errors
///
/// Those of opening the network, and of building and running the system.
pub fn run_unit_on_host(
    unit: Unit,
    subnet: Subnet,
    world: &Path,
    policy: Policy,
) -> luna::Result<()> {
    // A pair of neighbours needs one connection: the unit behind makes it.
    let config = connected(config(&subnet.unit(unit)), &subnet.operator());
    let config = connected(config, &subnet.unit(unit.ahead()));
    let network = Network::open(&config).map_err(luna::Error::other)?;
    let (system, executor) = system_of(unit, policy)?;
    let mut links = Hosts::new(&executor, network);
    unit::build(unit, &executor, &mut links, of_a_program(world))?;
    drop(links);
    drop(executor);
    system.run().map(drop)
}

/// Network namespaces and the bridge between them.
struct Namespaces {
    /// What their names begin with.
    prefix: String,
}

impl Namespaces {
    fn make(subnet: Subnet) -> luna::Result<Self> {
        let made = Self {
            prefix: format!("lc{}", std::process::id()),
        };
        let bridge = &made.prefix;
        let operator = format!("{}/24", subnet.operator());
        ip(&["link", "add", bridge, "type", "bridge"])?;
        ip(&["addr", "add", &operator, "dev", bridge])?;
        ip(&["link", "set", bridge, "up"])?;
        for unit in Unit::ALL {
            let name = &made.name(unit);
            let address = format!("{}/24", subnet.unit(unit));
            let (cable, host) = (format!("{bridge}-{}", unit as u8), "eth0");
            ip(&["netns", "add", name])?;
            let ends = ["type", "veth", "peer", "name", host, "netns", name];
            ip(&[&["link", "add", &cable], &ends[..]].concat())?;
            ip(&["link", "set", &cable, "master", bridge, "up"])?;
            ip(&["-n", name, "addr", "add", &address, "dev", host])?;
            ip(&["-n", name, "link", "set", host, "up"])?;
            ip(&["-n", name, "link", "set", "lo", "up"])?;
        }
        Ok(made)
    }

    fn name(&self, unit: Unit) -> String {
        format!("{}-{}", self.prefix, unit.name())
    }
}

impl Drop for Namespaces {
    fn drop(&mut self) {
        // A cable goes with its namespace.
        for unit in Unit::ALL {
            let _ = ip(&["netns", "del", &self.name(unit)]);
        }
        let _ = ip(&["link", "del", &self.prefix]);
    }
}

/// Runs `ip`.
fn ip(arguments: &[&str]) -> luna::Result<()> {
    let run = Command::new("ip")
        .args(arguments)
        .stdin(Stdio::null())
        .output();
    let why = match run {
        Ok(output) if output.status.success() => return Ok(()),
        Ok(output) => String::from_utf8_lossy(&output.stderr).trim().to_owned(),
        Err(error) => error.to_string(),
    };
    Err(luna::Error::other(format!(
        "cannot make the network namespaces of six hosts: `ip {}` failed: {why}: run it as root, \
         with iproute2 installed",
        arguments.join(" "),
    )))
}
