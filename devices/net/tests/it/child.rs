//! The programs that the tests start, and kill: this test program again, with a task in its
//! environment.

use luna::prelude::*;
use luna_net::{Config, Network};
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Lines, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Duration;

const TASK: &str = "LUNA_NET_CHILD";

/// What a child prints when it has come to where it is to be killed.
const THERE: &str = "child: there";

/// Starts a child with a task. It is killed when dropped.
pub(crate) struct Program {
    child: Child,
    lines: Lines<BufReader<ChildStdout>>,
}

impl Program {
    pub(crate) fn start(task: &str, arguments: &[&str]) -> Self {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["child::program", "--exact", "--nocapture"])
            .env(TASK, format!("{task}\n{}", arguments.join("\n")))
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        Self { child, lines }
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// The next line of its output that has this text.
    pub(crate) fn line_with(&mut self, text: &str) -> String {
        let found = self.lines.find_map(|line| {
            let line = line.unwrap();
            line.contains(text).then_some(line)
        });
        found.unwrap_or_else(|| panic!("the child has ended: {:?}", self.child.wait()))
    }

    /// Waits until the child says that it is there.
    pub(crate) fn wait_until_there(&mut self) {
        self.line_with(THERE);
    }

    /// Sends SIGKILL.
    pub(crate) fn kill(&mut self) {
        self.child.kill().unwrap();
    }

    /// Sends SIGSTOP.
    pub(crate) fn stop(&self) {
        let command = format!("kill -STOP {}", self.id());
        let done = Command::new("sh").args(["-c", &command]).status().unwrap();
        assert!(done.success());
    }

