//! `luna echo` and `luna send`. The test is the other program.

use crate::run::{command, luna, text};
use luna::prelude::*;
use luna::{Policy, Process};
use luna_ipc::{Blackboard, ZeroCopySend};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::{Child, Stdio};
use std::thread::JoinHandle;
use std::time::Duration;

/// What is not so after this time never will be.
pub(crate) const LIMIT: Duration = Duration::from_secs(60);

#[repr(C)]
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[type_name("cell::Block")]
struct Block {
    number: u64,
    height: f64,
}

/// What it has printed, if it was content.
pub(crate) fn good(arguments: &[&str]) -> String {
    let output = luna(arguments);
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {error}");
    text(&output.stdout).to_owned()
}

/// Its exit code and what it says.
pub(crate) fn bad(arguments: &[&str]) -> (i32, String) {
    let output = luna(arguments);
    let code = output.status.code().expect("a code");
    (code, text(&output.stderr).to_owned())
}

pub(crate) fn list(arguments: &[&str]) -> Value {
    let printed = good(&[&["list", "--json"], arguments].concat());
    serde_json::from_str(&printed).expect("one JSON object")
}

/// A name that no other test has.
pub(crate) fn name(test: &str) -> String {
    format!("test/{}/{test}", std::process::id())
}

/// A link and a process that uses its channel, on a thread of this program.
pub(crate) fn run(
    link: impl Process + Send + 'static,
    body: impl Future<Output = luna::Result<()>> + Send + 'static,
) -> JoinHandle<luna::Result<()>> {
    std::thread::spawn(move || {
        let mut system = System::new("test");
        let main = system.executor("main").policy(Policy::Other).build()?;
        main.process("link").priority(2).spawn(link)?;
        main.process("body").priority(1).spawn(body)?;
        drop(main);
        system.run().map(drop)
    })
}

