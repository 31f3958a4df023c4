//! What a machine is fit for where the kernel hides how it preempts, or a hypervisor is below it.

use super::{MACHINES, Unpacked};
use crate::doctor::diagnosis::{Diagnosis, Fitness};
use crate::doctor::finding::{Finding, Verdict};
use crate::doctor::look;
use crate::doctor::machine::Machine;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::fs;
use std::io::Write;

/// The configuration as the kernel packs it.
fn packed(config: &str) -> Vec<u8> {
    let mut packer = GzEncoder::new(Vec::new(), Compression::default());
    packer.write_all(config.as_bytes()).expect("into memory");
    packer.finish().expect("into memory")
}

fn preemption_of(machine: &Machine) -> Finding {
    let mut found = look(machine).into_iter();
    let preemption = found.find(|finding| finding.name == "preemption");
    preemption.expect("a finding")
}

/// A kernel that chooses its model at boot shows the choice to root alone.
#[test]
fn the_built_in_preemption_counts_where_the_one_in_effect_is_hidden() {
    let unpacked = Unpacked::new("built-in", "virtual", MACHINES[2].1);
    fs::remove_file(unpacked.root.join("sys/kernel/debug/sched/preempt")).expect("a file");
    let unknown = preemption_of(&unpacked.machine());
    assert_eq!(unknown.verdict, Verdict::Unknown, "{unknown:?}");
    for (option, verdict) in [
        ("CONFIG_PREEMPT_NONE", Verdict::Bad),
        ("CONFIG_PREEMPT_VOLUNTARY", Verdict::Bad),
        ("CONFIG_PREEMPT_LAZY", Verdict::CouldBeBetter),
        ("CONFIG_PREEMPT", Verdict::CouldBeBetter),
    ] {
        let config = format!("CONFIG_PREEMPT_DYNAMIC=y\n{option}=y\nCONFIG_HZ=100\n");
        unpacked.write("/proc/config.gz", &packed(&config));
        let machine = unpacked.machine();
        let finding = preemption_of(&machine);
        assert_eq!(finding.verdict, verdict, "{option}: {finding:?}");
        assert_eq!(finding.from, "/proc/config.gz");
        assert!(finding.read.contains("cannot be read"), "{finding:?}");
        let hertz = machine.option("CONFIG_HZ");
        assert_eq!(hertz, Ok(("100".to_owned(), "/proc/config.gz".to_owned())));
    }
    // The command line is the later word.
    unpacked.write("/proc/cmdline", b"preempt=full");
    unpacked.write("/proc/config.gz", &packed("CONFIG_PREEMPT_NONE=y\n"));
    let asked = preemption_of(&unpacked.machine());
    assert_eq!(
        (asked.verdict, &*asked.from),
        (Verdict::CouldBeBetter, "/proc/cmdline")
    );
}

#[test]
fn a_packed_configuration_that_is_broken_tells_nothing() {
    let unpacked = Unpacked::new("packed", "virtual", MACHINES[2].1);
    let whole = packed("CONFIG_HZ=250\n");
    for bytes in [&b"no gzip"[..], &whole[..whole.len() - 9], &[]] {
        unpacked.write("/proc/config.gz", bytes);
        let (hertz, from) = unpacked
            .machine()
            .option("CONFIG_HZ")
            .expect("the plain file");
        assert_eq!(
            (&*hertz, &*from),
            ("100", "/boot/config-6.18.1-cloud-amd64")
        );
    }
}

/// Nothing is bad there, but a virtual core that is not isolated is no place for hard real time.
#[test]
fn a_virtual_machine_without_isolation_is_fit_with_findings_at_most() {
    let unpacked = Unpacked::new("findings", "tuned", MACHINES[0].1);
    let fitness = || {
        let machine = unpacked.machine();
        Diagnosis::of(look(&machine), &machine).fitness
    };
    assert_eq!(fitness(), Fitness::Fit);
    unpacked.write("/sys/class/dmi/id/sys_vendor", b"QEMU");
    unpacked.write("/sys/devices/system/cpu/isolated", b"\n");
    assert_eq!(fitness(), Fitness::FitWithFindings);
}
