//! Programs on a network that loses, delays and reorders packets, and is cut for longer than a
//! partner may be silent.

use crate::child::Program;
use crate::kill::{check, folder, wait_for_progress};
use crate::relay::{Relay, Weather};
use crate::secure::certificates;
use crate::shared::{Random, is_long, skip, watchdog};
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::time::{Duration, Instant};

/// What the programs of one test are to be carried over.
const WEATHER: Weather = Weather {
    loss: 13, // of 256: 5 %
    delay: Duration::from_millis(50),
    spread: Duration::from_millis(20),
};

/// What both programs read: certificates if there are any, and no way around the relay.
fn configuration(folder: &Path, has_certificates: bool) {
    let tls = match has_certificates {
        true => {
            let place = folder.display();
            format!(
                "transport: {{ link: {{ tls: {{ listen_certificate: '{place}/host.pem',
                    listen_private_key: '{place}/host.key',
                    root_ca_certificate: '{place}/ca.pem' }} }} }}, "
            )
        }
        false => String::new(),
    };
    let text = format!("{{ {tls}scouting: {{ gossip: {{ enabled: false }} }} }}");
    std::fs::write(folder.join("network.json5"), text).unwrap();
}

/// Waits until so many more were taken than `before` says.
fn wait_for_values(taken: &Path, before: u64, values: u64) -> u64 {
    let mut size = before;
    while size < before + 8 * values {
        size = wait_for_progress(taken, size);
    }
    size
}

/// Values go through a relay, one at a time; it is cut until both programs have lost each other, in
/// the long form for 10 s; values go on in the next session.
fn drill(protocol: &str, folder: &Path, new: fn(Weather, Random, SocketAddr) -> Relay) {
    let (values, cut) = match is_long() {
        true => (500, Duration::from_secs(10)),
        false => (50, Duration::ZERO),
    };
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let target = server.local_addr().unwrap();
    drop(server);
    let relay = new(WEATHER, Random::seeded(), target);
    let place = folder.to_str().unwrap();
    let start = |task, address| {
        let address = format!("{protocol}/{address}");
        Program::start(task, &[&address, place])
    };
    let mut programs = [start("send", target), start("receive", relay.address())];
    let taken = folder.join("taken");
    let before = wait_for_values(&taken, 0, values);
    relay.cut(true);
    let begin = Instant::now();
    for program in &mut programs {
        program.line_with("is lost");
    }
    let noticed = begin.elapsed();
    // The rest of the partition.
    std::thread::sleep(cut.saturating_sub(begin.elapsed()));
    let during = std::fs::metadata(&taken).unwrap().len();
    assert!(during <= before + 8 * 8, "values go around the relay");
    relay.cut(false);
    let mended = Instant::now();
    let after = wait_for_progress(&taken, during);
    let joined = mended.elapsed();
    wait_for_values(&taken, after, values);
    std::fs::write(folder.join("stop"), "").unwrap();
    for program in &mut programs {
        assert!(program.wait().success());
    }
    let (carried, lost) = relay.counts();
    assert!(lost > 0 || protocol == "tcp");
    check(
        folder,
        &format!(
            "{protocol}, 50 ± 20 ms, {carried} packets carried, {lost} lost, cut noticed after \
             {noticed:.1?}, joined {joined:.1?} after its end"
        ),
    );
}

#[test]
fn no_value_is_lost_or_doubled_where_datagrams_are() {
    let _watchdog = (!is_long()).then(watchdog);
    let folder = folder("quic");
    if let Err(why) = certificates(&folder) {
        return skip(&format!("openssl makes no certificates: {why}"));
    }
    configuration(&folder, true);
    drill("quic", &folder, Relay::udp);
}

#[test]
fn no_value_is_lost_or_doubled_where_a_connection_stands_still() {
    let _watchdog = (!is_long()).then(watchdog);
    let folder = folder("tcp");
    configuration(&folder, false);
    drill("tcp", &folder, Relay::tcp);
}
