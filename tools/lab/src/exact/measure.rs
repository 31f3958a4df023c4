//! Takes the figures.

use super::recorded::{Figures, Recorded};
use super::rows::{self, LOAD, Reading, Row};
use crate::arch::Arch;
use crate::boot::{Boot, Ended};
use crate::build;
use crate::place::Place;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::thread;
use std::time::Duration;

/// An instruction takes two ns.
const SHIFT: u8 = 1;
/// Of the host's time: an emulated processor beside other work is slow.
const TIMEOUT: Duration = Duration::from_secs(900);
/// Begins the output of a row.
const MARK: &str = "row> ";

/// Builds the programs and measures all rows. The same seed gives the same figures.
///
/// # Errors
///
/// A program cannot be built, a guest does not end, or a row has no figures.
pub(crate) fn all(place: &Place, seed: u32) -> Result<Recorded, String> {
    let files = programs(place)?;
    let rows = rows::all();
    let loaded = || boot(place, &files, &rows.loaded, LOAD, seed);
    let quiet = || boot(place, &files, &rows.quiet, "", seed);
    // One after the other takes as long as both beside each other where there is one processor.
    let (quiet, loaded) = thread::scope(|scope| {
        let loaded = scope.spawn(loaded);
        (quiet(), loaded.join().expect("it does not panic"))
    });
    let mut figures = quiet?;
    figures.extend(loaded?);
    let qemu = Command::new(Arch::Amd64.qemu()).arg("--version").output();
    let qemu = qemu.map_err(|error| format!("{}: {error}", Arch::Amd64.qemu()))?;
    let qemu = String::from_utf8_lossy(&qemu.stdout);
    let qemu = qemu.lines().next().unwrap_or_default();
    // Without the package's version, which changes with each repair.
    let qemu = qemu.split_once(" (").map_or(qemu, |(version, _)| version);
    Ok(Recorded {
        compiler: build::compiler()?,
        kernel: place.kernel_version(Arch::Amd64)?,
        qemu: qemu.to_owned(),
        figures,
    })
}

/// The measured programs, without debug information.
fn programs(place: &Place) -> Result<Vec<PathBuf>, String> {
    let mut luna = build::cargo();
    luna.args(["build", "--release", "--bins"]);
    luna.args(["--package", "luna-cli", "--package", "luna-demo"]);
    let mut guests = build::cargo();
    guests.args(["build", "--release", "--package", "luna-lab", "--examples"]);
    let folder = place.folder().join("exact");
    fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut files = Vec::new();
    for command in [luna, guests] {
        for program in build::programs(command)? {
            let copy = folder.join(&program.target);
            build::strip("strip", &program.path, &copy)?;
            files.push(copy);
        }
    }
    Ok(files)
}

fn boot(
    place: &Place,
    files: &[PathBuf],
    rows: &[Row],
    before: &str,
    seed: u32,
) -> Result<BTreeMap<String, Figures>, String> {
    // Another seed places the programs' memory elsewhere, and begins at another phase of the tick.
    let phase = 137 * (u64::from(seed) % 1000);
    let mut commands = format!("{before}\nusleep {phase}\n");
    for row in rows {
        for _ in 0..row.runs {
            let name = row.name.replace('\'', "'\\''");
            commands.push_str(&format!("echo '{MARK}{name}'\n{}\n", row.command));
        }
    }
    // Processes of the load are left to the end of the guest.
    commands.push_str("exit 0");
    let boot = Boot {
        exact: Some(SHIFT),
        seed: u64::from(seed),
        cpus: 1,
        timeout: TIMEOUT,
        files: files.to_vec(),
        commands,
        ..Boot::new(Arch::Amd64)
    };
    let mut output = String::new();
    let ended = boot.run(place, &mut |line| {
        output.push_str(line);
        output.push('\n');
    })?;
    match ended {
        Ended::Commands(_) => read(rows, &output),
        Ended::OutOfTime => Err(format!(
            "the guest was ended after {} s; it had printed:\n{output}",
            TIMEOUT.as_secs()
        )),
        Ended::Otherwise(last) => Err(format!("the guest ended by itself:\n{last}")),
    }
}

/// The figures of all rows in the output of a boot.
fn read(rows: &[Row], output: &str) -> Result<BTreeMap<String, Figures>, String> {
    let mut figures = BTreeMap::new();
    for row in rows {
        let mut runs = Vec::new();
        let own = |part: &'_ str| Some(part.strip_prefix(row.name)?.strip_prefix('\n')?.to_owned());
        for text in output.split(MARK).filter_map(own) {
            let found = match row.reading {
                Reading::Line => line(&text),
                Reading::Json(name) => json(&text, name),
                Reading::Cyclictest => cyclictest(&text),
            };
            runs.push(found.ok_or_else(|| {
                let (name, command) = (row.name, &row.command);
                format!("row `{name}`: no latencies in what `{command}` printed:\n{text}")
            })?);
        }
        if runs.len() != row.runs as usize {
            return Err(format!(
                "row `{}`: it was run {} times of {}",
                row.name,
                runs.len(),
                row.runs
            ));
        }
        figures.insert(row.name.to_owned(), united(&runs));
    }
    Ok(figures)
}

