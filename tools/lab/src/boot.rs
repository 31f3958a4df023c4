//! A guest: a kernel with the user's programs, from its start to its end.

use crate::arch::Arch;
use crate::archive::Archive;
use crate::libraries;
use crate::place::Place;
use nix::sys::prctl;
use nix::sys::signal::Signal;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, BufRead, BufReader, BufWriter};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

/// The users that the guest knows.
const USERS: &str = "\
root:x:0:0:root:/:/bin/sh
nobody:x:65534:65534:nobody:/:/bin/sh
";

/// The first process. Nothing of the user's is part of it: file names are in the archive, and the
/// commands in a file of their own.
const INIT: &str = "\
#!/bin/busybox sh
/bin/busybox --install -s /bin
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
mount -t devtmpfs none /dev; mount -t proc none /proc; mount -t sysfs none /sys
mount -t tmpfs none /tmp
mkdir -p /dev/shm; mount -t tmpfs none /dev/shm
ifconfig lo 127.0.0.1 up
cd /tmp
echo '<<<lab'
sh /lab/commands < /dev/null 2>&1
echo \"lab>>> $?\"
poweroff -f
";

const BEGIN: &str = "<<<lab";
const END: &str = "lab>>> ";

/// How many lines are kept of what is printed before the commands begin.
const KEPT: usize = 30;

/// What is to be booted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Boot {
    /// The guest's processors.
    pub(crate) arch: Arch,
    /// With exact time: an instruction takes two to the power of this, in ns.
    pub(crate) exact: Option<u8>,
    /// What the guest's random numbers come from.
    pub(crate) seed: u64,
    /// How many processors.
    pub(crate) cpus: u32,
    /// In MiB.
    pub(crate) memory: u32,
    /// Of the host's time.
    pub(crate) timeout: Duration,
    /// What is in the guest's folder `/lab`.
    pub(crate) files: Vec<PathBuf>,
    /// What BusyBox' shell runs there.
    pub(crate) commands: String,
}

/// How a guest ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Ended {
    /// By itself, with the exit code of its commands.
    Commands(u8),
    /// It was ended, since its time was up.
    OutOfTime,
    /// Otherwise: what was printed last.
    Otherwise(String),
}

impl Boot {
    /// Two processors of this architecture, with the default limits.
    pub(crate) fn new(arch: Arch) -> Boot {
        Boot {
            arch,
            exact: None,
            seed: 1,
            cpus: 2,
            memory: 1536,
            timeout: Duration::from_secs(600),
            files: Vec::new(),
            commands: String::new(),
        }
    }

    /// Boots, calls `line` for each line that the commands print, as soon as it is there, and waits
    /// for the end.
    ///
    /// Nothing is left behind, however this program ends: the archive's file has no name, and QEMU
    /// ends with the thread that called this.
    ///
    /// # Errors
    ///
    /// A file is missing or unfit, two have one name, or QEMU cannot be started.
    pub(crate) fn run(&self, place: &Place, line: &mut dyn FnMut(&str)) -> Result<Ended, String> {
        if let Some(reason) = place.hindrance(self.arch) {
            return Err(reason);
        }
        let archive = self.archive(place)?;
        let mut child = self.qemu(place, archive)?;
        let lines = read_lines(child.stdout.take().expect("it is a pipe"));
        let ended = follow(&lines, Instant::now() + self.timeout, line);
        if ended == Ended::OutOfTime {
            // It may have ended in between, which is as good.
            let _ = child.kill();
        }
        let status = child
            .wait()
            .map_err(|error| format!("{}: {error}", self.arch.qemu()))?;
        match ended {
            Ended::Otherwise(last) if !status.success() => Ok(Ended::Otherwise(format!(
                "{last}\n{}: {status}",
                self.arch.qemu()
            ))),
            ended => Ok(ended),
        }
    }

