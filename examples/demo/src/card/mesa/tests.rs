//! The model with a simulated card: it follows its joystick as with any other machine.

use luna::devices::DeviceState;
use luna::prelude::*;
use luna_jiwy::joystick::Recording;
use luna_jiwy::{AXES, Executors, Settings, Start, network};
use luna_mesa_sim::{PlantWorld, Server};
use luna_plants::PanTilt;
use std::time::Duration;

/// Errors that correctly end a link when the computer delays it, or the simulated card; the link's
/// own tests cover them.
const HELD_UP: [&str; 4] = [
    "its counter may have wrapped",
    "did not come in time",
    "watchdog has expired",
    "no set-point for",
];

#[test]
fn follows_its_joystick_through_a_card() {
    // On a busy machine it may be delayed longer than an encoder may be unread; not each time.
    for _ in 0..10 {
        let Err(error) = follow() else { return };
        let text = error.to_string();
        assert!(HELD_UP.iter().any(|one| text.contains(one)), "{text}");
        eprintln!("once more: {text}");
    }
    panic!("the link ends each time");
}

fn follow() -> luna::Result<()> {
    let camera = PanTilt::jiwy(AXES.each_ref().map(|axis| axis.count_at_zero));
    let server = Server::start(luna_mesa_sim::Settings {
        world: Box::new(PlantWorld::new(camera)),
        ..Default::default()
    })
    .unwrap();
    let mut system = System::new("jiwy");
    let executors = Executors {
        control: system.executor("control").build().unwrap(),
        mechanism: system.executor("mechanism").build().unwrap(),
        operator: system.executor("operator").build().unwrap(),
    };
    let settings = Settings {
        period: Duration::from_millis(10),
        cycles: 300,
        start: Start::Calibrated,
        joystick: Recording::built_in().play(),
    };
    let address = server.address();
    let machine = super::mesa(&system, &executors.mechanism, address, settings.period).unwrap();
    let findings = network::build(&executors, machine.registers, settings).unwrap();
    drop(executors);
    assert_eq!(system.devices().list()[0].state, DeviceState::Open);
    system.run()?;
    assert_eq!(system.devices().list()[0].state, DeviceState::Closed);
    for (axis, findings) in AXES.iter().zip(&findings) {
        let tracking = findings.tracking.get().unwrap();
        // It was controlled: without, it would not follow at all.
        assert!(tracking.rms() < 0.2, "{}: {}", axis.name, tracking.rms());
    }
    assert!(machine.health.cycles() > 200);
    assert!(server.with_card(|card, _| card.duty(0) == 0.0 && card.duty(1) == 0.0));
    Ok(())
}