/// A child that is killed when it is dropped.
pub(crate) struct Killed(pub(crate) Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn echo_ends_after_so_many_values_and_prints_json() {
    let name = name("echoed");
    let (sender, link) = luna_ipc::sender::<[i16; 2]>(&name).unwrap();
    let sending = run(link, async move {
        let mut number = 0;
        while sender.send([number, -number]).await.is_ok() {
            number += 1;
        }
        Ok(())
    });
    let printed = good(&["echo", &name, "--count", "2", "--json"]);
    let values: Vec<Value> = printed
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(values[0], serde_json::json!({"number": 1, "value": [0, 0]}));
    assert_eq!(
        values[1],
        serde_json::json!({"number": 2, "value": [1, -1]})
    );
    assert_eq!(values.len(), 2);
    sending.join().unwrap().unwrap();
}

#[test]
fn values_that_cannot_be_printed_are_refused_or_bytes() {
    let name = name("struct");
    let opened = luna_ipc::sender::<Block>(&name).unwrap();
    let (code, error) = bad(&["echo", &name]);
    assert_eq!(code, 2, "{error}");
    assert!(
        error.contains("cell::Block") && error.contains("--raw"),
        "{error}"
    );
    let (code, error) = bad(&["send", &name, "1"]);
    assert_eq!(code, 2, "{error}");
    let (sender, link) = opened;
    let sending = run(link, async move {
        let height = 0.5;
        sender.send(Block { number: 3, height }).await?;
        Ok(())
    });
    let printed = good(&["echo", &name, "--raw"]);
    let bytes = [3_u64.to_ne_bytes(), 0.5_f64.to_ne_bytes()].concat();
    let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(printed, digits + "\n");
    sending.join().unwrap().unwrap();

    let call = luna_ipc::client::<u8, u8>(&name).unwrap();
    let (code, error) = bad(&["echo", &name, "--raw"]);
    assert_eq!(code, 2, "{error}");
    assert!(error.contains("call"), "{error}");
    drop(call);
    for command in [&["echo", &name][..], &["send", &name, "1"]] {
        let (code, error) = bad(command);
        assert_eq!(code, 2, "{error}");
        assert!(error.contains("no program has it open"), "{error}");
    }
    let (code, error) = bad(&["echo", "two words"]);
    assert_eq!(code, 2, "{error}");
}

#[test]
fn send_is_the_sending_program() {
    let name = name("sent");
    let (receiver, link) = luna_ipc::receiver::<f32>(&name).unwrap();
    let receiving = run(link, async move {
        for value in [1.5, -2.0, f32::INFINITY] {
            assert_eq!(receiver.recv().await?, value);
        }
        assert!(receiver.recv().await.is_err_and(|error| error.is_closed()));
        Ok(())
    });
    let (code, error) = bad(&["send", &name, "1.5", "two"]);
    assert_eq!(code, 2, "{error}");
    assert!(error.contains("`two`"), "{error}");
    good(&["send", &name, "1.5", "-2", "inf"]);
    receiving.join().unwrap().unwrap();
}

#[test]
fn send_waits_for_a_program_that_opens_the_channel() {
    let name = name("awaited");
    let mut send = Killed(
        command(&["send", &name, "two words", "--wait", "60"])
            .spawn()
            .expect("it starts"),
    );
    let endpoint = luna_ipc::Endpoint::new(&name);
    let (receiver, link) = endpoint.serde_receiver::<String>(40).unwrap();
    let receiving = run(link, async move {
        assert_eq!(receiver.recv().await?, "two words");
        assert!(receiver.recv().await.is_err());
        Ok(())
    });
    assert_eq!(send.0.wait().unwrap().code(), Some(0));
    receiving.join().unwrap().unwrap();
}

#[test]
fn a_value_that_nobody_takes_in_time_is_withdrawn() {
    let name = name("withdrawn");
    let (receiver, link) = luna_ipc::receiver::<u8>(&name).unwrap();
    let (end, ends) = luna::channel::<()>();
    let end = end.external();
    let receiving = run(link, async move {
        // It is busy elsewhere, until the sender has given up.
        ends.recv().await?;
        assert!(receiver.recv().await.is_err_and(|error| error.is_closed()));
        Ok(())
    });
    let (code, error) = bad(&["send", &name, "7", "--timeout", "0.2"]);
    assert_eq!(code, 1, "{error}");
    assert!(
        error.contains("value 1 of 1 was not taken in 0.2 s"),
        "{error}"
    );
    end.blocking_send(()).unwrap();
    receiving.join().unwrap().unwrap();
}

#[test]
fn a_side_that_is_taken_is_refused_with_what_to_do() {
    let name = name("busy");
    let _receiving = luna_ipc::receiver::<u8>(&name).unwrap();
    let (code, error) = bad(&["echo", &name]);
    assert_eq!(code, 2, "{error}");
    let own = std::process::id().to_string();
    for part in [&*own, "receiver", "luna list"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let _sending = luna_ipc::sender::<u8>(&name).unwrap();
    let (code, error) = bad(&["send", &name, "1"]);
    assert_eq!(code, 2, "{error}");
    assert!(error.contains("sender"), "{error}");
}

#[test]
fn a_blackboard_is_echoed_and_set() {
    let name = name("board");
    let board = Blackboard::new(&name)
        .entry("speed", 0.5_f64)
        .entry("blocks", 3_u32);
    let mut writer = board.write().unwrap();
    let speed = writer.take::<f64>("speed").unwrap();
    assert_eq!(
        good(&["echo", &name, "--count", "2"]),
        "speed   0.5\nblocks  3\n"
    );
    let printed = good(&["echo", &name, "bl*", "--count", "1", "--json"]);
    let value: Value = serde_json::from_str(&printed).unwrap();
    assert_eq!(
        (&value["key"], &value["value"]),
        (&"blocks".into(), &3.into())
    );
    assert!(value["age_s"].as_f64().is_some_and(|age| age >= 0.0));
    let (code, error) = bad(&["echo", &name, "color"]);
    assert_eq!(code, 2, "{error}");
    assert!(error.contains("speed, blocks"), "{error}");

    let mut echo = Killed(
        command(&["echo", &name, "speed"])
            .stdout(Stdio::piped())
            .spawn()
            .expect("it starts"),
    );
    let mut lines = BufReader::new(echo.0.stdout.take().unwrap()).lines();
    assert_eq!(lines.next().unwrap().unwrap(), "speed  0.5");
    let mut speed = speed;
    speed.set(0.75);
    assert_eq!(lines.next().unwrap().unwrap(), "speed  0.75");

    let reader = Blackboard::new(&name).read().unwrap();
    let listed = list(&[&name]);
    let found = &listed["blackboards"][0];
    assert_eq!(found["writer"]["pid"], std::process::id());
    assert_eq!(found["readers"][0]["pid"], std::process::id());
    assert_eq!(found["keys"][0]["value"], 0.75);
    assert!(good(&["list", &name]).contains("0.75"));
    let (code, error) = bad(&["send", &name, "speed=1"]);
    assert_eq!(code, 2, "{error}");
    drop((writer, speed));
    good(&["send", &name, "speed=-1", "blocks=4"]);
    assert_eq!(lines.next().unwrap().unwrap(), "speed  -1.0");
    let blocks = reader.entry::<u32>("blocks").unwrap().get().unwrap();
    assert_eq!(blocks.value, 4);
    let (code, error) = bad(&["send", &name, "speed=1", "blocks=-1"]);
    assert_eq!(code, 2, "{error}");
    assert_eq!(
        reader.entry::<f64>("speed").unwrap().get().unwrap().value,
        -1.0
    );
    // All programs have closed it.
    drop(reader);
    assert_eq!(echo.0.wait().unwrap().code(), Some(0));
}
