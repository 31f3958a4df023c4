//! The device behind the demo's registers: processes that simulate the machine, or a card.

mod mesa;

use crate::failure::{Failure, unusable};
use luna::{Policy, System};
use luna_jiwy::{AXES, hardware};
use luna_mesa::Health;
use luna_mesa_sim::{PlantWorld, Server, Settings};
use luna_plants::{MotorState, PanTilt};
use std::net::{SocketAddr, ToSocketAddrs};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

/// Which card.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Choice {
    /// A simulated one in this program.
    MesaSim,
    /// A real one.
    Mesa(SocketAddr),
}

/// What is known of the machine at the end.
pub(crate) enum Machine {
    Processes([Arc<OnceLock<MotorState>>; 2]),
    SimulatedCard {
        states: Arc<Mutex<[MotorState; 2]>>,
        health: Arc<Health>,
        /// Dropping it ends the simulated card.
        _server: Server,
    },
    Card(Arc<Health>),
}

/// The option's value.
pub(crate) fn parse(text: &str) -> Result<Choice, String> {
    if text == "mesa-sim" {
        return Ok(Choice::MesaSim);
    }
    let wrong = "it must be mesa-sim or mesa:HOST, perhaps with :PORT";
    let host = text.strip_prefix("mesa:").ok_or(wrong)?;
    let with_port = (host, hostmot2::PORT)
        .to_socket_addrs()
        .or_else(|_| host.to_socket_addrs());
    let address = with_port.ok().and_then(|mut addresses| addresses.next());
    Ok(Choice::Mesa(address.ok_or("there is no such host")?))
}

/// Adds the machine, or the link to it, to the system. What controls it has `policy`.
pub(crate) fn machine(
    choice: Option<&Choice>,
    system: &mut System,
    executor: &luna::Executor,
    period: Duration,
    policy: Policy,
) -> Result<([hardware::Registers; 2], Machine), Failure> {
    let (address, simulated) = match choice {
        None => {
            let hardware::Simulated { registers, states } =
                hardware::simulated(system, executor, period)?;
            return Ok((registers, Machine::Processes(states)));
        }
        Some(Choice::Mesa(address)) => (*address, None),
        Some(Choice::MesaSim) => {
            let (server, states) = simulate(policy)?;
            (server.address(), Some((server, states)))
        }
    };
    let mesa::Behind { registers, health } = mesa::mesa(system, executor, address, period)?;
    let machine = match simulated {
        Some((_server, states)) => Machine::SimulatedCard {
            states,
            health,
            _server,
        },
        None => Machine::Card(health),
    };
    Ok((registers, machine))
}

type States = Arc<Mutex<[MotorState; 2]>>;

/// A card with threads above those with `policy`: hardware is never late.
fn simulate(policy: Policy) -> Result<(Server, States), Failure> {
    let states = States::default();
    let watched = states.clone();
    let camera = PanTilt::jiwy(AXES.each_ref().map(|axis| axis.count_at_zero));
    let world = PlantWorld::new(camera).watched(move |camera: &PanTilt| {
        *watched.lock().unwrap_or_else(PoisonError::into_inner) = camera.states();
    });
    let settings = Settings {
        world: Box::new(world),
        policy: match policy {
            Policy::Fifo(priority) | Policy::RoundRobin(priority) => {
                Policy::Fifo((priority + 1).min(97))
            }
            other => other,
        },
        ..Settings::default()
    };
    let server = Server::start(settings).map_err(|error| unusable("card", error))?;
    Ok((server, states))
}

impl Machine {
    /// Where the joints are at the end, as far as it is known.
    pub(crate) fn states(&self) -> [MotorState; 2] {
        match self {
            Machine::Processes(states) => states
                .each_ref()
                .map(|state| state.get().copied().unwrap_or_default()),
            Machine::SimulatedCard { states, .. } => {
                *states.lock().unwrap_or_else(PoisonError::into_inner)
            }
            Machine::Card(_) => Default::default(),
        }
    }

    /// What the link to the card has counted, as a line; empty without one.
    pub(crate) fn card(&self) -> String {
        let (Machine::SimulatedCard { health, .. } | Machine::Card(health)) = self else {
            return String::new();
        };
        format!(
            "card: {} cycles, {} without an answer ({} in a row at most), {} late or doubled answers, {} writes behind\n",
            health.cycles(),
            health.missed(),
            health.longest_silence(),
            health.dropped(),
            health.writes_behind()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cards_are_read() {
        assert_eq!(parse("mesa-sim"), Ok(Choice::MesaSim));
        let at = |port| Ok(Choice::Mesa(SocketAddr::from(([192, 168, 1, 121], port))));
        assert_eq!(parse("mesa:192.168.1.121"), at(27181));
        assert_eq!(parse("mesa:192.168.1.121:4000"), at(4000));
        for wrong in ["mesa", "mesa:", "simulated", "mesa:127.0.0.1:x"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
