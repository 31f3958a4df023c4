//! The findings on other machines' files, and on files that are broken in every way.

mod fitness;

use super::diagnosis::Diagnosis;
use super::facts::cpu_time::cpu_time;
use super::finding::{Check, Verdict};
use super::machine::Machine;
use super::{checks, look, table};
use crate::columns::WIDTH;
use luna_machine::facts::{Source, Unread, UnreadReason};
use std::collections::{BTreeMap, HashSet};
use std::fs;
use std::path::PathBuf;

/// Machines, each in one text: sections that begin with `=== `. Those with a path are files.
const MACHINES: [(&str, &str); 6] = [
    ("tuned", include_str!("../../tests/machines/tuned.txt")),
    ("laptop", include_str!("../../tests/machines/laptop.txt")),
    ("virtual", include_str!("../../tests/machines/virtual.txt")),
    (
        "container",
        include_str!("../../tests/machines/container.txt"),
    ),
    ("old", include_str!("../../tests/machines/old.txt")),
    ("board", include_str!("../../tests/machines/board.txt")),
];

/// One of the machines, unpacked into a folder, which is removed when this is dropped.
struct Unpacked {
    sections: BTreeMap<&'static str, &'static str>,
    root: PathBuf,
}

impl Unpacked {
    fn new(test: &str, name: &str, text: &'static str) -> Unpacked {
        let root = std::env::temp_dir().join(format!("luna-{test}-{name}-{}", std::process::id()));
        let mut sections = BTreeMap::new();
        for section in text.split("=== ").skip(1) {
            let (title, text) = section.split_once('\n').expect("a title has a line");
            assert!(sections.insert(title, text).is_none(), "{title} twice");
        }
        let unpacked = Unpacked { sections, root };
        for (path, text) in unpacked.files() {
            unpacked.write(path, text.as_bytes());
        }
        unpacked
    }

    fn files(&self) -> impl Iterator<Item = (&'static str, &'static str)> {
        let sections = self.sections.iter();
        sections
            .filter(|(title, _)| title.starts_with('/'))
            .map(|(title, text)| (*title, *text))
    }

    fn write(&self, path: &str, bytes: &[u8]) {
        let path = self.root.join(path.trim_start_matches('/'));
        fs::create_dir_all(path.parent().expect("below the root")).expect("a folder");
        fs::write(path, bytes).expect("a file");
    }

    fn number(&self, section: &str) -> usize {
        self.sections[section].trim().parse().expect("a number")
    }

    fn machine(&self) -> Machine {
        // The old machine's process may not use the core that it is asked for.
        let asked = (self.root.to_string_lossy().contains("-old-")).then(|| self.number("core"));
        Machine::new(Source::folder(&self.root), asked)
    }
}

impl Drop for Unpacked {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.root);
    }
}

fn verdict(word: &str) -> Verdict {
    match word {
        "good" => Verdict::Good,
        "could_be_better" => Verdict::CouldBeBetter,
        "bad" => Verdict::Bad,
        "unknown" => Verdict::Unknown,
        other => panic!("no verdict: {other}"),
    }
}

#[test]
fn every_finding_on_every_machine() {
    for (name, text) in MACHINES {
        let unpacked = Unpacked::new("verdicts", name, text);
        let machine = unpacked.machine();
        assert_eq!(machine.core, unpacked.number("core"), "{name}");
        let found = look(&machine);
        let expected: Vec<_> = unpacked.sections["verdicts"]
            .lines()
            .map(|line| line.split_once(' ').expect("a name and a verdict"))
            .collect();
        assert_eq!(found.len(), expected.len(), "{name}");
        for (finding, (finding_name, word)) in found.iter().zip(expected) {
            assert_eq!(finding.name, finding_name, "{name}");
            assert_eq!(finding.verdict, verdict(word), "{name}: {finding:#?}");
        }
        let diagnosis = Diagnosis::of(found, &machine);
        assert_eq!(
            usize::from(diagnosis.exit_code),
            unpacked.number("exit"),
            "{name}"
        );
    }
}

