//! Links on loopback: partners that start late, are restarted, silent, foreign, or of another type.

use crate::common::{SpawnOk, with_files};
use luna::prelude::*;
use luna_links::cycle::{CycleData, CycleError, CycleLink, Sample, Sent, Settings};
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

pub(crate) type Link = CycleLink<[u8; 8], [u8; 8]>;

/// So long that no test waits for it.
pub(crate) fn patient() -> Settings {
    Settings::new(Duration::from_secs(30))
}

pub(crate) fn bound() -> (UdpSocket, SocketAddr) {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = socket.local_addr().unwrap();
    (socket, address)
}

pub(crate) fn pair<O: CycleData, I: CycleData>(
    settings: &Settings,
) -> (CycleLink<O, I>, CycleLink<I, O>) {
    let ((here, near), (there, far)) = (bound(), bound());
    let here = CycleLink::over(here, far, settings).unwrap();
    (here, CycleLink::over(there, near, settings).unwrap())
}

/// The next value; the test's watchdog ends it otherwise.
fn next(link: &mut Link) -> Sample<[u8; 8]> {
    loop {
        match link.newest().unwrap() {
            Some(sample) => return sample,
            None => std::thread::yield_now(),
        }
    }
}

/// Sends and looks until a value of the partner has come; the test's watchdog ends it otherwise.
fn meet(here: &mut Link, there: &mut Link) -> Sample<[u8; 8]> {
    loop {
        here.send(&[1; 8]).unwrap();
        let _ = there.newest();
        there.send(&[2; 8]).unwrap();
        if let Ok(Some(sample)) = here.newest() {
            return sample;
        }
    }
}

#[test]
fn values_cross_with_their_age() {
    let Some(_watch) = with_files() else { return };
    let (mut here, mut there) = pair(&patient());
    let sample = meet(&mut here, &mut there);
    assert_eq!((sample.value, sample.lost_before), ([2; 8], 0));
    for number in 0..1_000_u64 {
        assert_eq!(there.send(&number.to_le_bytes()).unwrap(), Sent::Handed);
        let sample = next(&mut here);
        assert_eq!(sample.value, number.to_le_bytes());
        assert_eq!((sample.lost_before, sample.skipped), (0, 0));
        // Both clocks are one.
        let offset = here.status().offset().unwrap();
        assert!(offset.nanos.unsigned_abs() <= offset.error, "{offset:?}");
        let age = sample.age.unwrap();
        let real = sample.received.nanos_since(sample.sent).unsigned_abs();
        let real = Duration::from_nanos(real);
        assert!(
            real <= age.time + age.error && age.time <= real + age.error,
            "{age:?}"
        );
        here.send(&[0; 8]).unwrap();
        next(&mut there);
    }
    assert_eq!((here.status().lost(), there.status().lost()), (0, 0));
}

#[test]
fn the_newest_of_several_comes_and_says_how_many_it_passed() {
    let Some(_watch) = with_files() else { return };
    let (mut here, mut there) = pair(&patient());
    meet(&mut here, &mut there);
    for number in 0..10 {
        there.send(&[number; 8]).unwrap();
    }
    let mut all = 0;
    loop {
        // One, unless the kernel delivers some of them later.
        let sample = next(&mut here);
        assert_eq!(sample.lost_before, 0);
        all += 1 + sample.skipped;
        if sample.value == [9; 8] {
            break;
        }
    }
    assert_eq!(all, 10);
    assert!(here.newest().unwrap().is_none());
    assert_eq!(here.status().lost(), 0);
}

#[test]
fn others_are_not_heard() {
    let Some(_watch) = with_files() else { return };
    let (mut here, mut there) = pair(&patient());
    meet(&mut here, &mut there);
    let (stranger, _) = bound();
    let address = here.local_address().unwrap();
    for bytes in [&b"hello"[..], &[], &[7; 2_000]] {
        stranger.send_to(bytes, address).unwrap();
    }
    assert!(here.newest().unwrap().is_none());
    assert_eq!(
        here.status().malformed(),
        0,
        "the kernel gives it to nobody"
    );
    there.send(&[5; 8]).unwrap();
    assert_eq!(next(&mut here).value, [5; 8]);
}

#[test]
fn a_partner_that_is_restarted_is_a_new_session() {
    let Some(_watch) = with_files() else { return };
    let ((here, near), (there, far)) = (bound(), bound());
    let settings = Settings::new(Duration::from_millis(10)).stale_after(1);
    let mut here = Link::over(here, far, &settings).unwrap();
    let mut first = Link::over(there, near, &settings).unwrap();
    assert_eq!(meet(&mut here, &mut first).session, 1);
    drop(first);
    // Nobody listens now: counted, and no error.
    while here.status().refused() < 3 {
        here.send(&[1; 8]).unwrap();
    }
    let there = UdpSocket::bind(far).unwrap();
    let mut second = Link::over(there, near, &settings).unwrap();
    let sample = loop {
        let sample = meet(&mut here, &mut second);
        if sample.session == 2 {
            break sample;
        }
    };
    assert_eq!(sample.lost_before, 0);
    assert_eq!(here.status().sessions(), 2);
}

