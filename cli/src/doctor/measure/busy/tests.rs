use super::*;
use crate::doctor::finding::Verdict;
use luna_machine::facts::Source;

fn judged(name: &str, spells: &[Spell], problem: Option<&str>, machine: &Machine) -> Finding {
    let number = WAYS.iter().position(|way| way.name == name).unwrap();
    judge(&WAYS[number], number, spells, problem, machine)
}

/// Everything came through, but what is left out.
fn spell(left_out: &[usize]) -> Spell {
    let late = Some(Duration::from_micros(9));
    let mut spell = Spell {
        how: "fifo:80, core 3".to_owned(),
        has_policy: true,
        late: [late; WAYS.len()],
        ..Spell::default()
    };
    for way in left_out {
        spell.late[*way] = None;
    }
    spell
}

fn nowhere() -> Machine {
    Machine::new(Source::folder("/no/such/folder"), Some(3))
}

#[test]
fn what_comes_through_each_time_is_good_and_what_loops_need_is_bad_without() {
    let machine = nowhere();
    let all = [spell(&[]), spell(&[])];
    for way in &WAYS {
        let finding = judged(way.name, &all, None, &machine);
        assert_eq!(finding.verdict, Verdict::Good, "{finding:?}");
        assert!(
            finding
                .read
                .ends_with("came through 2 of 2 times, after at most 9.0 us"),
            "{finding:?}"
        );
    }
    let some = [spell(&[]), spell(&[HARD, SOFT, SIGNAL, NETWORK])];
    for (name, verdict) in [
        ("busy-hard-timer", Verdict::Bad),
        ("busy-soft-timer", Verdict::CouldBeBetter),
        ("busy-signal", Verdict::Bad),
        ("busy-network", Verdict::CouldBeBetter),
    ] {
        let finding = judged(name, &some, None, &machine);
        assert_eq!(finding.verdict, verdict, "{finding:?}");
        assert!(finding.read.contains("1 of 2 times"), "{finding:?}");
        assert!(finding.advice.is_some(), "{finding:?}");
    }
}

#[test]
fn without_a_measurement_the_reason_is_told() {
    let finding = judged("busy-signal", &[], Some("it needs SCHED_FIFO"), &nowhere());
    assert_eq!(finding.verdict, Verdict::Unknown);
    assert_eq!(finding.read, "it needs SCHED_FIFO");
}

#[test]
fn the_remedy_names_the_threads_of_the_machine() {
    let root = std::env::temp_dir().join(format!("luna-busy-{}", std::process::id()));
    for (number, name) in [
        ("20", "ktimers/3"),
        ("21", "ksoftirqd/3"),
        ("22", "ktimers/2"),
    ] {
        let folder = root.join("proc").join(number);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("comm"), format!("{name}\n")).unwrap();
    }
    let machine = Machine::new(Source::folder(&root), Some(3));
    let advice = |name: &str, way: usize| {
        judged(name, &[spell(&[way])], None, &machine)
            .advice
            .unwrap()
    };
    let soft = advice("busy-soft-timer", SOFT);
    assert!(
        soft.contains("`chrt --fifo --pid 81 20` (ktimers/3)"),
        "{soft}"
    );
    let network = advice("busy-network", NETWORK);
    assert!(network.contains("--pid 81 21` (ksoftirqd/3)"), "{network}");
    std::fs::remove_dir_all(root).unwrap();
}

/// Where the policy can be had, a sleep and a signal come through on every kernel.
#[test]
#[cfg(all(target_os = "linux", not(luna_portable)))]
fn a_busy_core_lets_through_what_luna_relies_on() {
    let core = luna_platform::thread::available_cores()[0];
    let machine = Machine::new(Source::machine(), Some(core));
    let findings = on(&machine);
    let names: Vec<_> = findings.iter().map(|one| one.name.as_str()).collect();
    assert_eq!(names, WAYS.map(|way| way.name));
    for finding in findings
        .iter()
        .filter(|one| one.verdict == Verdict::Unknown)
    {
        // Without privileges, or under a load that leaves no spell whole.
        assert!(
            finding.read.contains("SCHED_FIFO") || finding.read.contains("something else had"),
            "{finding:?}"
        );
    }
    assert!(
        findings.iter().all(|one| one.verdict != Verdict::Bad),
        "{findings:?}"
    );
}
