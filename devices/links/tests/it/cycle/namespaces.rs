//! Two network namespaces with a wire between them, as two computers have it. Needs root, and the
//! command `ip` (iproute2).

use crate::common::{SpawnOk, skip, with_files};
use luna::prelude::*;
use luna_links::cycle::{CycleLink, Settings};
use std::fs::File;
use std::net::{SocketAddr, UdpSocket};
use std::process::Command;
use std::time::Duration;

type Near = CycleLink<[u8; 8], [u8; 4]>;
type Far = CycleLink<[u8; 4], [u8; 8]>;

/// Two namespaces, which go with it.
struct Namespaces([String; 2]);

fn ip(arguments: &str) -> Result<(), String> {
    let output = Command::new("ip").args(arguments.split(' ')).output();
    let output = output.map_err(|error| format!("`ip` cannot be run: {error}"))?;
    match output.status.success() {
        true => Ok(()),
        false => {
            let text = String::from_utf8_lossy(&output.stderr);
            Err(format!("`ip {arguments}`: {}", text.trim()))
        }
    }
}

impl Namespaces {
    fn new() -> Result<Self, String> {
        let id = std::process::id();
        let made = Self([0, 1].map(|side| format!("luna-{id}-{side}")));
        let Self([here, there]) = &made;
        ip(&format!("netns add {here}"))?;
        ip(&format!("netns add {there}"))?;
        ip(&format!(
            "link add name wire netns {here} type veth peer name wire netns {there}"
        ))?;
        for (side, name) in made.0.iter().enumerate() {
            ip(&format!(
                "-n {name} address add 10.77.0.{}/24 dev wire",
                side + 1
            ))?;
            ip(&format!("-n {name} link set wire up"))?;
        }
        Ok(made)
    }

    fn address(side: usize) -> SocketAddr {
        SocketAddr::from(([10, 77, 0, side as u8 + 1], 7_000))
    }

    /// A socket within a namespace: it stays there, wherever it is used.
    fn socket(&self, side: usize) -> Result<UdpSocket, String> {
        let path = format!("/run/netns/{}", self.0[side]);
        let enter = move || {
            let namespace = File::open(path).map_err(|error| error.to_string())?;
            nix::sched::setns(namespace, nix::sched::CloneFlags::CLONE_NEWNET)
                .map_err(|error| format!("setns: {error}"))?;
            UdpSocket::bind(Self::address(side)).map_err(|error| format!("bind: {error}"))
        };
        // The thread alone enters it.
        let entered = std::thread::spawn(enter).join();
        entered.unwrap_or_else(|_| Err("its thread has panicked".to_owned()))
    }

    /// As if the cable were pulled.
    fn cut(&self) {
        ip(&format!("-n {} link set wire down", self.0[1])).unwrap();
    }

    fn mend(&self) {
        ip(&format!("-n {} link set wire up", self.0[1])).unwrap();
    }
}

impl Drop for Namespaces {
    fn drop(&mut self) {
        for name in &self.0 {
            let _ = ip(&format!("netns delete {name}"));
        }
    }
}

#[test]
fn values_cross_between_namespaces_and_a_cut_wire_is_noticed() {
    let Some(_watch) = with_files() else { return };
    let namespaces = match Namespaces::new() {
        Ok(made) => made,
        Err(why) => return skip(&format!("two network namespaces: {why}")),
    };
    let sockets = [0, 1].map(|side| namespaces.socket(side));
    let [here, there] = match sockets {
        [Ok(here), Ok(there)] => [here, there],
        [Err(why), _] | [_, Err(why)] => return skip(&format!("two network namespaces: {why}")),
    };
    let settings = Settings::new(Duration::from_millis(1)).stale_after(100);
    let mut near = Near::over(here, Namespaces::address(1), &settings).unwrap();
    let mut far = Far::over(there, Namespaces::address(0), &settings).unwrap();
    let (status, far_status) = (near.status(), far.status());
    let (over, ended) = luna::channel::<()>();
    let mut system = System::new("hop");
    let main = system.executor("main").build().unwrap();
    main.process("far").spawn_ok(async move {
        let mut tick = luna::periodic("far", Duration::from_millis(1))?;
        while !ended.try_recv().is_err_and(|error| error.is_closed()) {
            tick.next().await;
            far.send(&[7; 4])?;
            // It may be stale.
            let _ = far.newest();
        }
        Ok(())
    });
    main.process("near").spawn_ok(async move {
        let _over = over;
        let mut tick = luna::periodic("near", Duration::from_millis(1))?;
        let mut hears = async |count: u64, near: &mut Near| {
            let enough = near.status().received() + count;
            while near.status().received() < enough {
                tick.next().await;
                near.send(&[1; 8])?;
                let _ = near.newest();
            }
            Ok::<(), luna::Error>(())
        };
        hears(50, &mut near).await?;
        let lost = near.status().lost();
        namespaces.cut();
        while !near.recv().await.is_err_and(|error| error.is_stale()) {}
        namespaces.mend();
        hears(50, &mut near).await?;
        assert!(near.status().lost() > lost, "what was sent meanwhile");
        Ok(())
    });
    system.run().unwrap();
    let offset = status.offset().unwrap();
    assert!(offset.nanos.unsigned_abs() <= offset.error, "{offset:?}");
    assert!(status.stale() >= 1 && far_status.received() > 50);
    assert_eq!((status.sessions(), status.malformed()), (1, 0));
}
