//! One process on a device's files and on a plant.

use super::{MS, system};
use crate::spawn::SpawnOk;
use luna::external::{Framing, FromBytes, Malformed, ToBytes};
use luna::prelude::*;
use luna_plants::{Checked, FirstOrderLag, PlantLink, Port};
use std::io::{Read, Write};
use std::sync::{Arc, Mutex};
use std::time::Duration;

#[derive(Clone, Copy)]
struct Power(f64);

impl From<Power> for f64 {
    fn from(power: Power) -> f64 {
        power.0
    }
}

impl ToBytes for Power {
    fn length(&self) -> usize {
        8
    }

    fn to_bytes(&self, to: &mut [u8]) {
        to.copy_from_slice(&self.0.to_le_bytes());
    }
}

#[derive(Clone, Copy, PartialEq, Debug)]
struct Temperature(f64);

impl luna_plants::Measured for Temperature {
    const NAME: &str = "temperature";

    fn from_value(value: f64) -> Option<Self> {
        Some(Self(value))
    }
}

impl FromBytes for Temperature {
    fn from_bytes(bytes: &[u8]) -> Result<Self, Malformed> {
        let bytes = bytes
            .try_into()
            .map_err(|_| Malformed("a temperature has 8 bytes"))?;
        Ok(Self(f64::from_le_bytes(bytes)))
    }
}

fn oven() -> FirstOrderLag {
    FirstOrderLag::new(
        Port::new("power", "W"),
        Port::new("temperature", "K"),
        1.0,
        Duration::from_secs(20),
    )
}

/// The control process, for hardware and for a plant.
async fn control(
    temperatures: Receiver<Temperature>,
    power: Sender<Power>,
    seen: Arc<Mutex<Vec<Temperature>>>,
) -> luna::Result<()> {
    for _ in 0..200 {
        let temperature = temperatures.recv().await?;
        seen.lock().unwrap().push(temperature);
        power.send(Power(20.0 * (80.0 - temperature.0))).await?;
    }
    Ok(())
}

#[test]
fn the_same_process_runs_on_a_device_and_on_a_plant() {
    let run = |on_device: bool| {
        let (system, main) = system("oven");
        let (power, heating) = luna::channel::<Power>();
        let (measured, temperatures) = luna::channel::<Temperature>();
        let seen = Arc::new(Mutex::new(Vec::new()));
        main.process("control")
            .spawn_ok(control(temperatures, power, seen.clone()));
        if on_device {
            let (mut commands, to_device) = std::io::pipe().unwrap();
            let (from_device, mut measurements) = std::io::pipe().unwrap();
            let device = std::thread::spawn(move || {
                let mut oven = Checked::new(oven());
                let mut bytes = [0; 8];
                loop {
                    let temperature = oven.get("temperature").unwrap();
                    if measurements.write_all(&temperature.to_le_bytes()).is_err()
                        || commands.read_exact(&mut bytes).is_err()
                    {
                        return;
                    }
                    oven.set("power", f64::from_le_bytes(bytes)).unwrap();
                    oven.step(100 * MS).unwrap();
                }
            });
            main.process("heater").spawn_ok(luna::external::output(
                heating,
                to_device,
                Framing::fixed(8),
            ));
            main.process("thermometer").spawn_ok(luna::external::input(
                from_device,
                measured,
                Framing::fixed(8),
            ));
            system.run().unwrap();
            device.join().unwrap();
        } else {
            let mut link = PlantLink::new("oven", oven());
            link.actuator("power", heating).unwrap();
            link.sensor("temperature", measured).unwrap();
            main.process("oven")
                .spawn_ok(link.lock_step(100 * MS).unwrap());
            system.run().unwrap();
        }
        Arc::into_inner(seen).unwrap().into_inner().unwrap()
    };
    let simulated = run(false);
    assert_eq!(simulated.len(), 200);
    assert_eq!(run(true), simulated);
}