#[test]
fn every_finding_can_be_good_and_can_be_not() {
    let mut seen: BTreeMap<String, HashSet<bool>> = BTreeMap::new();
    for (name, text) in MACHINES {
        for finding in look(&Unpacked::new("both", name, text).machine()) {
            let is_good = finding.verdict == Verdict::Good;
            seen.entry(finding.name).or_default().insert(is_good);
        }
    }
    let mut one_sided = seen.iter().filter(|(_, seen)| seen.len() < 2);
    assert_eq!(one_sided.next(), None);
    assert_eq!(seen.len(), checks::all().count());
}

#[test]
fn what_is_not_good_says_what_to_do_and_everything_says_why() {
    for (name, text) in MACHINES {
        let unpacked = Unpacked::new("advice", name, text);
        let machine = unpacked.machine();
        for finding in look(&machine) {
            let is_good = finding.verdict == Verdict::Good;
            assert_eq!(finding.advice.is_none(), is_good, "{name}: {finding:?}");
            let texts = [&*finding.name, &finding.read, &finding.from, finding.why];
            assert!(texts.iter().all(|text| !text.is_empty()), "{finding:?}");
            assert!(!finding.why.contains('\n'), "one line: {finding:?}");
            let advice = finding.advice.unwrap_or_default();
            assert!(is_good || advice.len() > 10, "{name}: {advice}");
        }
    }
}

/// The advice names the values of the machine, not only the place where they go.
#[test]
fn advice_is_to_be_copied() {
    let laptop = Unpacked::new("copied", "laptop", MACHINES[1].1);
    let advice: BTreeMap<_, _> = look(&laptop.machine())
        .into_iter()
        .map(|finding| (finding.name, finding.advice.unwrap_or_default()))
        .collect();
    for (name, part) in [
        ("isolated-cores", "isolcpus=managed_irq,domain,7"),
        ("isolated-cores", "AllowedCPUs=0-6"),
        ("tickless-cores", "nohz_full=7"),
        ("rcu-callbacks", "rcu_nocbs=7"),
        (
            "kernel-workers",
            "echo 7f > /sys/devices/virtual/workqueue/cpumask",
        ),
        ("default-irq-affinity", "irqaffinity=0-6"),
        ("irqs-on-core", "for n in 128 9 131 130 129"),
        ("irqbalance", "IRQBALANCE_BANNED_CPULIST=7"),
        ("smt", "/sys/devices/system/cpu/cpu3/online"),
        ("ksoftirqd", "chrt --other --pid 0 60"),
        (
            "turbo",
            "echo 1 > /sys/devices/system/cpu/intel_pstate/no_turbo",
        ),
        ("lockup-watchdog", "kernel.watchdog_cpumask=0-6"),
        ("real-time-policy", "limits.d"),
    ] {
        assert!(advice[name].contains(part), "{name}: {}", advice[name]);
    }
}

#[test]
fn what_was_read_is_told() {
    for (machine, name, part) in [
        // The deepest state that is not switched off.
        ("laptop", "idle-states", "C8, which takes 200 µs"),
        ("laptop", "irqs-on-core", "128 (xhci_hcd, 913224 times)"),
        ("laptop", "irqs-on-core", "and 1 more"),
        ("laptop", "smt", "core 7 shares its units with 3"),
        ("laptop", "throttling", "950000 of each 1000000 µs"),
        ("virtual", "hypervisor", "KVM or QEMU"),
        ("virtual", "steal", "5.98 %"),
        ("virtual", "tick", "100 Hz"),
        ("virtual", "swap", "/swapfile"),
        ("container", "isolated-cores", "5, not 3"),
        ("container", "cpu-quota", "150000 100000"),
        (
            "container",
            "real-time-group-budget",
            "/system.slice/docker-1234.scope",
        ),
        ("container", "container", "in docker"),
        ("old", "container", "in lxc"),
        ("old", "real-time-policy", "RLIMIT_RTPRIO 50"),
        (
            "old",
            "irqs-on-core",
            "/proc/interrupts has an unknown form",
        ),
        ("tuned", "isolated-cores", "2-3"),
        ("board", "model", "Raspberry Pi 4 Model B Rev 1.4"),
        ("board", "governor", "ondemand, at 600 of 1800 MHz"),
        ("board", "clock-source", "arch_sys_counter"),
        ("board", "cache-line", "64 bytes"),
        ("board", "hypervisor", "none"),
        (
            "board",
            "irq-threads",
            "irq/189-eth0 (SCHED_FIFO 50, PID 77)",
        ),
    ] {
        let text = MACHINES.iter().find(|(one, _)| *one == machine);
        let unpacked = Unpacked::new("read", machine, text.expect("a machine").1);
        let found = look(&unpacked.machine());
        let finding = found.iter().find(|finding| finding.name == name);
        let read = &finding.expect("a finding").read;
        assert!(read.contains(part), "{machine}, {name}: {read}");
    }
}

