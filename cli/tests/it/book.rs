//! What the book shows of the command: its options are there, and its pictures are what it draws.

use crate::run::{luna, luna_model, path};
use std::fs;
use std::path::{Path, PathBuf};

fn book() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../book")
}

/// The chapters.
fn chapters(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        // What the book shows as its reference is docs/.
        if path.is_dir() && !path.is_symlink() {
            chapters(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "md") {
            found.push(path);
        }
    }
}

/// The calls of `luna` in blocks of commands, each as its words.
fn calls(text: &str) -> Vec<Vec<&str>> {
    let mut is_shell = false;
    let mut calls = Vec::new();
    for line in text.lines() {
        if line.starts_with("```") {
            is_shell = line == "```sh";
        } else if is_shell {
            let line = line.split('#').next().unwrap_or_default();
            let mut words = line.split_whitespace();
            let is_setting = |word: &&str| word.contains('=');
            if words.find(|word| !is_setting(word)) == Some("luna") {
                calls.push(words.collect());
            }
        }
    }
    calls
}

#[test]
fn commands_of_the_book_have_their_options() {
    let mut found = Vec::new();
    chapters(&book().join("src"), &mut found);
    let mut checked = 0;
    for chapter in found {
        let text = fs::read_to_string(&chapter).unwrap();
        for words in calls(&text) {
            let mut names = vec![words[0]];
            if words.len() > 1
                && ["model", "demo"].contains(&words[0])
                && !words[1].starts_with('-')
            {
                names.push(words[1]);
            }
            let help = luna(&[&names[..], &["--help"]].concat());
            let help = String::from_utf8(help.stdout).unwrap();
            let at = chapter.display();
            assert!(help.contains("Usage: luna"), "{at}: there is no {names:?}");
            for option in words.iter().filter(|word| word.starts_with("--")) {
                assert!(help.contains(option), "{at}: {names:?} has no {option}");
            }
            checked += 1;
        }
    }
    assert!(checked > 15, "{checked} calls");
}

/// The page of the packages has each member of the workspace.
#[test]
fn each_package_is_on_its_page() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let read = |path: &str| fs::read_to_string(root.join(path)).unwrap();
    let page = read("docs/packages.md");
    let workspace = read("Cargo.toml");
    let members = workspace.split_once("members = [").unwrap().1;
    let members = members.split_once(']').unwrap().0;
    let mut checked = 0;
    for member in members.split(',') {
        let manifest = read(&format!("{}/Cargo.toml", member.trim().trim_matches('"')));
        let name = manifest.split_once("name = \"").unwrap().1;
        let name = name.split_once('"').unwrap().0;
        assert!(page.contains(&format!("`{name}`")), "{name}");
        checked += 1;
    }
    assert!(checked > 35, "{checked} packages");
}

#[test]
fn the_picture_of_the_axis_is_drawn_from_its_model() {
    let model = book().join("models/axis.toml");
    let checked = luna_model(&["check", path(&model)]);
    let errors = String::from_utf8_lossy(&checked.stderr);
    assert_eq!(checked.status.code(), Some(0), "{errors}");
    let drawn = luna_model(&["draw", "-o", "-", path(&model)]);
    let shown = fs::read(book().join("src/pictures/axis.svg")).unwrap();
    assert_eq!(drawn.stdout, shown);
}
