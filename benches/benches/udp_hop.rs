//! `udp_hop`: one hop of the link between two computers beside a bare ping-pong of datagrams of the
//! same length, on loopback and, as root, between two network namespaces.
//!
//! A hop is half of a round trip, the median of a block. Each side is on a core of its own. Both
//! sides of the bare one sleep in `recv`; so do those of the link on threads. On executors the link
//! waits by epoll, as for any file.

use std::{
    fs::File,
    net::{Ipv4Addr, SocketAddr, UdpSocket},
    os::fd::AsRawFd,
    process::Command,
    rc::Rc,
    sync::{Arc, Mutex},
    thread,
    time::{Duration, Instant},
};

use core_affinity::CoreId;
use luna::prelude::*;
use luna_benches::{
    cores::{on_cores, two_cores},
    harness::{Case, Goal, is_quick, run},
};
use luna_links::cycle::{CycleLink, Settings};

const LOOPBACK: &str = "UDP hop on loopback";
const NAMESPACES: &str = "UDP hop between network namespaces";
const BARE: &str = "bare send and recv";
const UNIT: &str = "ns/hop";

/// A value of a drive with six axes.
const SIZE: usize = 48;
/// What the link puts in front of it.
const HEAD: usize = 104;

type Value = [u8; SIZE];
type Link = CycleLink<Value, Value>;

/// The value of a trip; that of the last one ends the other side.
fn value(trip: u64) -> Value {
    let mut value = [0; SIZE];
    value[..8].copy_from_slice(&trip.to_le_bytes());
    value
}

fn trips() -> u64 {
    if is_quick() { 200 } else { 5_000 }
}

/// Of half a trip.
fn median(mut trips: Vec<u64>) -> f64 {
    trips.sort_unstable();
    trips[trips.len() / 2] as f64 / 2.0
}

/// Where the sockets are.
#[derive(Clone)]
enum Place {
    Loopback,
    Namespaces(Rc<Namespaces>),
}

impl Place {
    fn name(&self) -> &'static str {
        match self {
            Place::Loopback => LOOPBACK,
            Place::Namespaces(_) => NAMESPACES,
        }
    }

    /// Two sockets that are bound, and their addresses.
    fn sockets(&self) -> [(UdpSocket, SocketAddr); 2] {
        [0, 1].map(|side| {
            let socket = match self {
                Place::Loopback => UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)),
                Place::Namespaces(namespaces) => namespaces.socket(side),
            };
            let socket = socket.expect("the address is there");
            let address = socket.local_addr().expect("it is bound");
            (socket, address)
        })
    }

    fn links(&self) -> [Link; 2] {
        let [(here, near), (there, far)] = self.sockets();
        let settings = Settings::new(Duration::from_secs(30));
        let over = |socket, peer| Link::over(socket, peer, &settings).expect("they are bound");
        [over(here, far), over(there, near)]
    }
}

/// Two network namespaces with a wire, which go with it.
struct Namespaces([String; 2]);

impl Namespaces {
    fn new() -> Result<Self, String> {
        let id = std::process::id();
        let made = Self([0, 1].map(|side| format!("luna-bench-{id}-{side}")));
        let [here, there] = &made.0;
        ip(&format!("netns add {here}"))?;
        ip(&format!("netns add {there}"))?;
        ip(&format!(
            "link add name wire netns {here} type veth peer name wire netns {there}"
        ))?;
        for (side, name) in made.0.iter().enumerate() {
            ip(&format!(
                "-n {name} address add 10.77.1.{}/24 dev wire",
                side + 1
            ))?;
            ip(&format!("-n {name} link set wire up"))?;
        }
        made.socket(0)
            .map_err(|error| format!("no socket there: {error}"))?;
        Ok(made)
    }

    /// A socket stays in its namespace, wherever it is used.
    fn socket(&self, side: usize) -> std::io::Result<UdpSocket> {
        let path = format!("/run/netns/{}", self.0[side]);
        let enter = move || {
            let namespace = File::open(path)?;
            // SAFETY: the descriptor is open; the call changes this thread alone, which ends.
            if unsafe { libc::setns(namespace.as_raw_fd(), libc::CLONE_NEWNET) } != 0 {
                return Err(std::io::Error::last_os_error());
            }
            UdpSocket::bind((Ipv4Addr::new(10, 77, 1, side as u8 + 1), 0))
        };
        thread::spawn(enter).join().expect("it does not panic")
    }
}

impl Drop for Namespaces {
    fn drop(&mut self) {
        for name in &self.0 {
            let _ = ip(&format!("netns delete {name}"));
        }
    }
}

fn ip(arguments: &str) -> Result<(), String> {
    let output = Command::new("ip").args(arguments.split(' ')).output();
    let output = output.map_err(|error| format!("`ip` cannot be run: {error}"))?;
    match output.status.success() {
        true => Ok(()),
        false => Err(String::from_utf8_lossy(&output.stderr).trim().to_owned()),
    }
}

