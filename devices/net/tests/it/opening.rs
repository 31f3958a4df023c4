//! What is refused, and how the error says it.

use crate::shared::watchdog;
use crate::{address, networks, run, spawn};
use luna::Policy;
use luna_net::{Config, NetError, Network};
use std::path::PathBuf;
use std::time::Duration;

/// A file that is removed with it.
struct TestFile(PathBuf);

impl TestFile {
    fn new(name: &str, text: &str) -> Self {
        let path = std::env::temp_dir().join(format!("luna-net-{}-{name}", std::process::id()));
        std::fs::write(&path, text).unwrap();
        Self(path)
    }
}

impl Drop for TestFile {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

#[test]
fn types_are_compared_and_both_are_named() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    let (receiver, link) = there.receiver::<i32>("test/type").unwrap();
    let received = spawn(Policy::Other, link, async move {
        assert!(receiver.recv().await.unwrap_err().is_poisoned());
        Ok(())
    });
    let endpoint = here.endpoint("test/type").layout_version(3);
    let (sender, link) = endpoint.sender::<u32>().unwrap();
    let sent = run(Policy::Other, link, async move {
        assert!(sender.send(1).await.unwrap_err().is_poisoned());
        Ok(())
    });
    for error in [sent, received.join().unwrap()] {
        let text = error.unwrap_err().to_string();
        for part in [
            "`u32` (layout version 3)",
            "`i32` (layout version 0)",
            "test/type",
        ] {
            assert!(text.contains(part), "{text}");
        }
    }
}

#[test]
fn a_side_is_open_once() {
    let _watchdog = watchdog();
    let config = Config::loopback().lost_after(Duration::from_millis(300));
    let (here, there) = networks(&config);
    let (_sender, _link) = here.sender::<u32>("test/busy").unwrap();
    let error = here.sender::<u32>("test/busy").unwrap_err();
    assert!(matches!(error, NetError::Busy { .. }), "{error}");
    // The other side of it is free.
    let (_receiver, _other) = here.receiver::<u32>("test/busy").unwrap();

    // A second sender on another computer is refused when the first one is heard beside it.
    let (sender, link) = there.sender::<u32>("test/busy").unwrap();
    let refused = run(Policy::Other, link, async move {
        assert!(sender.send(1).await.unwrap_err().is_poisoned());
        Ok(())
    });
    let text = refused.unwrap_err().to_string();
    assert!(text.contains("has a sender already"), "{text}");
}

#[test]
fn names_are_checked() {
    let network = Network::open(&Config::loopback()).unwrap();
    for name in ["", "cell//ready", "cell/*", "/cell"] {
        let error = network.sender::<u32>(name).unwrap_err();
        assert!(matches!(error, NetError::Name { .. }), "{error}");
    }
}

#[test]
fn addresses_beyond_loopback_have_to_be_stated() {
    let config = Config::loopback().listen("tcp/0.0.0.0:7447");
    let error = Network::open(&config).unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("`tcp/0.0.0.0:7447`") && text.contains("Config::network()"),
        "{text}"
    );
    let config = Config::network().listen("tls/127.0.0.1:7447");
    let text = Network::open(&config).unwrap_err().to_string();
    assert!(
        text.contains("listen_certificate") && text.contains("Config::from_file"),
        "{text}"
    );
}

#[test]
fn an_address_that_nobody_listens_on_is_named() {
    let _watchdog = watchdog();
    let address = address();
    let config = Config::loopback().connect(&address);
    let config = config.connect_within(Duration::from_millis(300));
    let text = Network::open(&config).unwrap_err().to_string();
    assert!(text.contains(&address), "{text}");
}

#[test]
fn a_wrong_file_is_an_error_with_its_key() {
    let missing = Config::from_file("/nowhere/net.json5")
        .unwrap_err()
        .to_string();
    assert!(missing.contains("/nowhere/net.json5"), "{missing}");
    for (name, text, key) in [
        ("garbled", "{ mode: ", ""),
        ("list", "[]", ""),
        ("unknown", "{ mode: 'peer', lissten: { } }", "lissten"),
        (
            "inner",
            "{ scouting: { multicast: { enable: true } } }",
            "scouting/multicast/enable",
        ),
        ("value", "{ mode: 'master' }", "mode"),
        ("plugin", "{ plugins: { rest: {} } }", "plugins"),
        (
            "certificate",
            "{ transport: { link: { tls: { root_ca_certificate: '/nowhere/ca.pem' } } } }",
            "transport/link/tls/root_ca_certificate",
        ),
        (
            "tls",
            "{ listen: { endpoints: ['tls/127.0.0.1:7447'] } }",
            "transport/link/tls/listen_certificate",
        ),
    ] {
        let file = TestFile::new(name, text);
        let error = Config::from_file(&file.0).unwrap_err();
        let NetError::Config {
            place, key: found, ..
        } = &error
        else {
            panic!("{name}: {error}");
        };
        assert_eq!(found, key, "{error}");
        assert!(place.contains(file.0.to_str().unwrap()), "{error}");
    }
}

#[test]
fn a_file_opens_a_network() {
    let _watchdog = watchdog();
    let address = address();
    let text = format!("{{ mode: 'peer', listen: {{ endpoints: ['{address}'] }} }} // JSON5");
    let file = TestFile::new("good", &text);
    let here = Network::open(&Config::from_file(&file.0).unwrap()).unwrap();
    let there = Config::loopback().connect(&address);
    let there = Network::open(&there.connect_within(Duration::from_secs(30))).unwrap();
    let (receiver, link) = there.receiver::<u32>("test/file").unwrap();
    let received = spawn(Policy::Other, link, async move {
        assert_eq!(receiver.recv().await?, 5);
        Ok(())
    });
    let (sender, link) = here.sender::<u32>("test/file").unwrap();
    run(Policy::Other, link, async move {
        sender.send(5).await?;
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
    assert_eq!(here.connections(), 1);
}

#[test]
fn nothing_listens_beyond_loopback_by_itself() {
    let _watchdog = watchdog();
    let mut child = crate::child::Program::start("listens", &[]);
    let sockets = child.line_with("sockets:");
    let _ = child.wait();
    assert!(sockets.contains("127.0.0.1"), "{sockets}");
    for address in sockets.split_whitespace().skip(1) {
        assert!(address.starts_with("127.0.0.1"), "{sockets}");
    }
}

#[test]
fn values_that_do_not_fit_go_back() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    let (receiver, link) = there.receiver::<String>("test/fit").unwrap();
    let received = spawn(Policy::Other, link, async move {
        assert!(receiver.recv().await.unwrap_err().is_poisoned());
        Ok(())
    });
    let endpoint = here.endpoint("test/fit").capacity(8);
    let (sender, link) = endpoint.sender::<String>().unwrap();
    let sent = run(Policy::Other, link, async move {
        let error = sender
            .send("longer than eight".to_owned())
            .await
            .unwrap_err();
        assert_eq!(error.into_inner(), "longer than eight");
        Ok(())
    });
    let text = sent.unwrap_err().to_string();
    assert!(text.contains("in 8 bytes"), "{text}");
    assert!(received.join().unwrap().unwrap_err().is_poisoned());
}

#[test]
fn a_virtual_clock_is_refused() {
    let network = Network::open(&Config::loopback()).unwrap();
    let (_sender, link) = network.sender::<u64>("test/virtual").unwrap();
    let mut system = luna::System::new("simulated");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn(link).unwrap();
    let error = system.run().unwrap_err().to_string();
    assert!(error.contains("virtual clock"), "{error}");
}