#[test]
fn a_silent_partner_makes_the_link_stale_and_may_come_back() {
    let Some(_watch) = with_files() else { return };
    let settings = Settings::new(Duration::from_millis(5)).stale_after(2);
    let (mut here, mut there): (Link, Link) = pair(&settings);
    // Not one value yet.
    let start = Instant::now();
    let error = here.blocking_recv().unwrap_err();
    assert!(
        error.is_stale() && error.to_string().contains("not one value"),
        "{error}"
    );
    assert!(start.elapsed() >= settings.limit());
    meet(&mut here, &mut there);
    let error = loop {
        match here.newest() {
            Ok(_) => std::thread::yield_now(),
            Err(error) => break error,
        }
    };
    let CycleError::Stale {
        silence,
        other_type: None,
        ..
    } = error
    else {
        panic!("{error}")
    };
    assert_eq!((silence.limit, silence.has_heard), (settings.limit(), true));
    assert!(here.newest().unwrap_err().is_stale());
    assert_eq!(here.status().stale(), 2);
    meet(&mut here, &mut there);
    assert_eq!(here.status().sessions(), 1);
}

#[test]
fn a_partner_of_another_type_is_named() {
    let Some(_watch) = with_files() else { return };
    let settings = Settings::new(Duration::from_millis(1)).stale_after(1);
    let ((here, near), (there, far)) = (bound(), bound());
    let mut here = Link::over(here, far, &settings).unwrap();
    let mut there = CycleLink::<[u8; 4], [u8; 8]>::over(there, near, &settings).unwrap();
    there.send(&[0; 4]).unwrap();
    let error = loop {
        if let Err(error) = here.newest() {
            break error.to_string();
        }
    };
    assert!(
        error.contains("4 bytes") && error.contains("8 bytes"),
        "{error}"
    );
    assert_eq!((here.status().mistyped(), here.status().received()), (1, 0));
}

#[test]
fn addresses_that_are_no_computers() {
    let address = |text: &str| text.parse::<SocketAddr>().unwrap();
    let open = |local, peer| Link::open(address(local), address(peer), &patient()).unwrap_err();
    let any = open("0.0.0.0:0", "127.0.0.1:9");
    assert!(matches!(any, CycleError::AnyAddress { .. }), "{any}");
    for peer in ["127.0.0.1:0", "0.0.0.0:9", "[::]:9"] {
        let none = open("127.0.0.1:0", peer);
        assert!(matches!(none, CycleError::NoPeer { .. }), "{none}");
    }
    // An address for documentation, which no machine has.
    let foreign = open("192.0.2.1:0", "127.0.0.1:9");
    assert!(matches!(foreign, CycleError::Socket { .. }), "{foreign}");
}

#[test]
fn a_value_goes_back_and_forth_by_either_way_of_waiting() {
    let Some(_watch) = with_files() else { return };
    const TRIPS: u64 = 300;
    let (mut here, mut there): (Link, Link) = pair(&patient());
    meet(&mut here, &mut there);
    let far = std::thread::spawn(move || {
        loop {
            let sample = there.blocking_recv().unwrap();
            there.send(&sample.value).unwrap();
            if sample.value == TRIPS.to_le_bytes() {
                return there;
            }
        }
    });
    let mut system = System::new("trips");
    let main = system.executor("main").build().unwrap();
    main.process("near").spawn_ok(async move {
        for number in 1..=TRIPS {
            here.send(&number.to_le_bytes())?;
            // One of the meeting may come back first.
            while here.recv().await?.value != number.to_le_bytes() {}
        }
        assert_eq!(here.status().lost(), 0);
        Ok(())
    });
    system.run().unwrap();
    let there = far.join().unwrap();
    assert_eq!(there.status().lost(), 0);
}

#[test]
fn a_virtual_clock_is_refused() {
    let Some(_watch) = with_files() else { return };
    let (mut here, _there): (Link, Link) = pair(&patient());
    let mut system = System::new("virtual");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    main.process("user").spawn_ok(async move {
        let error = here.send(&[0; 8]).unwrap_err();
        assert!(matches!(error, CycleError::VirtualClock { .. }), "{error}");
        Ok(())
    });
    system.run().unwrap();
}
