//! Runs every bench, and makes a page of the results.
//!
//! ```text
//! cargo run --release -p luna-benches --bin all-benches
//!     [-- [--quick] [--only ring,switch] [--docs FOLDER] [--page]]
//! ```
//!
//! The page is `docs/internals/benchmarks.md`, with its plots in `docs/internals/benchmarks`; a
//! short run's (`--quick`) goes to `bench/docs` in the target folder, so that it does not replace a
//! full one. `--only` runs some benches, and uses the others' last figures; `--page` runs none.

use std::{
    env, fs,
    path::PathBuf,
    process::{Command, ExitCode},
    time::{Instant, SystemTime},
};

use luna_benches::{
    harness::{Row, target_folder},
    machine,
    page::{self, Found, Origin},
};

/// In the order of the page.
const BENCHES: [&str; 19] = [
    "commstime",
    "switch",
    "rendezvous",
    "ipc",
    "buffered",
    "alternative",
    "barrier",
    "ring",
    "fan",
    "timers",
    "loops",
    "spawn",
    "startup",
    "memory",
    "lbp16",
    "udp_hop",
    "net",
    "emergency",
    "logger",
];

#[derive(Debug, Default)]
struct Options {
    quick: bool,
    page: bool,
    only: Option<Vec<String>>,
    docs: Option<PathBuf>,
}

fn options() -> Result<Options, String> {
    let mut options = Options::default();
    let mut arguments = env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--quick" => options.quick = true,
            "--page" => options.page = true,
            "--only" => {
                let names = arguments.next().ok_or("--only needs names")?;
                let names: Vec<String> = names.split(',').map(str::to_owned).collect();
                if let Some(name) = names.iter().find(|name| !BENCHES.contains(&name.as_str())) {
                    return Err(format!("no bench {name}: {}", BENCHES.join(", ")));
                }
                options.only = Some(names);
            }
            "--docs" => {
                options.docs = Some(arguments.next().ok_or("--docs needs a folder")?.into())
            }
            _ => return Err(format!("unknown argument {argument}")),
        }
    }
    Ok(options)
}

fn run(bench: &str, quick: bool) -> Result<(), String> {
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    // A bench of a crate that is too large for a dependency of the others stands in that crate.
    let package = match bench {
        "net" => "luna-net",
        _ => "luna-benches",
    };
    command.args(["bench", "--package", package, "--bench", bench]);
    if quick {
        command.args(["--", "--quick"]);
    }
    let status = command
        .status()
        .map_err(|error| format!("cargo: {error}"))?;
    if status.success() {
        Ok(())
    } else {
        Err(format!("{bench}: {status}"))
    }
}

fn all() -> Result<PathBuf, String> {
    let options = options()?;
    let folder = target_folder().join("bench");
    let origin = folder.join("origin.json");
    let begun = Instant::now();
    let stolen_before = machine::stolen();
    if !options.page {
        let wanted = |bench: &&&str| {
            let only = options.only.as_ref();
            only.is_none_or(|only| only.iter().any(|name| name == **bench))
        };
        for bench in BENCHES.iter().filter(wanted) {
            run(bench, options.quick)?;
        }
        let stolen = stolen_before.zip(machine::stolen());
        let facts = machine::facts().map(|(key, value)| (key.to_owned(), value));
        let found = Origin {
            facts: facts.into(),
            date: page::date(SystemTime::now() - begun.elapsed()),
            quick: options.quick,
            stolen: stolen.map(|(before, after)| {
                (
                    (after - before).as_secs_f64(),
                    begun.elapsed().as_secs_f64(),
                )
            }),
        };
        let json = serde_json::to_string_pretty(&found).map_err(|error| error.to_string())?;
        fs::write(&origin, json).map_err(|error| format!("{}: {error}", origin.display()))?;
    }

    let read = |file: PathBuf| {
        let text = fs::read_to_string(&file);
        text.map_err(|error| format!("{}: {error}", file.display()))
    };
    let mut benches: Vec<Found> = Vec::new();
    for bench in BENCHES {
        let rows: Vec<Row> = serde_json::from_str(&read(folder.join(format!("{bench}.json")))?)
            .map_err(|error| format!("{bench}: {error}"))?;
        benches.push((bench, rows));
    }
    let origin: Origin = serde_json::from_str(&read(origin)?).map_err(|error| error.to_string())?;
    let docs = options.docs.unwrap_or_else(|| {
        if origin.quick {
            folder.join("docs")
        } else {
            machine::workspace().join("docs/internals")
        }
    });
    fs::create_dir_all(&docs)
        .and_then(|()| page::write(&docs, &origin, &benches))
        .map_err(|error| format!("{}: {error}", docs.display()))?;
    Ok(docs.join("benchmarks.md"))
}

fn main() -> ExitCode {
    match all() {
        Ok(page) => {
            println!("{}", page.display());
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}
