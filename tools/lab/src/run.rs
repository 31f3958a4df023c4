//! `lab run`: programs of the user.

use crate::arch::Arch;
use crate::boot::{Boot, Ended};
use crate::place::Place;
use std::io::{self, Write};
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

/// What `timeout` ends with.
const OUT_OF_TIME: u8 = 124;
const NO_END: u8 = 125;

/// Runs the command. Returns its exit code: that of the guest's commands.
///
/// # Errors
///
/// The arguments or a file are wrong, or something is missing.
pub(crate) fn command(place: &Place, arguments: &[String]) -> Result<u8, String> {
    let boot = parse(arguments)?;
    let ended = boot.run(place, &mut |line| {
        // A reader that has gone does not want to know how the run ends either.
        let mut out = io::stdout().lock();
        if writeln!(out, "{line}").and_then(|()| out.flush()).is_err() {
            std::process::exit(1);
        }
    })?;
    match ended {
        Ended::Commands(code) => Ok(code),
        Ended::OutOfTime => {
            eprintln!(
                "lab: the guest was ended: its {} s were up (--timeout)",
                boot.timeout.as_secs()
            );
            Ok(OUT_OF_TIME)
        }
        Ended::Otherwise(last) => {
            eprintln!("lab: the guest ended before its commands did; its last lines:\n{last}");
            Ok(NO_END)
        }
    }
}

fn parse(arguments: &[String]) -> Result<Boot, String> {
    let mut boot = Boot::new(Arch::Amd64);
    let mut cpus = None;
    let mut words = arguments.iter();
    loop {
        let word = words
            .next()
            .ok_or("lab run: `--` and the commands are missing")?;
        let mut value = || {
            words
                .next()
                .ok_or_else(|| format!("lab run: {word} needs a value"))
        };
        match word.as_str() {
            "--" => break,
            "--arch" => boot.arch = Arch::parse(value()?)?,
            "--exact" => boot.exact = Some(number(word, value()?, 0, 10)?),
            "--seed" => boot.seed = number(word, value()?, 0, u64::MAX)?,
            "--cpus" => cpus = Some(number(word, value()?, 1, 64)?),
            "--memory" => boot.memory = number(word, value()?, 64, 1 << 20)?,
            "--timeout" => boot.timeout = Duration::from_secs(number(word, value()?, 1, 1 << 30)?),
            option if option.starts_with("--") => {
                return Err(format!(
                    "lab run: no such option: {option}; `lab` prints those there are"
                ));
            }
            file => boot.files.push(PathBuf::from(file)),
        }
    }
    boot.commands = words.map(String::as_str).collect::<Vec<_>>().join(" ");
    if boot.commands.is_empty() {
        return Err("lab run: there are no commands after `--`".to_owned());
    }
    boot.cpus = match (boot.exact, cpus) {
        (Some(_), None | Some(1)) => 1,
        (Some(_), Some(_)) => {
            return Err(
                "lab run: with --exact the guest has one processor: leave --cpus out".to_owned(),
            );
        }
        (None, cpus) => cpus.unwrap_or(boot.cpus),
    };
    Ok(boot)
}

fn number<T>(option: &str, value: &str, least: T, most: T) -> Result<T, String>
where
    T: FromStr + PartialOrd + std::fmt::Display,
{
    match value.parse::<T>() {
        Ok(number) if number >= least && number <= most => Ok(number),
        _ => Err(format!(
            "lab run: {option} {value}: give a number from {least} to {most}"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(line: &str) -> Result<Boot, String> {
        let words: Vec<_> = line.split(' ').map(str::to_owned).collect();
        parse(&words)
    }

    #[test]
    fn options_files_and_commands_are_told_apart() {
        let boot =
            parsed("--arch arm64 a --cpus 4 --memory 512 --timeout 9 dir/b -- echo --cpus 3")
                .unwrap();
        let expected = Boot {
            cpus: 4,
            memory: 512,
            timeout: Duration::from_secs(9),
            files: vec!["a".into(), "dir/b".into()],
            commands: "echo --cpus 3".to_owned(),
            ..Boot::new(Arch::Arm64)
        };
        assert_eq!(boot, expected);
    }

    #[test]
    fn exact_time_has_one_processor() {
        let boot = parsed("--exact 1 --seed 7 -- true").unwrap();
        assert_eq!((boot.exact, boot.seed, boot.cpus), (Some(1), 7, 1));
        assert!(parsed("--exact 1 --cpus 2 -- true").is_err());
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (line, said) in [
            ("a b", "`--` and the commands"),
            ("a --", "no commands"),
            ("--arch mips -- true", "`mips`"),
            ("--exact much -- true", "--exact much"),
            ("--cpus 0 -- true", "from 1 to 64"),
            ("--kvm -- true", "--kvm"),
            ("--timeout", "--timeout needs a value"),
        ] {
            let error = parsed(line).unwrap_err();
            assert!(error.contains(said), "{line}: {error}");
        }
    }
}