/// Two threads that sleep in `recv`, with datagrams as long as the link's.
fn bare(place: &Place, cores: [CoreId; 2]) -> f64 {
    let [(here, near), (there, far)] = place.sockets();
    here.connect(far).expect("it is bound");
    there.connect(near).expect("it is bound");
    let last = trips();
    let echo = move || {
        let mut bytes = [0; 2_048];
        loop {
            let length = there.recv(&mut bytes).expect("the other side sends");
            there
                .send(&bytes[..length])
                .expect("the other side is there");
            if bytes[..8] == last.to_le_bytes() {
                return;
            }
        }
    };
    let trip = move || {
        let mut bytes = [0; 2_048];
        let mut samples = Vec::with_capacity(last as usize);
        for number in 1..=last {
            let start = Instant::now();
            bytes[..8].copy_from_slice(&number.to_le_bytes());
            here.send(&bytes[..HEAD + SIZE])
                .expect("the other side is there");
            let length = here.recv(&mut bytes).expect("the other side answers");
            samples.push(start.elapsed().as_nanos() as u64);
            assert_eq!(
                (length, &bytes[..8]),
                (HEAD + SIZE, &number.to_le_bytes()[..])
            );
        }
        median(samples)
    };
    on_cores(cores, echo, trip)
}

/// The link, used by two threads that sleep in `recv`.
fn on_threads(place: &Place, cores: [CoreId; 2]) -> f64 {
    let [mut here, mut there] = place.links();
    let last = trips();
    let echo = move || {
        loop {
            let sample = there.blocking_recv().expect("the other side sends");
            there.send(&sample.value).expect("the other side is there");
            if sample.value == value(last) {
                return;
            }
        }
    };
    let trip = move || {
        while here.newest().is_ok_and(|sample| sample.is_none()) {
            here.send(&value(0)).expect("the other side is there");
        }
        let mut samples = Vec::with_capacity(last as usize);
        for number in 1..=last {
            let start = Instant::now();
            here.send(&value(number)).expect("the other side is there");
            // The first ones answer those that made both known to each other.
            while here.blocking_recv().expect("the other side answers").value != value(number) {}
            samples.push(start.elapsed().as_nanos() as u64);
        }
        assert_eq!(here.status().lost(), 0);
        median(samples)
    };
    on_cores(cores, echo, trip)
}

fn run_on(core: CoreId, body: impl Future<Output = luna::Result<()>> + Send + 'static) {
    let mut system = System::new("bench");
    let executor = system.executor("bench").core(core.id).build();
    let executor = executor.expect("the core is one of the machine's");
    executor
        .process("body")
        .spawn(body)
        .expect("it is the only one");
    drop(executor);
    system.run().expect("no process fails");
}

/// The link in processes of two executors.
fn on_executors(place: &Place, cores: [CoreId; 2]) -> f64 {
    let [mut here, mut there] = place.links();
    let last = trips();
    let echo = thread::spawn(move || {
        run_on(cores[0], async move {
            loop {
                let sample = there.recv().await?;
                there.send(&sample.value)?;
                if sample.value == value(last) {
                    return Ok(());
                }
            }
        });
    });
    let figure = Arc::new(Mutex::new(0.0));
    let result = figure.clone();
    run_on(cores[1], async move {
        while here.newest()?.is_none() {
            here.send(&value(0))?;
            luna::yield_now().await;
        }
        let mut samples = Vec::with_capacity(last as usize);
        for number in 1..=last {
            let start = Instant::now();
            here.send(&value(number))?;
            while here.recv().await?.value != value(number) {}
            samples.push(start.elapsed().as_nanos() as u64);
        }
        assert_eq!(here.status().lost(), 0);
        *result.lock().expect("no panic") = median(samples);
        Ok(())
    });
    echo.join().expect("it ends with the last trip");
    *figure.lock().expect("no panic")
}

fn cases(place: &Place, cores: [CoreId; 2]) -> Vec<Case> {
    let name = place.name();
    let at_most = |factor| Goal::Times {
        factor,
        name,
        peer: BARE,
        size: None,
        of: "the bare one",
    };
    let [threads, executors, peer] = [place.clone(), place.clone(), place.clone()];
    vec![
        Case::once(name, "LUNA, on threads", UNIT, move || {
            on_threads(&threads, cores)
        })
        .goal(at_most(1.1)),
        Case::once(name, "LUNA, on executors", UNIT, move || {
            on_executors(&executors, cores)
        })
        .goal(at_most(1.1)),
        Case::once(name, BARE, UNIT, move || bare(&peer, cores)),
    ]
}

fn main() {
    let Some(cores) = two_cores() else {
        return println!("skipped: udp_hop: it needs two cores");
    };
    let mut all = cases(&Place::Loopback, cores);
    match Namespaces::new() {
        Ok(namespaces) => {
            let place = Place::Namespaces(Rc::new(namespaces));
            all.extend(cases(&place, cores));
        }
        Err(why) => println!("skipped: {NAMESPACES}: {why}"),
    }
    run("udp_hop", all);
}
