//! The drive of the usage example for the three phases, apart from its logged signal: its
//! `post_run` runs in order, and after an emergency.

use crate::common;
use common::{Log, SpawnOk, watchdog};
use luna::prelude::*;
use luna::{End, Error};
use std::time::Duration;

struct Drive {
    output: Sender<i16>,
    history: Vec<f64>,
    log: Log,
    cycles: usize,
    then_raises: bool,
}

impl Process for Drive {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.history.reserve_exact(self.cycles);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        let mut tick = luna::periodic("drive", Duration::from_millis(1))?;
        for n in 0..self.cycles {
            tick.next().await;
            let value = (n as f64 * 0.001).sin();
            self.history.push(value);
            self.output.send((value * 1000.0) as i16).await?;
        }
        match self.then_raises {
            true => Err(luna::emergency(Error::other("no encoder"))),
            false => Ok(()),
        }
    }

    fn post_run(&mut self) {
        let cycles = self.history.len();
        self.log.add(format!("post_run, {cycles}"));
        self.history.clear();
    }
}

fn run(then_raises: bool) -> (luna::Result<luna::Report>, luna::Report, Vec<String>) {
    let log = Log::default();
    let (output, motor) = luna::channel();
    let mut system = System::new("drive");
    system.virtual_clock();
    let control = system
        .executor("control")
        .policy(Policy::fifo(80))
        .build()
        .unwrap();
    system.on_emergency("motor to neutral", log.noter("neutral"));
    let drive = Drive {
        output,
        history: Vec::new(),
        log: log.clone(),
        cycles: 10_000,
        then_raises,
    };
    control.process("drive").priority(20).spawn_ok(drive);
    control.process("motor").priority(19).spawn_ok(async move {
        while motor.recv().await.is_ok() {}
        Ok(())
    });
    let outcome = system.run();
    (outcome, system.report().unwrap(), log.all())
}

#[test]
fn in_order() {
    let _watch = watchdog();
    let (outcome, report, log) = run(false);
    outcome.unwrap();
    assert_eq!(
        (report.end, report.loops["drive"].cycles),
        (End::Completed, 10_000)
    );
    assert_eq!(log, ["post_run, 10000"]);
}

#[test]
fn after_an_emergency() {
    let _watch = watchdog();
    let (outcome, report, log) = run(true);
    assert_eq!(
        outcome.unwrap_err().to_string(),
        "process `drive`: no encoder"
    );
    assert_eq!(report.end, End::Emergency);
    assert_eq!(log, ["neutral", "post_run, 10000"]);
}
