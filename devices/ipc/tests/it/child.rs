//! The programs that the tests start, and kill: this test program again, with a task in its
//! environment.

use crate::{Block, block};
use luna::prelude::*;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;

const TASK: &str = "LUNA_IPC_CHILD";

/// What a child prints when it has come to where it is to be killed.
const THERE: &str = "child: there";

/// Starts a child with a task. It is killed when dropped.
pub(crate) struct Program(Child);

impl Program {
    pub(crate) fn start(task: &str, name: &str, folder: &Path) -> Self {
        let child = Command::new(std::env::current_exe().unwrap())
            .args(["child::program", "--exact", "--nocapture"])
            .env(TASK, format!("{task}:{name}:{}", folder.display()))
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        Self(child)
    }

    pub(crate) fn id(&self) -> u32 {
        self.0.id()
    }

    /// Waits until the child says that it is there.
    pub(crate) fn wait_until_there(&mut self) {
        let output = self.0.stdout.take().unwrap();
        let mut lines = BufReader::new(output).lines();
        assert!(
            lines.any(|line| line.unwrap().ends_with(THERE)),
            "the child has ended: {:?}",
            self.0.wait()
        );
    }

    /// Sends SIGKILL; the time of that in ns.
    pub(crate) fn kill(&mut self) -> u64 {
        let at = now();
        self.0.kill().unwrap();
        at
    }

    /// Sends SIGSTOP.
    pub(crate) fn stop(&self) {
        self.send(nix::sys::signal::Signal::SIGSTOP);
    }

    /// Sends SIGCONT.
    pub(crate) fn go_on(&self) {
        self.send(nix::sys::signal::Signal::SIGCONT);
    }

    fn send(&self, signal: nix::sys::signal::Signal) {
        let id = nix::unistd::Pid::from_raw(self.id() as i32);
        nix::sys::signal::kill(id, signal).unwrap();
    }