    /// The guest's files.
    fn archive(&self, place: &Place) -> Result<File, String> {
        let root = place.root(self.arch);
        let libraries = libraries::missing(self.arch, &root, &self.files)?;
        let failed = |what: &str, error: io::Error| format!("the guest's files: {what}: {error}");
        let file = tempfile::tempfile().map_err(|error| failed("temporary file", error))?;
        let mut archive = Archive::new(BufWriter::with_capacity(1 << 16, file));
        archive
            .tree("", &root)
            .map_err(|error| failed(&root.display().to_string(), error))?;
        for folder in ["dev", "etc", "proc", "sys", "tmp", "lab"] {
            archive
                .folder(folder)
                .map_err(|error| failed(folder, error))?;
        }
        archive
            .bytes("etc/passwd", 0o644, USERS.as_bytes())
            .map_err(|error| failed("etc/passwd", error))?;
        archive
            .bytes("init", 0o755, INIT.as_bytes())
            .map_err(|error| failed("init", error))?;
        let commands = format!("{}\n", self.commands);
        let commands = archive.bytes("lab/commands", 0o644, commands.as_bytes());
        commands.map_err(|error| failed("the commands", error))?;
        let mut names = BTreeSet::from(["commands".to_owned()]);
        for path in &self.files {
            let name = path.file_name().and_then(|name| name.to_str());
            let name = name.ok_or_else(|| format!("{}: no file name", path.display()))?;
            if !names.insert(name.to_owned()) {
                return Err(format!("/lab/{name} is there already: {}", path.display()));
            }
            let copied = archive.copy(&format!("lab/{name}"), path);
            copied.map_err(|error| format!("{}: {error}", path.display()))?;
        }
        for (name, path) in &libraries {
            let copied = archive.copy(&format!("lib/{}/{name}", self.arch.triplet()), path);
            copied.map_err(|error| format!("{}: {error}", path.display()))?;
        }
        let buffered = archive.finish().map_err(|error| failed("end", error))?;
        buffered
            .into_inner()
            .map_err(|error| failed("end", error.into_error()))
    }

    fn qemu(&self, place: &Place, archive: File) -> Result<Child, String> {
        let mut command = Command::new(self.arch.qemu());
        command.args(self.arch.machine());
        match self.exact {
            // Idle time is skipped, and no time comes from the host: not by its speed, not by its
            // clock, and not by random numbers.
            Some(shift) => command
                .args(["-accel", "tcg,thread=single"])
                .args(["-icount", &format!("shift={shift},align=off,sleep=off")])
                .args(["-rtc", "base=2026-01-01,clock=vm"])
                .args(["-seed", &self.seed.to_string()]),
            None => command.args(["-accel", "tcg,thread=multi"]),
        };
        command
            .args([
                "-smp",
                &self.cpus.to_string(),
                "-m",
                &self.memory.to_string(),
            ])
            .args([
                "-display",
                "none",
                "-no-reboot",
                "-nodefaults",
                "-no-user-config",
            ])
            // Both are opened anew: the archive at its begin, and a pipe that nothing is read from.
            .args([
                "-serial",
                "file:/dev/stdout",
                "-initrd",
                "/dev/stdin",
                "-kernel",
            ])
            .arg(place.kernel(self.arch)?)
            .stdin(archive)
            .stdout(Stdio::piped());
        // SAFETY: between fork and exec only functions that are async-signal-safe may be called.
        // prctl is a bare system call, and no memory is allocated here.
        unsafe {
            command.pre_exec(|| Ok(prctl::set_pdeathsig(Signal::SIGKILL)?));
        }
        command
            .spawn()
            .map_err(|error| format!("{}: {error}", self.arch.qemu()))
    }
}

