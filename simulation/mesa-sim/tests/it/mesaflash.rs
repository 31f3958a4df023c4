//! Mesa's own tool, an independent implementation, reads the simulated card. Skipped, with a
//! message, where it is not installed (Debian: mesaflash).

use hostmot2::PORT;
use luna_mesa_sim::{Server, Settings};
use std::process::Command;

const ATTEMPTS: u32 = 20;

#[test]
fn mesaflash_reads_the_card_and_its_modules() {
    if Command::new("mesaflash").arg("--help").output().is_err() {
        println!("skipped: mesaflash is not installed");
        return;
    }
    // The tool only uses this port. If another process has it, the test is skipped.
    let settings = Settings {
        address: ([127, 0, 0, 1], PORT).into(),
        // Where it is granted.
        policy: luna::Policy::fifo(50),
        ..Settings::default()
    };
    let server = match Server::start(settings) {
        Ok(server) => server,
        Err(error) => {
            println!("skipped: port {PORT} of loopback cannot be had: {error}");
            return;
        }
    };
    let ask = |arguments: &[&str]| {
        // Its own timeout for an answer may be too short on a busy machine.
        let mut last = None;
        for _ in 0..ATTEMPTS {
            let output = Command::new("mesaflash")
                .args(["--device", "7i92", "--addr", "127.0.0.1"])
                .args(arguments)
                .output()
                .unwrap();
            if output.status.success() {
                return String::from_utf8_lossy(&output.stdout).into_owned();
            }
            last = Some(output);
        }
        panic!("{ATTEMPTS} times: {last:?}");
    };
    let about = ask(&[]);
    assert!(about.contains("7I92"), "{about}");
    let modules = ask(&["--readhmid"]);
    for line in [
        "Configuration Name: HOSTMOT2",
        "BoardName : MESA7I92",
        "Number of IO Ports: 2",
        "Width of one I/O port: 17",
        "Clock Low frequency: 100.0000 MHz",
        "There are 1 of WatchDog in configuration",
        "There are 2 of IOPort in configuration",
        "There are 4 of QCount in configuration",
        "There are 4 of PWM in configuration",
    ] {
        assert!(modules.contains(line), "{line} is not in:\n{modules}");
    }
    // Every pin with its function.
    let pin = |number: &str, words: &[&str]| {
        let is_it = |line: &&str| {
            let mut columns = line.split_whitespace().skip(1);
            columns.next() == Some(number) && columns.next() == Some("IOPort")
        };
        let line = modules.lines().find(is_it).unwrap_or_default();
        assert!(words.iter().all(|word| line.contains(word)), "{line}");
    };
    pin("0", &["QCount", "Quad-A", "(In)"]);
    pin("3", &["PWM", "(Out)"]);
    pin("28", &["PWM", "3", "/Enable"]);
    pin("33", &["IOPort", "None"]);
    // It writes and reads single registers too.
    ask(&["--wpo", "0x0200=0x12345678"]);
    let read = ask(&["--rpo", "0x0200"]);
    assert!(read.to_lowercase().contains("12345678"), "{read}");
    assert_eq!(server.traffic().malformed, 0);
}