    pub(crate) fn wait(&mut self) -> std::process::ExitStatus {
        self.0.wait().unwrap()
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The monotonic clock, which all processes share.
pub(crate) fn now() -> u64 {
    let time = nix::time::clock_gettime(nix::time::ClockId::CLOCK_MONOTONIC).unwrap();
    time.tv_sec() as u64 * 1_000_000_000 + time.tv_nsec() as u64
}

/// A file of numbers. What was added stays when the program is killed.
pub(crate) struct Log(File);

impl Log {
    pub(crate) fn open(path: PathBuf) -> Self {
        let options = OpenOptions::new().append(true).create(true).open(path);
        Self(options.unwrap())
    }

    pub(crate) fn add<const N: usize>(&mut self, numbers: [u64; N]) {
        let bytes: Vec<u8> = numbers.iter().flat_map(|n| n.to_le_bytes()).collect();
        self.0.write_all(&bytes).unwrap();
    }
}

pub(crate) fn read_log(path: &Path) -> Vec<u64> {
    let bytes = std::fs::read(path).unwrap_or_default();
    let (numbers, rest) = bytes.as_chunks::<8>();
    assert!(rest.is_empty());
    numbers.iter().map(|n| u64::from_le_bytes(*n)).collect()
}

/// Not a test: what a child does.
#[test]
fn program() {
    let Ok(task) = std::env::var(TASK) else {
        return;
    };
    let _watchdog = crate::shared::watchdog();
    let (task, rest) = task.split_once(':').unwrap();
    let (name, folder) = rest.split_once(':').unwrap();
    let (name, folder) = (name.to_owned(), PathBuf::from(folder));
    let mut system = System::new("child");
    let policy = match (task, looks()) {
        ("low-takes" | "low-gives" | "low-serves", _) => Policy::fifo(20),
        (_, 0) | ("calls", _) => Policy::fifo(30),
        // Two that look take all of two cores, which others need too.
        _ => Policy::Other,
    };
    let mut main = system.executor("main").policy(policy);
    if task.starts_with("low") {
        main = main.core(crate::same_core::core());
    }
    let main = main.build().unwrap();
    match task {
        "hold" => {
            let (receiver, link) = luna_ipc::receiver::<Block>(&name).unwrap();
            main.process("link").spawn(link).unwrap();
            let holds = async move {
                let _held = receiver.recv_extended().await?;
                println!("\n{THERE}");
                std::future::pending::<()>().await;
                Ok(())
            };
            main.process("holds").spawn(holds).unwrap();
        }
        "feed" => {
            let (sender, link) = luna_ipc::sender::<Block>(&name).unwrap();
            main.process("link").spawn(link).unwrap();
            let feeds = async move {
                sender.send(block(1)).await?;
                println!("\n{THERE}");
                std::future::pending::<()>().await;
                Ok(())
            };
            main.process("feeds").spawn(feeds).unwrap();
        }
        "low-takes" => {
            let (receiver, link) = luna_ipc::receiver::<Block>(&name).unwrap();
            main.process("link").spawn(link).unwrap();
            let takes = async move {
                while receiver.recv().await.is_ok() {}
                Ok(())
            };
            main.process("takes").spawn(takes).unwrap();
        }
        "low-gives" => {
            let (sender, link) = luna_ipc::sender::<Block>(&name).unwrap();
            main.process("link").spawn(link).unwrap();
            let gives = async move {
                let mut number = 1;
                while sender.send(block(number)).await.is_ok() {
                    number += 1;
                }
                Ok(())
            };
            main.process("gives").spawn(gives).unwrap();
        }
        "low-serves" | "holds-call" => {
            let (server, link) = luna_ipc::server::<u64, u64>(&name).unwrap();
            main.process("link").priority(31).spawn(link).unwrap();
            let holds = task == "holds-call";
            let serves = async move {
                while let Ok(call) = server.accept().await {
                    if holds {
                        println!("\n{THERE}");
                        std::future::pending::<()>().await;
                    }
                    crate::kernel::burn(std::time::Duration::from_micros(20));
                    let answer = *call + 1;
                    let _ = call.reply(answer);
                }
                Ok(())
            };
            main.process("serves").spawn(serves).unwrap();
        }
        "calls" => {
            let (client, link) = luna_ipc::client::<u64, u64>(&name).unwrap();
            main.process("link").spawn(link).unwrap();
            let calls = async move { Ok(client.call(1).await.map(drop)?) };
            main.process("calls").spawn(calls).unwrap();
        }
        "holds-loan" => {
            let endpoint = luna_ipc::Endpoint::new(&name);
            let (receiver, link) = endpoint.loan_receiver::<u64>(2).unwrap();
            main.process("link").spawn(link).unwrap();
            let holds = async move {
                let _held = receiver.recv().await?;
                let _pending = receiver.recv_extended().await?;
                println!("\n{THERE}");
                std::future::pending::<()>().await;
                Ok(())
            };
            main.process("holds").spawn(holds).unwrap();
        }
        "board" => {
            let board = luna_ipc::Blackboard::new(&name).entry("large", [0_u64; 8192]);
            let mut writer = board.write().unwrap();
            let mut large = writer.take::<[u64; 8192]>("large").unwrap();
            println!("\n{THERE}");
            for number in 1.. {
                large.set([number; 8192]);
            }
        }
        "send" => drop(main.process("sends").spawn(sends(name, folder)).unwrap()),
        "receive" => drop(
            main.process("receives")
                .spawn(receives(name, folder))
                .unwrap(),
        ),
        task => panic!("no task `{task}`"),
    }
    system.run().unwrap();
}

/// How often the links of this program look: in every other program.
fn looks() -> u32 {
    std::process::id() % 2 * 100
}

/// Sends unique numbers, session after session, until there is a file `stop`.
async fn sends(name: String, folder: PathBuf) -> luna::Result<()> {
    let mut sent = Log::open(folder.join("acknowledged"));
    let mut ends = Log::open(folder.join("ends"));
    let stop = folder.join("stop");
    let mut next = u64::from(std::process::id()) << 32;
    let name: Arc<str> = name.into();
    while !stop.exists() {
        let opening = name.clone();
        let opened = luna::blocking(move || luna_ipc::sender::<u64>(&opening)).await?;
        let (sender, link) = opened;
        let mut link = link.looks(looks());
        let status = link.status();
        let work = async {
            let mut is_over = false;
            while !is_over && !stop.exists() {
                next += 1;
                match sender.send_unless(next, stopped(&stop)).await {
                    Ok(()) => sent.add([next]),
                    Err(_) => is_over = true,
                }
            }
            if let (true, Some(partner)) = (is_over, status.partner()) {
                ends.add([u64::from(partner), now(), u64::from(looks())]);
            }
            drop(sender);
            Ok::<(), luna::Error>(())
        };
        let run = async {
            let _ = link.run().await;
            Ok::<(), luna::Error>(())
        };
        par!(run, work).await?;
        luna::blocking(move || drop(link)).await;
    }
    Ok(())
}

/// Looks now and then, for the end of the test alone.
async fn stopped(stop: &Path) {
    while !stop.exists() {
        luna::after(std::time::Duration::from_millis(20)).await;
    }
}

/// Notes each number before its sender goes on, session after session, until there is a file
/// `stop`.
async fn receives(name: String, folder: PathBuf) -> luna::Result<()> {
    let mut taken = Log::open(folder.join("taken"));
    let mut ends = Log::open(folder.join("ends"));
    let stop = folder.join("stop");
    let name: Arc<str> = name.into();
    while !stop.exists() {
        let opening = name.clone();
        let opened = luna::blocking(move || luna_ipc::receiver::<u64>(&opening)).await?;
        let (receiver, link) = opened;
        let mut link = link.looks(looks());
        let status = link.status();
        let work = async {
            loop {
                alt! {
                    value = receiver.recv_extended() => match value {
                        Ok(value) => taken.add([*value]),
                        Err(_) => break,
                    },
                    () = luna::after(std::time::Duration::from_millis(20)) => if stop.exists() {
                        break;
                    },
                }
            }
            if let (false, Some(partner)) = (stop.exists(), status.partner()) {
                ends.add([u64::from(partner), now(), u64::from(looks())]);
            }
            drop(receiver);
            Ok::<(), luna::Error>(())
        };
        let run = async {
            let _ = link.run().await;
            Ok::<(), luna::Error>(())
        };
        par!(run, work).await?;
        luna::blocking(move || drop(link)).await;
    }
    Ok(())
}