#[test]
fn an_empty_folder_makes_everything_unknown_or_told() {
    let root = std::env::temp_dir().join(format!("luna-empty-{}", std::process::id()));
    let machine = Machine::new(Source::folder(root), None);
    let found = look(&machine);
    let reported: Vec<_> = found
        .iter()
        .filter(|finding| finding.verdict != Verdict::Unknown)
        .map(|finding| finding.name.as_str())
        .collect();
    // These findings rest on a file that does not exist.
    let by_absence = [
        "autogroup",
        "tickless-cores",
        "smt",
        "cpu-dma-latency",
        "numa-balancing",
        "nmi-watchdog",
        "lockup-watchdog",
    ];
    assert_eq!(reported, by_absence);
    assert_eq!(Diagnosis::of(found, &machine).exit_code, 4);
}

/// A container may hide the kernel's file of tickless cores: its configuration then says whether
/// there can be some.
#[test]
fn another_kernel_is_asked_for_only_where_this_one_is_known_to_lack_something() {
    let advice = |config: Option<&str>| {
        let root = tempfile::tempdir().unwrap();
        let write = |file: &str, text: &str| {
            let path = root.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        if let Some(config) = config {
            write("proc/sys/kernel/osrelease", "6.1.0\n");
            write("boot/config-6.1.0", config);
        }
        let found = look(&Machine::new(Source::folder(root.path()), None));
        let found = found.into_iter().find(|one| one.name == "tickless-cores");
        found.and_then(|one| one.advice).unwrap()
    };
    assert!(advice(Some("CONFIG_NO_HZ_FULL=y\n")).starts_with("boot with nohz_full="));
    let another = advice(Some("# CONFIG_NO_HZ_FULL is not set\n"));
    assert!(
        another.starts_with("boot a kernel that has CONFIG_NO_HZ_FULL=y"),
        "{another}"
    );
    let unknown = advice(None);
    assert!(
        unknown.contains("where the kernel has CONFIG_NO_HZ_FULL"),
        "{unknown}"
    );
}

#[test]
fn a_file_that_may_not_be_read_says_how_it_may() {
    let check = Check {
        name: "hidden",
        why: "y",
        otherwise: "ask somebody",
        look: |_| Err(Unread::new("/x", UnreadReason::NotPermitted)),
    };
    let finding = check.find(&Machine::new(Source::folder("/no/such/folder"), Some(0)));
    assert_eq!(finding.verdict, Verdict::Unknown);
    let advice = finding.advice.unwrap_or_default();
    assert!(
        advice.contains("sudo") && advice.contains("ask somebody"),
        "{advice}"
    );
}

#[test]
fn the_table_keeps_to_its_width_and_leaves_nothing_out() {
    for (name, text) in MACHINES {
        let unpacked = Unpacked::new("table", name, text);
        let machine = unpacked.machine();
        let diagnosis = Diagnosis::of(look(&machine), &machine);
        for explain in [false, true] {
            let table = table::draw(&diagnosis, explain);
            for line in table.lines() {
                assert!(line.chars().count() <= usize::from(WIDTH), "{name}: {line}");
            }
            let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
            let flat = words(&table);
            for finding in &diagnosis.findings {
                assert!(table.contains(&finding.name), "{name}: {finding:?}");
                let advice = words(finding.advice.as_deref().unwrap_or_default());
                assert!(flat.contains(&advice), "{name}: {advice}");
                let says_why = flat.contains(&words(finding.why));
                let should = explain || finding.verdict != Verdict::Good;
                assert_eq!(says_why, should, "{name}: {finding:?}");
            }
        }
    }
}

/// Numbers that look random; the same in each run.
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        // xorshift64, https://www.jstatsoft.org/article/view/v008i14
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        usize::try_from(self.0 % end.max(1) as u64).unwrap_or(0)
    }
}