/// The medians of the percentiles, and the longest of all.
fn united(runs: &[Figures]) -> Figures {
    let median = |figure: fn(&Figures) -> Option<f64>| {
        let mut all: Vec<f64> = runs.iter().filter_map(figure).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied()
    };
    Figures {
        p50: median(|run| run.p50),
        p99: median(|run| run.p99),
        max: runs.iter().fold(0.0, |max, run| max.max(run.max)),
    }
}

/// Reads `... p50 1.23 p99 1.23 max 1.23 us`.
fn line(text: &str) -> Option<Figures> {
    let line = text.lines().find(|line| line.contains("wake-up latency"))?;
    let after = |name: &str| {
        let mut words = line
            .split_ascii_whitespace()
            .skip_while(|word| *word != name);
        words.nth(1)?.parse().ok()
    };
    Some(Figures {
        p50: Some(after("p50")?),
        p99: Some(after("p99")?),
        max: after("max")?,
    })
}

/// Reads the object of `luna jitter --json` or `luna demo --json`.
fn json(text: &str, name: &str) -> Option<Figures> {
    let object: Value = text
        .lines()
        .find_map(|line| serde_json::from_str(line).ok())?;
    let loops = object["loops"].as_array()?;
    let own = loops.iter().find(|one| one["name"] == name)?;
    let micros = |key: &str| Some(own["wake_latency_ns"][key].as_f64()? / 1000.0);
    Some(Figures {
        p50: Some(micros("p50")?),
        p99: Some(micros("p99")?),
        max: micros("max")?,
    })
}

/// Reads `T: 0 ( 134) P:80 I:1000 C: 2000 Min: 7001 Act: 7101 Avg: 8000 Max: 12345`.
fn cyclictest(text: &str) -> Option<Figures> {
    let line = text.lines().find(|line| line.starts_with("T:"))?;
    let (_, max) = line.split_once("Max:")?;
    let max: f64 = max.trim().parse().ok()?;
    Some(Figures {
        p50: None,
        p99: None,
        max: max / 1000.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &'static str, reading: Reading) -> Row {
        Row {
            name,
            command: "true".to_owned(),
            runs: 1,
            longest: 0.1,
            reading,
            goal: None,
        }
    }

    const OUTPUT: &str = "\
row> luna jitter --others 10
a notice
{\"loops\":[{\"name\":\"other\",\"wake_latency_ns\":{\"p50\":1,\"p99\":2,\"max\":3}},{\"name\":\"jitter\",\"wake_latency_ns\":{\"min\":1,\"p50\":9150,\"p99\":11800,\"max\":15900}}]}
row> luna jitter
busy: 500 cycles, 0 missed, wake-up latency p50 8.96 p99 10.88 max 11.39 us
row> cyclictest
# /dev/cpu_dma_latency set to 0us
T: 0 (  134) P:80 I:1000 C:   2000 Min:   7001 Act:  7101 Avg:   8000 Max:   12345
row> none
";

    #[test]
    fn rows_are_read_each_by_its_form() {
        let rows = [
            row("luna jitter", Reading::Line),
            row("luna jitter --others 10", Reading::Json("jitter")),
            row("cyclictest", Reading::Cyclictest),
        ];
        let all = read(&rows, OUTPUT).unwrap();
        let figures = |p50, p99, max| Figures { p50, p99, max };
        assert_eq!(all["luna jitter"], figures(Some(8.96), Some(10.88), 11.39));
        assert_eq!(
            all["luna jitter --others 10"],
            figures(Some(9.15), Some(11.8), 15.9)
        );
        assert_eq!(all["cyclictest"], figures(None, None, 12.345));
    }

    #[test]
    fn runs_are_united() {
        let figures = |p50, max| Figures {
            p50: Some(p50),
            p99: None,
            max,
        };
        let one = united(&[figures(14.0, 15.0), figures(9.0, 17.0), figures(9.5, 12.0)]);
        assert_eq!(one, figures(9.5, 17.0));
        let output = "row> a\np50 1 p99 1 max 1 us wake-up latency\n";
        let rows = [Row {
            runs: 2,
            ..row("a", Reading::Line)
        }];
        assert_eq!(
            read(&rows, output).unwrap_err(),
            "row `a`: it was run 1 times of 2"
        );
    }

    #[test]
    fn a_row_without_figures_is_named_with_its_output() {
        for name in ["none", "not begun"] {
            for reading in [Reading::Line, Reading::Json("jitter"), Reading::Cyclictest] {
                let said = read(&[row(name, reading)], OUTPUT).unwrap_err();
                assert!(said.contains(name), "{said}");
            }
        }
    }
}
