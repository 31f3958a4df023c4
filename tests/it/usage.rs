//! Programs as users write them: the examples, and what the guide promises of a system as a whole.

use crate::common;
use common::{SpawnOk, skip, watchdog};
use luna::prelude::*;
use std::process::{Command, Stdio};
use std::time::Duration;

/// The output of an example, if it has been built beside the tests. `cargo test` builds it, other
/// runners may not.
fn run_example(name: &str) -> Option<String> {
    let tests = std::env::current_exe().unwrap();
    // From target/debug/deps/usage-… to target/debug/examples/name.
    let example = tests
        .ancestors()
        .nth(2)?
        .join("examples")
        .join(name)
        .with_extension(std::env::consts::EXE_EXTENSION);
    if !example.is_file() {
        skip(&format!("example `{name}` has not been built"));
        return None;
    }
    let output = common::output(
        Command::new(example)
            .stdin(Stdio::null())
            .stderr(Stdio::piped()),
    );
    assert!(output.status.success(), "{output:?}");
    Some(String::from_utf8(output.stdout).unwrap())
}

#[test]
fn hello() {
    let _watch = watchdog();
    let Some(output) = run_example("hello") else {
        return;
    };
    assert_eq!(
        output.lines().collect::<Vec<_>>(),
        ["0", "1", "2", "3", "4", "5", "6", "7", "8", "9"]
    );
}

/// As `examples/control_loop.rs`, for two hundred cycles instead of ten thousand, and with a
/// result.
#[test]
fn a_control_loop_with_an_operator() {
    let _watch = watchdog();
    let mut system = System::new("servo");
    system.lock_memory();
    let control = system
        .executor("control")
        .core(0)
        .policy(Policy::fifo(80))
        .build()
        .unwrap();
    let console = system.thread("console").policy(Policy::Other);
    let (setpoint, setpoints) = luna::buffered::<f64>(Buffer::overwrite_oldest(1));
    let (reached, answer) = luna::channel();
    control.process("loop").priority(20).spawn_ok(async move {
        let mut tick = luna::periodic("loop", Duration::from_millis(1))?;
        let mut target = 0.0;
        for _ in 0..200 {
            tick.next().await;
            if let Ok(new) = setpoints.try_recv() {
                target = new;
            }
        }
        // The operator may be kept from its core for longer than all this takes.
        while target != 1.0 {
            target = setpoints.recv().await?;
        }
        Ok(reached.send(target).await?)
    });
    console.process("operator").spawn_ok(async move {
        setpoint.send(0.5).await?;
        setpoint.send(1.0).await?;
        assert_eq!(answer.recv().await?, 1.0, "the newest");
        Ok(())
    });
    let report = system.run().unwrap();
    assert_eq!(report.loops["loop"].cycles, 200);
    assert!(
        report
            .to_string()
            .lines()
            .any(|line| line.starts_with("loop "))
    );
}

/// A drive with three phases, as in the usage programs.
struct Drive {
    output: Sender<i16>,
    history: Vec<f64>,
}

impl Process for Drive {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.history.reserve_exact(100);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        let mut tick = luna::periodic("drive", Duration::from_millis(1))?;
        for n in 0..100 {
            tick.next().await;
            let value = (f64::from(n) * 0.001).sin();
            self.history.push(value);
            self.output.send((value * 1000.0) as i16).await?;
        }
        Ok(())
    }

    fn post_run(&mut self) {
        assert_eq!((self.history.len(), self.history.capacity()), (100, 100));
    }
}

#[test]
fn a_drive_and_its_motor() {
    let _watch = watchdog();
    let (output, motor) = luna::channel();
    let mut system = System::new("drive");
    let control = system
        .executor("control")
        .policy(Policy::fifo(80))
        .build()
        .unwrap();
    system.on_emergency("motor to neutral", || panic!("there is no emergency"));
    control.process("drive").priority(20).spawn_ok(Drive {
        output,
        history: Vec::new(),
    });
    let turns = async move {
        let mut values = Vec::new();
        while let Ok(value) = motor.recv().await {
            values.push(value);
        }
        assert_eq!((values.len(), values[0], values[99]), (100, 0, 98));
        Ok(())
    };
    control.process("motor").priority(19).spawn_ok(turns);
    assert_eq!(system.run().unwrap().end, luna::End::Completed);
}

/// The end of a network by poison, across executors and a thread.
#[test]
fn poison_ends_a_network() {
    let _watch = watchdog();
    let mut system = System::new("network");
    let left = system.executor("left").build().unwrap();
    let right = system.executor("right").build().unwrap();
    let (out, input) = luna::channel::<u64>();
    let (pass, passed) = luna::channel::<u64>();
    let produce = async move {
        for n in 0..1000 {
            out.send(n).await?;
        }
        out.poison(); // each process that waits on it, or comes to it later, ends
        Ok(())
    };
    left.process("producer").spawn_ok(produce);
    let failover = async move {
        loop {
            match input.recv().await {
                Ok(n) => pass.send(n).await?,
                Err(error) => {
                    assert!(error.is_poisoned());
                    pass.poison();
                    return Ok(());
                }
            }
        }
    };
    right.process("failover").spawn_ok(failover);
    let consume = async move {
        for n in 0..1000 {
            assert_eq!(passed.recv().await?, n);
        }
        Ok(passed.recv().await.map(drop)?)
    };
    system.thread("own").process("consumer").spawn_ok(consume);
    let error = system.run().unwrap_err();
    assert!(error.is_poisoned(), "{error:?}");
    assert!(
        error.to_string().starts_with("process `consumer`: "),
        "{error}"
    );
}
