//! Shared state: when a lock is right, and when a channel is.
//!
//! A machine has a table of gains that its operator changes now and then, and that two control
//! loops read in every cycle. It belongs to none of them, is not passed on, and is used only for a
//! moment: a mutex. A loop that waits while the operator writes boosts the operator to its own
//! priority, so that no process in between delays the loop. A condition notifies the logger of
//! changes, and a semaphore lets at most two motors start at a time, since the supply is limited.
//!
//! The set-points go from the operator to a loop, each once and in order: a channel. With a lock
//! they would need a flag and a condition; and the loop could not choose between a set-point and
//! its tick.
//!
//! ```text
//! cargo run --example shared_state
//! ```

use luna::prelude::*;
use luna::sync::{Condvar, LockError, Mutex, Semaphore};
use std::time::Duration;

#[derive(Debug, Clone, Copy, PartialEq)]
struct Gains {
    proportional: f64,
    integral: f64,
    version: u32,
}

impl Gains {
    /// The table's invariant, outside of a change.
    fn are_consistent(&self) -> bool {
        self.proportional == 2.0 * self.integral
    }
}

const CHANGES: u32 = 20;
const CYCLES: u32 = 100;

/// Changes the table in two steps, and waits in between: the intermediate state is never visible.
async fn operate(
    table: Mutex<Gains>,
    changed: Condvar,
    setpoints: Sender<f64>,
) -> luna::Result<()> {
    for version in 1..=CHANGES {
        let mut gains = table.lock().await?;
        gains.proportional = f64::from(version);
        luna::yield_now().await;
        gains.integral = f64::from(version) / 2.0;
        gains.version = version;
        drop(gains);
        changed.notify_all();
        setpoints.send(f64::from(version)).await?;
    }
    Ok(())
}

/// A loop: starts its motor, then reads the table in each cycle, and takes set-points as they come.
async fn control(
    name: &'static str,
    table: Mutex<Gains>,
    starts: Semaphore,
    setpoints: Option<Receiver<f64>>,
) -> luna::Result<()> {
    let permit = starts.acquire().await?;
    luna::after(Duration::from_millis(2)).await; // the motor needs a high current while it starts
    drop(permit);

    let mut received = Vec::new();
    let mut tick = luna::periodic(name, Duration::from_micros(500))?;
    for _ in 0..CYCLES {
        tick.next().await;
        let gains = *table.lock().await?; // a copy: locked for a moment
        assert!(gains.are_consistent(), "{gains:?}");
        while let Some(Ok(setpoint)) = setpoints.as_ref().map(Receiver::try_recv) {
            received.push(setpoint);
        }
    }
    if let Some(setpoints) = setpoints {
        while let Ok(setpoint) = setpoints.recv().await {
            received.push(setpoint);
        }
        let all: Vec<f64> = (1..=CHANGES).map(f64::from).collect();
        assert_eq!(received, all, "each once, and in order");
    }
    Ok(())
}

/// Prints the table as it changes, on an OS thread of its own, which may block.
async fn log(table: Mutex<Gains>, changed: Condvar) -> luna::Result<()> {
    let mut seen = 0;
    while seen < CHANGES {
        let mut gains = table.blocking_lock()?;
        while gains.version == seen {
            gains = changed.blocking_wait(gains)?;
        }
        let copy = *gains;
        drop(gains); // printing takes time, and the loops need the table
        seen = copy.version;
        println!("{copy:?}");
    }
    Ok(())
}

fn main() -> luna::Result<()> {
    let table = Mutex::new(Gains {
        proportional: 0.0,
        integral: 0.0,
        version: 0,
    })
    .named("gains");
    let changed = Condvar::new().named("gains changed");
    let starts = Semaphore::new(2).named("motor starts");
    let (setpoint, setpoints) = luna::channel();

    let mut system = System::new("shared state");
    let main = system.executor("main").build()?;
    main.process("operator").priority(5).spawn(operate(
        table.clone(),
        changed.clone(),
        setpoint,
    ))?;
    main.process("x axis").priority(20).spawn(control(
        "x axis",
        table.clone(),
        starts.clone(),
        Some(setpoints),
    ))?;
    for name in ["y axis", "z axis"] {
        let axis = control(name, table.clone(), starts.clone(), None);
        main.process(name).priority(19).spawn(axis)?;
    }
    let logger = system.thread("logger").process("logger");
    logger.spawn(log(table.clone(), changed))?;
    system.run()?;

    assert_eq!(table.try_lock()?.version, CHANGES);
    assert_eq!(starts.available_permits(), 2);

    // A panic in the middle of a change marks the mutex; the next holder decides how to continue.
    let broken = table.clone();
    let died = std::thread::spawn(move || {
        let mut gains = broken.blocking_lock().unwrap();
        gains.proportional = -1.0;
        panic!("on purpose, in the middle of a change");
    });
    assert!(died.join().is_err());
    let mut gains = match table.blocking_lock() {
        Err(LockError::OwnerDied(died)) => died.recover(),
        _ => unreachable!("it is marked"),
    };
    assert!(!gains.are_consistent());
    gains.proportional = 2.0 * gains.integral;
    drop(gains);
    assert!(table.try_lock()?.are_consistent());
    println!("three axes, {CHANGES} changes, none seen half done");
    Ok(())
}
