//! An oven behind a PLC: a control loop of 1 kHz that never waits for it.
//!
//! The PLC is simulated, with a slow answer, and for a while it is away. The loop has the newest
//! temperature, and switches the heater. The example ends by itself with a verdict.

use luna::prelude::*;
use luna_modbus::sim::{Fault, Server};
use luna_modbus::{Event, Reconnect, coil, input};
use std::sync::Arc;
use std::time::Duration;

const SET_POINT: f32 = 60.0;
const CYCLES: u32 = 3_000;

fn main() -> luna::Result<()> {
    let plc = Arc::new(Server::start()?);
    plc.set(input::<f32>(0), 20.0)?;
    plc.fault(Fault::Slow(Duration::from_millis(2)));

    let mut system = System::new("oven");
    let server = luna_modbus::open(&system.devices(), plc.address())?;
    let (value, temperature) = luna::buffered::<f32>(Buffer::overwrite_oldest(1));
    let (heater, switch) = luna::buffered::<bool>(Buffer::overwrite_oldest(1));
    let (event, events) = luna::buffered::<Event>(Buffer::fifo(16));
    let client = luna_modbus::client(&server, Duration::from_millis(10), event)?
        .timeout(Duration::from_millis(200))?
        .reconnect(Reconnect::backing_off(
            Duration::from_millis(10),
            Duration::from_millis(100),
        ))
        .read(input::<f32>(0), value)?
        .write(coil(0), switch)?;
    let counts = client.counts();

    // On a machine for it, this one has a real-time policy and a core of its own.
    let control = system.executor("control").build()?;
    // The client has neither.
    let field = system.executor("field").build()?;
    field.process("plc").spawn(client)?;
    field.process("events").spawn(async move {
        while let Ok(event) = events.recv().await {
            println!("{event}");
        }
        Ok(())
    })?;
    let (done, ended) = luna::channel::<()>();
    let oven = plc.clone();
    field.process("oven").spawn(async move {
        let mut celsius = 20.0_f32;
        let mut tick = luna::periodic("oven", Duration::from_millis(5))?;
        let mut cycle = 0;
        while ended.try_recv().is_err_and(|error| error.is_empty()) {
            tick.next().await;
            let power = if oven.get(coil(0))? { 1.0 } else { 0.0 };
            celsius += power - (celsius - 20.0) * 0.01;
            oven.set(input::<f32>(0), celsius)?;
            cycle += 1;
            match cycle {
                300 => oven.fault(Fault::HangsUp),
                340 => oven.fault(Fault::None),
                _ => {}
            }
        }
        Ok(())
    })?;
    let (report, reported) = std::sync::mpsc::channel();
    control.process("control").spawn(async move {
        let mut tick = luna::periodic("control", Duration::from_millis(1))?;
        let (mut celsius, mut news, mut oldest, mut age) = (20.0, 0_u32, 0, 0);
        for _ in 0..CYCLES {
            tick.next().await;
            match temperature.try_recv() {
                Ok(newest) => (celsius, news, age) = (newest, news + 1, 0),
                Err(_) => age += 1,
            }
            oldest = oldest.max(age);
            // A value of long ago is none to heat by.
            heater.try_send(celsius < SET_POINT && age < 100)?;
        }
        drop(done);
        let _ = report.send((celsius, news, oldest));
        Ok(())
    })?;
    drop(server);
    system.run()?;

    let (celsius, news, oldest) = reported.try_recv().map_err(luna::Error::other)?;
    println!("{celsius:.1} °C at the end; {news} values, the oldest {oldest} ms old; {counts:?}");
    let is_warm = (celsius - SET_POINT).abs() < 5.0;
    let is_back = counts.connections() >= 2;
    match is_warm && is_back && counts.written() > 0 {
        true => println!("ok: the oven was kept at {SET_POINT} °C, and the PLC was found again"),
        false => return Err(luna::Error::other("the oven was not kept warm")),
    }
    Ok(())
}
