//! The programs that the tests start, and kill: this test program again, with a task in its
//! environment.

use crate::{Block, block};
use luna::prelude::*;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

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
    let policy = match (task, crate::kill_tasks::looks()) {
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
        task => crate::kill_tasks::spawn(task, &main, name, folder),
    }
    system.run().unwrap();
}
