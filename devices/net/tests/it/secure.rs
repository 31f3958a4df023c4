//! TLS, QUIC and passwords, from files.

use crate::kill::folder;
use crate::shared::{skip, watchdog};
use crate::{address, run, spawn};
use luna::Policy;
use luna_net::{Config, Network};
use std::path::Path;
use std::process::Command;
use std::time::Duration;

fn openssl(folder: &Path, arguments: &str) -> Result<(), String> {
    let words = arguments.split_whitespace();
    let run = Command::new("openssl")
        .args(words)
        .current_dir(folder)
        .output();
    let output = run.map_err(|error| error.to_string())?;
    match output.status.success() {
        true => Ok(()),
        false => Err(String::from_utf8_lossy(&output.stderr).into_owned()),
    }
}

/// An authority, and a certificate of it for 127.0.0.1.
pub(crate) fn certificates(folder: &Path) -> Result<(), String> {
    let new = "req -newkey rsa:2048 -nodes -days 2";
    openssl(
        folder,
        &format!("{new} -x509 -keyout ca.key -out ca.pem -subj /CN=authority"),
    )?;
    openssl(
        folder,
        &format!("{new} -keyout host.key -out host.csr -subj /CN=host"),
    )?;
    std::fs::write(folder.join("names"), "subjectAltName=IP:127.0.0.1\n").unwrap();
    let sign = "x509 -req -days 2 -CA ca.pem -CAkey ca.key -CAcreateserial -extfile names";
    openssl(folder, &format!("{sign} -in host.csr -out host.pem"))
}

fn config(folder: &Path, name: &str, text: &str) -> Config {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    let limit = Duration::from_secs(30);
    Config::from_file(&path).unwrap().connect_within(limit)
}

/// A value crosses.
fn exchange(here: &Network, there: &Network) {
    exchange_by("test/secure", here, there);
}

fn exchange_by(name: &str, here: &Network, there: &Network) {
    let (receiver, link) = there.receiver::<u64>(name).unwrap();
    let received = spawn(Policy::Other, link, async move {
        assert_eq!(receiver.recv().await?, 7);
        Ok(())
    });
    let (sender, link) = here.sender::<u64>(name).unwrap();
    run(Policy::Other, link, async move {
        sender.send(7).await?;
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
}

#[test]
fn tls_and_quic_let_in_who_trusts_the_certificate() {
    let _watchdog = watchdog();
    let folder = folder("secure");
    if let Err(why) = certificates(&folder) {
        return skip(&format!("openssl makes no certificates: {why}"));
    }
    let place = folder.display();
    for protocol in ["tls", "quic"] {
        let address = address().replace("tcp/", &format!("{protocol}/"));
        let server = format!(
            "{{ listen: {{ endpoints: ['{address}'] }}, transport: {{ link: {{ tls: {{
                listen_certificate: '{place}/host.pem', listen_private_key: '{place}/host.key'
            }} }} }} }}"
        );
        let here = Network::open(&config(&folder, "server.json5", &server)).unwrap();
        let client = |authority: &str| {
            format!(
                "{{ connect: {{ endpoints: ['{address}'] }}, transport: {{ link: {{ tls: {{
                    root_ca_certificate: '{place}/{authority}' }} }} }} }}"
            )
        };
        let there = Network::open(&config(&folder, "client.json5", &client("ca.pem"))).unwrap();
        exchange(&here, &there);
        drop(there);
        // Another authority than that of the server's certificate.
        openssl(
            &folder,
            "req -newkey rsa:2048 -nodes -x509 -keyout x.key -out x.pem -subj /CN=other",
        )
        .unwrap();
        let stranger = config(&folder, "stranger.json5", &client("x.pem"));
        let stranger = stranger.connect_within(Duration::from_millis(500));
        let error = Network::open(&stranger).unwrap_err().to_string();
        assert!(error.contains(&address), "{error}");
        drop(here);
    }
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn passwords_let_in_who_knows_one() {
    let _watchdog = watchdog();
    let folder = folder("password");
    let address = address();
    let place = folder.display();
    std::fs::write(folder.join("users"), "press:secret\nfeeder:hidden\n").unwrap();
    let part = |user: &str, password: &str| {
        format!(
            "transport: {{ auth: {{ usrpwd: {{ user: '{user}', password: '{password}',
                dictionary_file: '{place}/users' }} }} }}"
        )
    };
    let server = format!(
        "{{ listen: {{ endpoints: ['{address}'] }}, {} }}",
        part("press", "secret")
    );
    let here = Network::open(&config(&folder, "server.json5", &server)).unwrap();
    let client = |user, password| {
        let connect = format!("connect: {{ endpoints: ['{address}'] }}");
        format!("{{ {connect}, {} }}", part(user, password))
    };
    let good = client("feeder", "hidden");
    let there = Network::open(&config(&folder, "good.json5", &good)).unwrap();
    exchange(&here, &there);
    drop(there);
    let bad = config(&folder, "bad.json5", &client("feeder", "guessed"));
    let bad = bad.connect_within(Duration::from_millis(500));
    let error = Network::open(&bad).unwrap_err().to_string();
    assert!(error.contains(&address), "{error}");
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn access_control_says_which_channels_there_are() {
    let _watchdog = watchdog();
    let folder = folder("access");
    let address = address();
    let server = format!(
        "{{ listen: {{ endpoints: ['{address}'] }}, access_control: {{
            enabled: true, default_permission: 'deny',
            rules: [{{
                id: 'cell', permission: 'allow', flows: ['ingress', 'egress'],
                messages: ['put', 'declare_subscriber', 'liveliness_token',
                    'liveliness_query', 'declare_liveliness_subscriber'],
                key_exprs: ['luna/cell/**'],
            }}],
            subjects: [{{ id: 'all' }}],
            policies: [{{ rules: ['cell'], subjects: ['all'] }}],
        }} }}"
    );
    let here = Network::open(&config(&folder, "server.json5", &server)).unwrap();
    let there = Config::loopback().connect(&address);
    let there = Network::open(&there.connect_within(Duration::from_secs(30))).unwrap();
    exchange_by("cell/ready", &here, &there);
    // Nobody joins the other one, so its deadline is exact.
    let (_receiver, _link) = there.receiver::<u64>("other/ready").unwrap();
    let (sender, link) = here.sender::<u64>("other/ready").unwrap();
    run(Policy::Other, link, async move {
        let late = sender.send_timeout(1, Duration::from_millis(1500)).await;
        assert!(late.unwrap_err().is_timeout());
        Ok(())
    })
    .unwrap();
    // And what names no subject is refused.
    let wrong = server.replace("subjects: ['all']", "subjects: ['nobody']");
    let wrong = config(&folder, "wrong.json5", &wrong);
    assert!(Network::open(&wrong).is_err());
    std::fs::remove_dir_all(folder).unwrap();
}