/// Breaks a text in one of the ways in which a file can be broken.
fn broken(text: &str, random: &mut Random) -> Vec<u8> {
    const PIECES: [&[u8]; 16] = [
        b"",
        b"\n",
        b" ",
        b"-",
        b",",
        b":",
        b"=",
        b"0",
        b"-1",
        b"65535",
        b"0-65535",
        b"18446744073709551615",
        b"99999999999999999999999999",
        b"unlimited",
        b"(",
        b"\xff\xc3",
    ];
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..=random.below(3) {
        let at = random.below(bytes.len() + 1);
        match random.below(5) {
            0 => bytes.truncate(at),
            1 => drop(bytes.drain(at..(at + random.below(9)).min(bytes.len()))),
            2 => bytes[at..]
                .iter_mut()
                .take(1)
                .for_each(|byte| *byte ^= 1 << random.below(8)),
            3 => {
                let piece = PIECES[random.below(PIECES.len())];
                bytes.splice(at..at, piece.iter().copied());
            }
            _ => {
                // Every number becomes another.
                let piece = PIECES[random.below(PIECES.len())];
                let is_digit = |byte: &u8| byte.is_ascii_digit();
                let words = bytes.split_inclusive(|byte| !is_digit(byte));
                let words = words.map(|word| if random_digit(word) { piece } else { word });
                bytes = words.collect::<Vec<_>>().concat();
            }
        }
    }
    bytes
}

fn random_digit(word: &[u8]) -> bool {
    word.first().is_some_and(u8::is_ascii_digit)
}

/// Whatever the files hold, there are the same findings, each with a verdict and words, and a table
/// of the right width.
#[test]
fn broken_files_break_nothing() {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let count = checks::all().count();
    for (name, text) in MACHINES {
        let unpacked = Unpacked::new("broken", name, text);
        let files: Vec<_> = unpacked.files().collect();
        for _ in 0..80 {
            // A few files at a time, or gone.
            let chosen: Vec<_> = (0..=random.below(4))
                .map(|_| files[random.below(files.len())])
                .collect();
            for (path, text) in &chosen {
                match random.below(8) {
                    0 => drop(fs::remove_file(
                        unpacked.root.join(path.trim_start_matches('/')),
                    )),
                    _ => unpacked.write(path, &broken(text, &mut random)),
                }
            }
            let machine = unpacked.machine();
            let diagnosis = Diagnosis::of(look(&machine), &machine);
            assert_eq!(diagnosis.findings.len(), count);
            let table = table::draw(&diagnosis, true);
            assert!(
                table
                    .lines()
                    .all(|line| line.chars().count() <= usize::from(WIDTH))
            );
            for (path, text) in &chosen {
                unpacked.write(path, text.as_bytes());
            }
        }
    }
}

/// The page has more on each finding, under its name.
#[test]
fn the_documentation_has_a_heading_for_each_finding() {
    let page = include_str!("../../../docs/realtime.md");
    let headings: HashSet<_> = page
        .lines()
        .filter_map(|line| line.strip_prefix("#### "))
        .collect();
    let names: HashSet<_> = checks::all().map(|check| check.name).collect();
    assert_eq!(headings, names);
}

/// The steal of one second is shown beside that since the start, and the worse one counts.
#[test]
fn steal_now_and_since_the_start() {
    let unpacked = Unpacked::new("steal", "tuned", MACHINES[0].1);
    let time = |total: u64, stolen: u64| {
        cpu_time(&format!("cpu {} 0 0 0 0 0 0 {stolen}\n", total - stolen)).expect("a time")
    };
    for (before, after, verdict) in [
        (time(1000, 0), time(2000, 0), Verdict::Good),
        (time(1000, 500), time(2000, 500), Verdict::Good),
        (time(1000, 0), time(2000, 10), Verdict::CouldBeBetter),
        (time(1000, 0), time(2000, 100), Verdict::Bad),
        // No tick in between.
        (time(1000, 0), time(1000, 0), Verdict::Good),
    ] {
        let mut found = look(&unpacked.machine());
        super::note_steal(&mut found, after.since(before));
        let steal = found.iter().find(|finding| finding.name == "steal");
        let steal = steal.expect("the finding");
        assert_eq!(steal.verdict, verdict, "{steal:?}");
        assert_eq!(steal.advice.is_none(), verdict == Verdict::Good);
        assert!(steal.read.contains("since the machine was started"));
    }
}
