//! What machine it is.

use crate::doctor::facts::number;
use crate::doctor::finding::{Check, Seen};
use crate::doctor::machine::Machine;
use luna_machine::facts::Unread;

pub(super) const CHECKS: &[Check] = &[
    Check {
        name: "model",
        why: "figures are those of a machine: compare them with none of another",
        otherwise: "run `cat /proc/device-tree/model` (Arm) or `dmidecode -s system-product-name`",
        look: model,
    },
    Check {
        name: "cache-line",
        why: "what two cores write is kept apart by 64 and 128 bytes; in one line they would slow each other down",
        otherwise: "run `getconf LEVEL1_DCACHE_LINESIZE`",
        look: cache_line,
    },
];

fn model(machine: &Machine) -> Result<Seen, Unread> {
    let tree = "/proc/device-tree/model";
    let product = "/sys/class/dmi/id/product_name";
    // The tree's texts end with a zero byte.
    let read = |file| {
        let word = machine.source.word(file)?;
        Ok(Seen::good(word.trim_end_matches('\0'), file))
    };
    read(tree).or_else(|_: Unread| read(product))
}

fn cache_line(machine: &Machine) -> Result<Seen, Unread> {
    let from = format!(
        "/sys/devices/system/cpu/cpu{}/cache/index0/coherency_line_size",
        machine.core
    );
    let bytes = machine.source.parse(&from, number)?;
    let read = format!("{bytes} bytes");
    Ok(match bytes {
        ..=64 => Seen::good(read, from),
        _ => Seen::better(
            read,
            from,
            "nothing can be set: see under `wake-core-N-to-M` what an exchange between cores costs, and report it",
        ),
    })
}
