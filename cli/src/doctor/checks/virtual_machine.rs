//! Whether there is another scheduler below this one.

use crate::doctor::facts::cpu_time::cpu_time;
use crate::doctor::finding::{Check, Seen};
use crate::doctor::machine::Machine;
use luna_machine::facts::Unread;

pub(super) const CHECKS: &[Check] = &[
    Check {
        name: "hypervisor",
        why: "the host can take a virtual core away for milliseconds, and nothing within sees it coming",
        otherwise: "run `systemd-detect-virt --vm`",
        look: hypervisor,
    },
    Check {
        name: "steal",
        why: "time in which a virtual core could have run, and the host ran something else",
        otherwise: "run `vmstat 1` and see the column st",
        look: steal,
    },
    Check {
        name: "container",
        why: "policies, locked memory, devices and cores are given to a container when it is started, or not at all",
        otherwise: "run `systemd-detect-virt --container`",
        look: container,
    },
];

fn hypervisor(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/proc/cpuinfo";
    let source = &machine.source;
    let says_so = source.parse(from, |text| {
        // No processor at all: not what it should be.
        text.contains(':').then(|| {
            let mut flags = text.lines().filter(|line| line.starts_with("flags"));
            flags.any(|line| line.split_whitespace().any(|flag| flag == "hypervisor"))
        })
    })?;
    let name = hypervisor_name(machine);
    if !says_so && name.is_none() {
        return Ok(Seen::good("none", from));
    }
    Ok(Seen::better(
        name.unwrap_or_else(|| "one that does not say its name".to_owned()),
        from,
        "run on the machine itself; or on the host: pin each virtual core to a core of its own (libvirt: <vcpupin>, <emulatorpin> \
         elsewhere), isolate those, and run the virtual cores under SCHED_FIFO (<vcpusched>)",
    ))
}

/// The hypervisor's own signs: Xen, the firmware's vendor, the clocks that only a hypervisor has.
fn hypervisor_name(machine: &Machine) -> Option<String> {
    let source = &machine.source;
    if let Ok(kind) = source.word("/sys/hypervisor/type") {
        return Some(kind);
    }
    // On Arm the device tree says it: a guest of KVM or Xen, QEMU's board.
    let tree = ["hypervisor/compatible", "compatible"].map(|name| {
        source
            .read(&format!("/proc/device-tree/{name}"))
            .unwrap_or_default()
    });
    let tree = tree.join(" ");
    let signs = [
        ("xen", "Xen"),
        ("linux,kvm", "KVM"),
        ("linux,dummy-virt", "KVM or QEMU"),
    ];
    if let Some((_, name)) = signs.iter().find(|(sign, _)| tree.contains(sign)) {
        return Some((*name).to_owned());
    }
    let firmware = ["sys_vendor", "product_name", "bios_vendor"].map(|name| {
        source
            .word(&format!("/sys/class/dmi/id/{name}"))
            .unwrap_or_default()
    });
    let firmware = firmware.join(" ");
    let vendors = [
        ("QEMU", "KVM or QEMU"),
        ("KVM", "KVM"),
        ("Amazon EC2", "KVM (Amazon EC2)"),
        ("Google Compute Engine", "KVM (Google)"),
        ("VMware", "VMware"),
        ("VirtualBox", "VirtualBox"),
        ("innotek", "VirtualBox"),
        ("Xen", "Xen"),
        ("Parallels", "Parallels"),
        ("bhyve", "bhyve"),
        // The vendor's laptops are physical machines; its virtual ones have it in the product's
        // name.
        ("Microsoft Corporation Virtual Machine", "Hyper-V"),
    ];
    let vendor = vendors.iter().find(|(word, _)| firmware.contains(word));
    if let Some((_, name)) = vendor {
        return Some((*name).to_owned());
    }
    let clocks = source
        .word("/sys/devices/system/clocksource/clocksource0/available_clocksource")
        .unwrap_or_default();
    let clocks_of = [
        ("kvm-clock", "KVM"),
        ("hyperv_clocksource", "Hyper-V"),
        ("xen", "Xen"),
    ];
    let found = clocks_of.iter().find(|(clock, _)| clocks.contains(clock));
    found.map(|(_, name)| (*name).to_owned())
}

/// The finding on a share of stolen time; `when` names the time in which it was counted.
pub(crate) fn steal_seen(share: f64, when: &str) -> Seen {
    let from = "/proc/stat";
    let read = format!("{:.2} % {when}", 100.0 * share);
    let advice = "give the virtual machine cores of its own on the host: see `hypervisor`";
    match share {
        ..=0.0005 => Seen::good(read, from),
        ..=0.02 => Seen::better(read, from, advice),
        _ => Seen::bad(read, from, advice),
    }
}

fn steal(machine: &Machine) -> Result<Seen, Unread> {
    let time = machine.source.parse("/proc/stat", cpu_time)?;
    let share = time.stolen_share().unwrap_or(0.0);
    Ok(steal_seen(share, "since the machine was started"))
}

fn container(machine: &Machine) -> Result<Seen, Unread> {
    let source = &machine.source;
    let from = [
        "/run/.containerenv",
        "/.dockerenv",
        "/run/systemd/container",
    ];
    let Some(file) = from.into_iter().find(|file| source.has(file)) else {
        // Without `/proc` nothing is known, not even this.
        source.read("/proc/self/status")?;
        return Ok(Seen::good("none seen", from.join(", ")));
    };
    let name = source.word("/run/systemd/container");
    let name = name.unwrap_or_else(|_| match file {
        "/.dockerenv" => "docker".to_owned(),
        _ => "one".to_owned(),
    });
    Ok(Seen::better(
        format!("in {name}"),
        file,
        format!(
            "start it with --cap-add SYS_NICE --cap-add IPC_LOCK --ulimit rtprio=99 --ulimit memlock=-1 --device /dev/cpu_dma_latency \
             --cpuset-cpus {}",
            machine.core
        ),
    ))
}
