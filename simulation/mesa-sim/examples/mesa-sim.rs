//! A simulated 7I92 with Jiwy behind it, until it is interrupted.

use luna_mesa_sim::{PlantWorld, Server, Settings};
use luna_plants::PanTilt;
use std::net::SocketAddr;
use std::process::ExitCode;

const USAGE: &str = "\
Serves a simulated Mesa 7I92 with a pan-tilt camera behind it: PWM generators 0 and 1 drive its motors, encoders 0 and 1 count.

usage: mesa-sim [ADDRESS:PORT]    127.0.0.1:27181 if not stated";

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let address = match (arguments.next(), arguments.next()) {
        (None, _) => SocketAddr::from(([127, 0, 0, 1], hostmot2::PORT)),
        (Some(text), None) => match text.parse() {
            Ok(address) => address,
            Err(_) => {
                eprintln!("{USAGE}");
                return ExitCode::from(2);
            }
        },
        _ => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
    };
    let settings = Settings {
        address,
        world: Box::new(PlantWorld::new(PanTilt::jiwy([0, 0]))),
        ..Settings::default()
    };
    match Server::start(settings) {
        Ok(server) => {
            println!("a simulated 7I92 listens at {}", server.address());
            loop {
                std::thread::park();
            }
        }
        Err(error) => {
            eprintln!("mesa-sim: cannot listen at {address}: {error}");
            ExitCode::FAILURE
        }
    }
}
