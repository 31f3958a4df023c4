//! `lab test`: the project's own test programs, in guests with two processors.

mod left_out;
mod result;

use crate::arch::Arch;
use crate::boot::{Boot, Ended};
use crate::build::{self, Program};
use crate::cargo;
use crate::place::Place;
use result::Outcome;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

/// The packages whose tests run everywhere.
const KERNEL: [&str; 4] = [
    "luna-platform",
    "luna-machine",
    "luna-core",
    "luna-channels",
];
/// The framework, on amd64.
const FRAMEWORK: &str = "luna-rt";
/// The host's time that one test program has.
const TIMEOUT: Duration = Duration::from_secs(1800);

/// Runs the command. Returns its exit code: 1 when a test failed, or did not end.
///
/// # Errors
///
/// The arguments are wrong, something is missing, or the tests cannot be built.
pub(crate) fn command(place: &Place, arguments: &[String]) -> Result<u8, String> {
    let (arch, packages) = parse(arguments)?;
    let step = match arch {
        Arch::Amd64 => "PREEMPT_RT",
        Arch::Arm64 => "64-bit Arm",
    };
    let hindrance = place.hindrance(arch).or_else(|| match arch {
        Arch::Amd64 => None,
        Arch::Arm64 => cargo::hindrance(place),
    });
    if let Some(reason) = hindrance {
        println!("skipped: tests on {step}: {reason}");
        return Ok(0);
    }
    let programs = build(place, arch, &packages)?;
    if programs.is_empty() {
        return Err(format!(
            "lab test: no test programs of {}",
            packages.join(", ")
        ));
    }
    let folder = place.folder().join(format!("tests-{}", arch.name()));
    fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut failed = 0;
    for program in &programs {
        let begin = Instant::now();
        let outcome = run(place, arch, program, &folder)?;
        failed += usize::from(!outcome.is_passed());
        let name = format!("{} {}", program.package, program.target);
        println!(
            "{name}: {}, {} s",
            outcome.summary(),
            begin.elapsed().as_secs()
        );
        print!("{}", outcome.details());
    }
    println!(
        "{} programs passed, {failed} failed",
        programs.len() - failed
    );
    Ok(u8::from(failed > 0))
}

fn parse(arguments: &[String]) -> Result<(Arch, Vec<String>), String> {
    let usage =
        || "lab test: which architecture? amd64 or arm64, then --package PACKAGE...".to_owned();
    let (arch, rest) = arguments.split_first().ok_or_else(usage)?;
    let arch = Arch::parse(arch)?;
    let mut there: Vec<_> = KERNEL.map(str::to_owned).into();
    if arch == Arch::Amd64 {
        there.push(FRAMEWORK.to_owned());
    }
    let mut packages = Vec::new();
    for pair in rest.chunks(2) {
        match pair {
            [option, package] if option == "--package" && there.contains(package) => {
                packages.push(package.clone());
            }
            [option, package] if option == "--package" => {
                return Err(format!(
                    "lab test: no package {package}: there are {}",
                    there.join(", ")
                ));
            }
            _ => return Err(usage()),
        }
    }
    Ok((arch, if packages.is_empty() { there } else { packages }))
}

/// The test programs, in the order of the packages.
fn build(place: &Place, arch: Arch, packages: &[String]) -> Result<Vec<Program>, String> {
    let mut command = match arch {
        Arch::Amd64 => {
            let mut cargo = build::cargo();
            cargo.arg("test");
            cargo
        }
        Arch::Arm64 => cargo::arm_cargo(place, "test")?,
    };
    command.args(["--no-run", "--lib", "--tests"]);
    for package in packages {
        command.args(["--package", package]);
    }
    let mut programs = build::programs(command)?;
    programs.retain(|program| program.is_test && packages.contains(&program.package));
    programs.sort_by_key(|program| packages.iter().position(|name| *name == program.package));
    Ok(programs)
}

fn run(place: &Place, arch: Arch, program: &Program, folder: &Path) -> Result<Outcome, String> {
    let copy = folder.join(format!("{}-{}", program.package, program.target));
    let strip = match arch {
        Arch::Amd64 => "strip",
        Arch::Arm64 => "aarch64-linux-gnu-strip",
    };
    build::strip(strip, &program.path, &copy)?;
    let name = copy
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let mut command = format!("/lab/{name}");
    let left_out = left_out::of(arch, program);
    if program.has_harness() {
        // Events say which tests are running when the time is up.
        command.push_str(" -Z unstable-options --format json --test-threads 2");
        for test in &left_out {
            command.push_str(&format!(" --skip {}", test.name));
        }
    }
    let boot = Boot {
        timeout: TIMEOUT,
        files: vec![copy],
        commands: format!("export RUSTC_BOOTSTRAP=1 RUST_BACKTRACE=0 LUNA_NETWORKS=20\n{command}"),
        ..Boot::new(arch)
    };
    let mut outcome = Outcome::new(program.has_harness(), left_out);
    let ended = boot.run(place, &mut |line| outcome.add(line))?;
    outcome.end(match ended {
        Ended::Commands(code) => Ok(code),
        Ended::OutOfTime => Err(format!("it did not end in {} s", TIMEOUT.as_secs())),
        Ended::Otherwise(last) => Err(format!("the guest ended:\n{last}")),
    });
    // Dozens of MB each.
    let _ = fs::remove_file(&boot.files[0]);
    Ok(outcome)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(line: &str) -> Result<(Arch, Vec<String>), String> {
        let words: Vec<_> = line.split_ascii_whitespace().map(str::to_owned).collect();
        parse(&words)
    }

    #[test]
    fn an_architecture_and_packages_are_read() {
        let (arch, packages) = parsed("arm64").unwrap();
        assert_eq!((arch, packages.len()), (Arch::Arm64, 4));
        assert_eq!(parsed("amd64").unwrap().1.len(), 5);
        let two = parsed("amd64 --package luna-rt --package luna-core")
            .unwrap()
            .1;
        assert_eq!(two, ["luna-rt", "luna-core"]);
        for wrong in [
            "",
            "mips",
            "arm64 --package luna-rt",
            "amd64 --package",
            "amd64 luna-rt",
        ] {
            assert!(parsed(wrong).is_err(), "{wrong}");
        }
    }
}
