//! `LUNA_SCOPE`: a run of any program in the browser.

use luna::prelude::*;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// The program under test, without a word on the scope: it runs until its standard input ends.
#[test]
#[ignore = "it is the program of the other tests"]
fn program() -> luna::Result<()> {
    let mut system = System::new("pump");
    let main = system.executor("main").build()?;
    let (end, ends) = luna::channel::<()>();
    let pump = main.process("pump");
    let flow = pump.signal::<f64>("pump/flow").register()?;
    let gain = pump.parameter("pump/gain", 1.0).register()?;
    pump.spawn(async move {
        let mut tick = luna::periodic("pump", Duration::from_millis(1))?;
        loop {
            tick.next().await;
            flow.record(gain.get());
            match ends.try_recv() {
                Err(error) if error.is_empty() => {}
                _ => return Ok(()),
            }
        }
    })?;
    system
        .thread("console")
        .process("console")
        .spawn(async move {
            let _end = end;
            std::io::stdin()
                .read_to_end(&mut Vec::new())
                .map_err(luna::Error::other)?;
            Ok(())
        })?;
    system.run()?;
    Ok(())
}

fn start(scope: &str) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "program", "--ignored", "--nocapture"])
        .env("LUNA_SCOPE", scope)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

#[test]
fn a_program_that_knows_nothing_of_it_is_shown() {
    let mut program = start("127.0.0.1:0");
    let mut lines = BufReader::new(program.stderr.take().unwrap()).lines();
    let url = lines
        .find_map(|line| {
            line.unwrap()
                .strip_prefix("luna: scope: http://")
                .map(str::to_owned)
        })
        .expect("the address is printed");
    let (address, token) = url
        .split_once("/#token=")
        .unwrap_or_else(|| panic!("{url}"));
    assert!(token.len() > 16, "{token}");
    let mut page = TcpStream::connect(address).unwrap();
    write!(
        page,
        "GET / HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n"
    )
    .unwrap();
    let mut text = String::new();
    page.read_to_string(&mut text).unwrap();
    assert!(text.contains("<title>LUNA scope</title>"), "{text}");
    drop(program.stdin.take());
    let rest: Vec<String> = lines.map(Result::unwrap).collect();
    assert!(program.wait().unwrap().success(), "{rest:?}");
}

#[test]
fn an_address_that_is_none_is_an_error() {
    let mut program = start("yes");
    drop(program.stdin.take());
    let output = program.wait_with_output().unwrap();
    assert!(!output.status.success());
    let said = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert!(
        said.contains("LUNA_SCOPE=yes: it must be 1, or an address"),
        "{said}"
    );
}