    pub(crate) fn wait(&mut self) -> std::process::ExitStatus {
        self.child.wait().unwrap()
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A file of numbers. What was added stays when the program is killed.
struct Log(File);

impl Log {
    fn open(path: PathBuf) -> Self {
        let options = OpenOptions::new().append(true).create(true).open(path);
        Self(options.unwrap())
    }

    fn add(&mut self, number: u64) {
        self.0.write_all(&number.to_le_bytes()).unwrap();
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
    let _watchdog = (!crate::shared::is_long()).then(crate::shared::watchdog);
    let arguments: Vec<&str> = task.split('\n').collect();
    match arguments.as_slice() {
        ["hold", address] => run(hold(connected(address))),
        ["feed", address] => run(feed(connected(address))),
        ["send", address, folder] => {
            let config = drill(folder.as_ref()).listen(address);
            run(sends(open(&config), folder.into()));
        }
        ["stream", address, folder] => {
            let config = drill(folder.as_ref()).listen(address);
            run(streams(open(&config), folder.into()));
        }
        ["receive", address, folder] => {
            let config = drill(folder.as_ref()).connect(address);
            run(receives(open(&config), folder.into()));
        }
        ["listens", ..] => listens(),
        ["policies", ..] => policies(),
        task => panic!("no task {task:?}"),
    }
}

fn run(body: impl Future<Output = luna::Result<()>> + Send + 'static) {
    let mut system = System::new("child");
    let main = system.executor("main").policy(Policy::fifo(30)).build();
    main.unwrap().process("body").spawn(body).unwrap();
    system.run().unwrap();
}

fn connected(address: &str) -> Network {
    let config = Config::loopback().connect(address);
    Network::open(&config.connect_within(Duration::from_secs(30))).unwrap()
}

/// Of programs that are killed, or that have a bad network.
fn drill(folder: &Path) -> Config {
    let file = folder.join("network.json5");
    let config = match file.exists() {
        true => Config::from_file(file).unwrap(),
        false => Config::network(),
    };
    config.lost_after(Duration::from_secs(2))
}

/// The port may still be of a program that was killed.
fn open(config: &Config) -> Network {
    for _ in 0..200 {
        match Network::open(config) {
            Ok(network) => return network,
            Err(error) => println!("child: {error}"),
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    panic!("the network does not open");
}

async fn hold(network: Network) -> luna::Result<()> {
    let (receiver, mut link) = network.receiver::<u64>("test/hold")?;
    let holds = async move {
        let _held = receiver.recv_extended().await?;
        println!("\n{THERE}");
        std::future::pending::<luna::Result<()>>().await
    };
    par!(holds, link.run()).await?;
    Ok(())
}

async fn feed(network: Network) -> luna::Result<()> {
    let (sender, mut link) = network.sender::<u64>("test/feed")?;
    let feeds = async move {
        sender.send(1).await?;
        println!("\n{THERE}");
        std::future::pending::<luna::Result<()>>().await
    };
    par!(feeds, link.run()).await?;
    Ok(())
}

/// Sends unique numbers, session after session, until there is a file `stop`.
async fn sends(network: Network, folder: PathBuf) -> luna::Result<()> {
    let mut sent = Log::open(folder.join("acknowledged"));
    let stop = folder.join("stop");
    let mut next = u64::from(std::process::id()) << 32;
    while !stop.exists() {
        let opening = network.clone();
        let opened = luna::blocking(move || opening.sender::<u64>("test/kill")).await?;
        let (sender, mut link) = opened;
        let work = async {
            while !stop.exists() {
                next += 1;
                match sender.send_unless(next, stopped(&stop)).await {
                    Ok(()) => sent.add(next),
                    Err(_) => break,
                }
            }
            drop(sender);
            Ok::<(), luna::Error>(())
        };
        let run = async {
            if let Err(error) = link.run().await {
                println!("\nchild: {error}");
            }
            Ok::<(), luna::Error>(())
        };
        par!(run, work).await?;
    }
    luna::blocking(move || drop(network)).await;
    Ok(())
}

/// As [`sends`], as a stream. What was acknowledged of a session is noted after it.
async fn streams(network: Network, folder: PathBuf) -> luna::Result<()> {
    let mut acknowledged = Log::open(folder.join("acknowledged"));
    let stop = folder.join("stop");
    let mut next = u64::from(std::process::id()) << 32;
    while !stop.exists() {
        let opening = network.clone();
        let opened = luna::blocking(move || {
            let endpoint = opening.endpoint("test/kill").capacity(16);
            endpoint.buffered_sender::<u64>(Buffer::fifo(16))
        });
        let (sender, mut link) = opened.await?;
        let (status, first) = (link.status(), next + 1);
        let work = async {
            while !stop.exists() {
                next += 1;
                if sender.send_unless(next, stopped(&stop)).await.is_err() {
                    break;
                }
            }
            drop(sender);
            Ok::<(), luna::Error>(())
        };
        let run = async {
            let _ = link.run().await;
            Ok::<(), luna::Error>(())
        };
        par!(run, work).await?;
        // They are acknowledged in order.
        for number in first..first + status.acknowledged() {
            acknowledged.add(number);
        }
    }
    luna::blocking(move || drop(network)).await;
    Ok(())
}

/// Looks now and then, for the end of the test alone.
async fn stopped(stop: &Path) {
    while !stop.exists() {
        luna::after(Duration::from_millis(20)).await;
    }
}

/// Notes each number before its sender goes on, session after session, until there is a file
/// `stop`.
async fn receives(network: Network, folder: PathBuf) -> luna::Result<()> {
    let mut taken = Log::open(folder.join("taken"));
    let stop = folder.join("stop");
    while !stop.exists() {
        let opening = network.clone();
        let opened = luna::blocking(move || opening.receiver::<u64>("test/kill")).await?;
        let (receiver, mut link) = opened;
        let work = async {
            loop {
                alt! {
                    value = receiver.recv_extended() => match value {
                        Ok(value) => taken.add(*value),
                        Err(_) => break,
                    },
                    () = luna::after(Duration::from_millis(20)) => if stop.exists() {
                        break;
                    },
                }
            }
            drop(receiver);
            Ok::<(), luna::Error>(())
        };
        let run = async {
            if let Err(error) = link.run().await {
                println!("\nchild: {error}");
            }
            Ok::<(), luna::Error>(())
        };
        par!(run, work).await?;
    }
    luna::blocking(move || drop(network)).await;
    Ok(())
}

/// Prints the local addresses of all sockets that listen, or that take packets.
fn listens() {
    let network = Network::open(&Config::loopback()).unwrap();
    let own: Vec<u64> = std::fs::read_dir("/proc/self/fd")
        .unwrap()
        .filter_map(|entry| Some(std::fs::metadata(entry.ok()?.path()).ok()?.ino()))
        .collect();
    let mut found = String::from("\nsockets:");
    for table in ["tcp", "tcp6", "udp", "udp6"] {
        let text = std::fs::read_to_string(format!("/proc/net/{table}")).unwrap_or_default();
        for line in text.lines().skip(1) {
            let fields: Vec<&str> = line.split_whitespace().collect();
            let is_listening = fields[3] == "0A" || table.starts_with("udp");
            if is_listening && own.contains(&fields[9].parse().unwrap()) {
                let (host, _) = fields[1].split_once(':').unwrap();
                let host = match u32::from_str_radix(host, 16) {
                    Ok(host) => std::net::Ipv4Addr::from(host.swap_bytes()).to_string(),
                    Err(_) => host.to_owned(),
                };
                found += &format!(" {host}");
            }
        }
    }
    println!("{found}");
    drop(network);
}

/// Opens a network on a thread with a real-time policy, and prints the policies of all threads that
/// then are there, by name.
fn policies() {
    let body = async {
        let network = Network::open(&Config::loopback())?;
        let (_sender, _link) = network.sender::<u64>("test/policies")?;
        let mut found = String::from("\nthreads:");
        for entry in std::fs::read_dir("/proc/self/task").unwrap() {
            let folder = entry.unwrap().path();
            let name = std::fs::read_to_string(folder.join("comm")).unwrap();
            let stat = std::fs::read_to_string(folder.join("stat")).unwrap();
            let rest = stat.rsplit_once(')').unwrap().1;
            let policy = rest.split_whitespace().nth(38).unwrap();
            found += &format!(" {}={policy}", name.trim().replace(' ', "_"));
        }
        println!("{found}");
        Ok(())
    };
    run(body);
}
