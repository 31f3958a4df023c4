//! The tutorial of models, run as it is written.

use crate::package;
use std::env;
use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::process::Command;

const PAGE: &str = include_str!("../../../book/src/design.md");

/// Before what a block of commands prints.
const MARK: &str = "== block";

/// A block of the page.
enum Block {
    /// Commands.
    Commands(String),
    /// What the commands before it print, among other things, in this order.
    Printed(String),
    /// A file, and whether the text is to be added to it.
    File(String, String, bool),
}

fn blocks() -> Vec<Block> {
    let mut blocks = Vec::new();
    let mut file = None;
    let mut lines = PAGE.lines();
    while let Some(line) = lines.next() {
        for (mark, is_added) in [("<!-- file: ", false), ("<!-- append: ", true)] {
            if let Some(name) = line.strip_prefix(mark) {
                file = Some((name.trim_end_matches(" -->").to_owned(), is_added));
            }
        }
        let Some(language) = line.strip_prefix("```") else {
            continue;
        };
        let mut text = String::new();
        for line in lines.by_ref().take_while(|line| *line != "```") {
            text = text + line + "\n";
        }
        blocks.push(match (language, file.take()) {
            ("toml", Some((name, is_added))) => Block::File(name, text, is_added),
            ("sh", None) => Block::Commands(text),
            ("text", None) => Block::Printed(text),
            (other, file) => panic!("a block of {other} for {file:?}"),
        });
    }
    blocks
}

/// All commands of the page in one shell, as a reader types them.
fn script(blocks: &[Block]) -> String {
    // A reader's cargo may ask crates.io for versions; here those of the checkout are there.
    let mut script = "cargo() { cp -n $LUNA/Cargo.lock tank/; command cargo \"$@\"; }\n".to_owned();
    for (number, block) in blocks.iter().enumerate() {
        let _ = match block {
            Block::Commands(text) => {
                let checkout = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
                let text = text.replace("~/luna", &checkout.display().to_string());
                writeln!(script, "echo '{MARK} {number}'\n{text}")
            }
            Block::File(name, text, is_added) => {
                let into = if *is_added { ">>" } else { ">" };
                writeln!(script, "cat {into} {name} <<'END'\n{text}END")
            }
            Block::Printed(_) => Ok(()),
        };
    }
    script
}

#[test]
fn the_tutorial_of_models_does_what_it_says() {
    let blocks = blocks();
    let folder = package::folder("tutorial");
    fs::create_dir_all(&folder).unwrap();
    let luna = Path::new(env!("CARGO_BIN_EXE_luna")).parent().unwrap();
    let path = env::var("PATH").unwrap();
    let mut shell = Command::new("bash");
    package::with_target(&mut shell, &folder);
    let output = shell
        .args(["-c", &script(&blocks)])
        .current_dir(&folder)
        .env("PATH", format!("{}:{path}", luna.display()))
        .env("CARGO_NET_OFFLINE", "true")
        .output()
        .unwrap();
    let printed = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    let mut compared = 0;
    for (number, block) in blocks.iter().enumerate() {
        let Block::Printed(expected) = block else {
            continue;
        };
        let commands = (0..number).rev();
        let mut commands = commands.filter(|at| matches!(blocks[*at], Block::Commands(_)));
        let mark = format!("{MARK} {}\n", commands.next().unwrap());
        let from = printed.find(&mark).map(|at| at + mark.len());
        let Some(from) = from else {
            panic!("the block {number} did not run:\n{printed}\n{errors}");
        };
        let until = printed[from..]
            .find(MARK)
            .map_or(printed.len(), |at| from + at);
        let mut rest = &printed[from..until];
        for line in expected.lines() {
            let Some(at) = rest.find(line) else {
                panic!("`{line}` is not in:\n{rest}\n{errors}");
            };
            rest = &rest[at + line.len()..];
            compared += 1;
        }
    }
    for (drawn, shown) in [
        ("tank.svg", "tank.svg"),
        ("deadlock.svg", "tank-deadlock.svg"),
    ] {
        let drawn = fs::read_to_string(folder.join("tank-plan").join(drawn)).unwrap();
        let pictures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../book/src/pictures");
        assert_eq!(drawn, fs::read_to_string(pictures.join(shown)).unwrap());
    }
    assert!(compared >= 8, "{compared} lines of output are on the page");
}
