//! Peers in other languages: our programs in `benches/peers`, compiled and run where their compiler
//! is installed.
//!
//! A program is started for each block, as `PROGRAM SCENARIO OPERATIONS [SIZE]`; it warms up, and
//! prints one figure.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::OnceLock,
    time::Duration,
};

use crate::{
    cores::{on_core, one_core},
    harness::{Case, target_folder},
    machine::workspace,
};

/// A peer that is not a crate.
struct Peer {
    name: &'static str,
    /// The file in `benches/peers` that is compiled.
    source: &'static str,
    /// The compiler, and its arguments before the program and the source.
    compiler: &'static [&'static str],
    /// The compiler's arguments behind them.
    libraries: &'static [&'static str],
    /// What its program can do.
    scenarios: &'static [&'static str],
}

const PEERS: [Peer; 2] = [
    Peer {
        name: "Go",
        source: "go/main.go",
        compiler: &["go", "build", "-o"],
        libraries: &[],
        scenarios: &[
            "commstime",
            "commstime-parallel",
            "switch",
            "rendezvous",
            "buffered",
            "alternative",
            "ring",
            "memory",
            "spawn",
        ],
    },
    Peer {
        name: "Boost.Fiber",
        source: "boost-fiber/main.cpp",
        compiler: &["g++", "-std=c++17", "-O3", "-o"],
        libraries: &[
            "-lboost_fiber",
            "-lboost_context",
            "-lboost_thread",
            "-lpthread",
        ],
        scenarios: &["commstime", "switch", "rendezvous", "ring", "spawn"],
    },
];

/// Runtimes without a program here that would be worth comparing; with the file by which they are
/// found.
const NO_PROGRAM: [(&str, &str); 2] = [("KRoC", "kroc"), ("libdill", "libdill.h")];

/// Where libraries have their headers.
const HEADERS: &str = "/usr/include:/usr/local/include";

struct Found {
    peer: &'static Peer,
    program: PathBuf,
}

/// Those that could be compiled, and why the others could not.
fn peers() -> &'static (Vec<Found>, Vec<String>) {
    static PEERS_HERE: OnceLock<(Vec<Found>, Vec<String>)> = OnceLock::new();
    PEERS_HERE.get_or_init(|| {
        let (mut found, mut missing) = (Vec::new(), Vec::new());
        for peer in &PEERS {
            match compile(peer) {
                Ok(program) => found.push(Found { peer, program }),
                Err(reason) => missing.push(format!("{} ({reason})", peer.name)),
            }
        }
        (found, missing)
    })
}

fn compile(peer: &Peer) -> Result<PathBuf, String> {
    let source = workspace().join("benches/peers").join(peer.source);
    let folder = target_folder().join("bench/peers");
    let program = folder.join(peer.name);
    let changed = |path: &Path| fs::metadata(path).and_then(|file| file.modified()).ok();
    if changed(&program).is_some_and(|made| Some(made) > changed(&source)) {
        return Ok(program);
    }
    let (compiler, arguments) = peer.compiler.split_first().ok_or("no compiler")?;
    fs::create_dir_all(&folder).map_err(|error| error.to_string())?;
    let output = Command::new(compiler)
        .args(arguments)
        .arg(&program)
        .arg(&source)
        .args(peer.libraries)
        .current_dir(source.parent().unwrap_or(&source))
        .stdin(Stdio::null())
        .output();
    match output {
        Err(_) => Err(format!("no `{compiler}`")),
        Ok(output) if output.status.success() => Ok(program),
        Ok(output) => {
            let text = String::from_utf8_lossy(&output.stderr).into_owned();
            let error = text.lines().find(|line| line.contains("error"));
            let error = error.or(text.lines().next()).unwrap_or_default();
            let (_, error) = error.rsplit_once("error: ").unwrap_or(("", error));
            Err(format!("does not compile: {error}"))
        }
    }
}

/// Which of these peers are here, and which not, by name.
pub fn found_and_missing() -> String {
    let (found, missing) = peers();
    let mut parts: Vec<String> = found
        .iter()
        .map(|found| found.peer.name.to_owned())
        .collect();
    parts.extend(missing.iter().map(|missing| format!("{missing} missing")));
    let mut folders = std::env::var_os("PATH").unwrap_or_default();
    folders.push(":");
    folders.push(HEADERS);
    for (name, file) in NO_PROGRAM {
        let installed = std::env::split_paths(&folders).any(|folder| folder.join(file).exists());
        parts.push(if installed {
            format!("{name} is here, but has no program in benches/peers")
        } else {
            format!("{name} missing")
        });
    }
    parts.join(", ")
}

/// The cases of scenario `name` for the peers with programs for `scenario`, each on one core.
pub fn cases(
    name: &'static str,
    unit: &'static str,
    scenario: &'static str,
    size: Option<u64>,
) -> Vec<Case> {
    let knowing = peers()
        .0
        .iter()
        .filter(|found| found.peer.scenarios.contains(&scenario));
    knowing
        .map(|found| {
            let block = move |operations| {
                Duration::from_secs_f64(run(found, scenario, operations, size) / 1e9)
            };
            let case = Case::new(name, found.peer.name, unit, block);
            match size {
                Some(size) => case.size(size),
                None => case,
            }
        })
        .collect()
}

/// As [`cases`], for a scenario that returns a figure.
pub fn figures(
    name: &'static str,
    unit: &'static str,
    scenario: &'static str,
    size: u64,
) -> Vec<Case> {
    let knowing = peers()
        .0
        .iter()
        .filter(|found| found.peer.scenarios.contains(&scenario));
    knowing
        .map(|found| {
            let block = move || run(found, scenario, 1, Some(size));
            Case::once(name, found.peer.name, unit, block).size(size)
        })
        .collect()
}

/// # Panics
///
/// When the program fails, as it does when a check of its fails.
fn run(found: &Found, scenario: &str, operations: u64, size: Option<u64>) -> f64 {
    // The program inherits the core.
    on_core(one_core(), || {
        let output = Command::new(&found.program)
            .arg(scenario)
            .arg(operations.to_string())
            .args(size.map(|size| size.to_string()))
            .env("GOMAXPROCS", "1")
            .stdin(Stdio::null())
            .stderr(Stdio::inherit())
            .output()
            .expect("it has been compiled just now");
        let name = found.peer.name;
        assert!(
            output.status.success(),
            "{name}, {scenario}: {}",
            output.status
        );
        let text = String::from_utf8_lossy(&output.stdout);
        text.trim()
            .parse()
            .unwrap_or_else(|_| panic!("{name}, {scenario}: {text:?}"))
    })
}