/// Reads in a thread of its own, since a read has no time limit. The lines end when QEMU does.
fn read_lines(output: ChildStdout) -> Receiver<String> {
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || {
        let mut output = BufReader::new(output);
        let mut bytes = Vec::new();
        while output
            .read_until(b'\n', &mut bytes)
            .is_ok_and(|read| read > 0)
        {
            let line = String::from_utf8_lossy(&bytes).replace(['\r', '\n'], "");
            bytes.clear();
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    receiver
}

/// Hands on the lines between the two marks. A line of the program's that looks like the second
/// mark is one of many, and the last counts.
fn follow(lines: &Receiver<String>, until: Instant, line: &mut dyn FnMut(&str)) -> Ended {
    let mut has_begun = false;
    let mut last: Vec<String> = Vec::new();
    let mut end: Option<String> = None;
    loop {
        let left = until.saturating_duration_since(Instant::now());
        match lines.recv_timeout(left) {
            Ok(text) if text == BEGIN && !has_begun => has_begun = true,
            Ok(text) if has_begun && text.starts_with(END) => {
                if let Some(earlier) = end.replace(text) {
                    line(&earlier);
                }
            }
            // The kernel says how it ends.
            Ok(text) if end.is_some() && text.contains("reboot: ") => {}
            Ok(text) => {
                if let Some(earlier) = end.take() {
                    line(&earlier);
                }
                if has_begun {
                    line(&text);
                }
                if last.len() == KEPT {
                    last.remove(0);
                }
                last.push(text);
            }
            Err(RecvTimeoutError::Timeout) => return Ended::OutOfTime,
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    let code = end.as_deref().and_then(|end| end.strip_prefix(END));
    match code.and_then(|code| code.trim().parse().ok()) {
        Some(code) => Ended::Commands(code),
        None => Ended::Otherwise(last.join("\n")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(lines: &[&str]) -> (Ended, Vec<String>) {
        let (sender, receiver) = mpsc::channel();
        for line in lines {
            sender.send((*line).to_owned()).unwrap();
        }
        drop(sender);
        let mut printed = Vec::new();
        let until = Instant::now() + Duration::from_secs(60);
        let ended = follow(&receiver, until, &mut |line| printed.push(line.to_owned()));
        (ended, printed)
    }

    #[test]
    fn what_is_between_the_marks_is_printed() {
        let (ended, printed) = seen(&["SeaBIOS", BEGIN, "one", "two", "lab>>> 3"]);
        assert_eq!(
            (ended, printed),
            (Ended::Commands(3), vec!["one".to_owned(), "two".to_owned()])
        );
    }

    #[test]
    fn a_program_that_prints_the_mark_does_not_end_the_run() {
        let (ended, printed) = seen(&[
            BEGIN,
            "lab>>> 0",
            BEGIN,
            "lab>>> 1",
            "[ 1.2] reboot: Power down",
        ]);
        assert_eq!(ended, Ended::Commands(1));
        assert_eq!(printed, ["lab>>> 0", BEGIN]);
    }

    #[test]
    fn a_guest_that_stops_shows_its_last_lines() {
        let (ended, printed) = seen(&["booting", "Kernel panic"]);
        assert_eq!(ended, Ended::Otherwise("booting\nKernel panic".to_owned()));
        assert!(printed.is_empty());
    }

    #[test]
    fn a_guest_that_does_not_end_is_ended() {
        let (sender, receiver) = mpsc::channel();
        sender.send("booting".to_owned()).unwrap();
        assert_eq!(
            follow(&receiver, Instant::now(), &mut |_| {}),
            Ended::OutOfTime
        );
        drop(sender);
    }

    #[test]
    fn two_files_of_one_name_are_refused() {
        let lab = tempfile::tempdir().unwrap();
        let host = tempfile::tempdir().unwrap();
        let file = host.path().join("commands");
        std::fs::write(&file, "").unwrap();
        std::fs::create_dir(lab.path().join("root-amd64")).unwrap();
        let boot = Boot {
            files: vec![file],
            ..Boot::new(Arch::Amd64)
        };
        let said = boot.archive(&Place::at(lab.path())).unwrap_err();
        assert!(said.starts_with("/lab/commands is there already"), "{said}");
    }
}
