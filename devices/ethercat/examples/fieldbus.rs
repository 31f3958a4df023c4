//! A drive is moved to targets over a simulated bus, in virtual time, while the loop follows the
//! bus' clock and some frames are lost. Fails if it does not arrive, or the loop is not in step.
//!
//! `cargo run -p luna-ethercat --example fieldbus`

use luna::Error;
use luna::prelude::*;
use luna::time::FollowState;
use luna_ethercat::sim::{Network, Servo, SubDevice};
use luna_ethercat::{Expected, Sample, Wire};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);
/// By how much frames may miss their phase at the end (ns).
const BOUND: i64 = 200;
const TERMINAL: usize = 0;
const DRIVE: usize = 1;
/// Where the drive is to go, one after the other (counts).
const TARGETS: [i32; 3] = [20_000, -5_000, 0];

fn main() -> luna::Result<()> {
    // With a cable: `Wire::interface("eth0")`, the devices that are there, and no virtual clock.
    let network = Network::on_virtual_time();
    network.add(SubDevice::digital(8, 8).with_clock(60.0));
    network.add(SubDevice::servo().with_clock(-25.0));
    let wire = Wire::simulated(&network);
    let expected = [
        Expected::new("terminal", SubDevice::VENDOR, SubDevice::DIGITAL),
        Expected::new("drive", SubDevice::VENDOR, SubDevice::SERVO)
            .sync0()
            .sdo(0x6060, 0, Servo::VELOCITY), // its mode of operation
    ];

    let mut system = System::new("fieldbus");
    system.virtual_clock();
    let bus = luna_ethercat::open(&system.devices(), &wire, &expected).map_err(Error::other)?;
    for (position, found) in bus.subdevices().iter().enumerate() {
        println!(
            "{position}: {found}, {} bytes out, {} in",
            found.outputs, found.inputs
        );
    }
    let (position, positions) = luna::buffered::<Sample<i32>>(Buffer::overwrite_oldest(1));
    let (control, controls) = luna::buffered::<u16>(Buffer::overwrite_oldest(1));
    let (velocity, velocities) = luna::buffered::<i32>(Buffer::overwrite_oldest(1));
    let (lamp, lamps) = luna::buffered::<bool>(Buffer::overwrite_oldest(1));
    let mut link = bus.link("bus", PERIOD);
    link.follow_clock(PERIOD / 2)
        .input(DRIVE, 2, position)
        .output(DRIVE, 0, 0, controls)
        .output(DRIVE, 2, 0, velocities)
        .output_bit(TERMINAL, 0, false, lamps);
    let process = link.process().map_err(Error::other)?;
    let health = process.health();
    network.lose_one_in(Some(50));

    let main = system.executor("main").build()?;
    main.process("bus").priority(20).spawn(process)?;
    main.process("control").spawn(async move {
        for target in TARGETS {
            let mut arrived = 0;
            while arrived < 10 {
                let sample = positions.recv().await?;
                let error = target - sample.held();
                arrived = if error.abs() < 100 { arrived + 1 } else { 0 };
                // It goes on for three cycles without an answer, and then stops.
                let wanted = if sample.stale_cycles() <= 3 {
                    8 * error
                } else {
                    0
                };
                control.send(Servo::ENABLED).await?;
                velocity.send(wanted.clamp(-40_000, 40_000)).await?;
                lamp.send(error.abs() >= 100).await?;
            }
            println!("arrived at {target}");
        }
        Ok(())
    })?;
    system.run()?;
    println!(
        "{} cycles, {} without an answer; the clock's period is longer by {:.0} ppm, the phase error {} ns",
        health.cycles(),
        health.missed(),
        health.rate_ppm(),
        health.phase_error(),
    );
    let is_in_step = health.clock() == FollowState::Locked && health.phase_error().abs() < BOUND;
    let is_safe = network.outputs(DRIVE).iter().all(|byte| *byte == 0);
    match is_in_step && is_safe && health.missed() > 0 {
        true => println!("ok: the drive was moved, and its outputs are safe"),
        false => {
            return Err(Error::other(
                "the loop is not in step, or the outputs are not safe",
            ));
        }
    }
    Ok(())
}
