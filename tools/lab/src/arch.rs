//! The two architectures of the guest.

use object::elf;

/// A processor architecture, by the name that Debian gives it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Arch {
    /// x86-64.
    Amd64,
    /// 64-bit Arm.
    Arm64,
}

impl Arch {
    /// Reads Debian's name.
    ///
    /// # Errors
    ///
    /// It is neither of the two.
    pub(crate) fn parse(name: &str) -> Result<Arch, String> {
        match name {
            "amd64" => Ok(Arch::Amd64),
            "arm64" => Ok(Arch::Arm64),
            _ => Err(format!(
                "no architecture: `{name}`; there are amd64 and arm64"
            )),
        }
    }

    /// Debian's name.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Arch::Amd64 => "amd64",
            Arch::Arm64 => "arm64",
        }
    }

    /// The program that emulates it.
    pub(crate) fn qemu(self) -> &'static str {
        match self {
            Arch::Amd64 => "qemu-system-x86_64",
            Arch::Arm64 => "qemu-system-aarch64",
        }
    }

    /// Debian's packages with that program, and with what else its programs are built with.
    pub(crate) fn host_packages(self) -> &'static [&'static str] {
        match self {
            Arch::Amd64 => &["qemu-system-x86"],
            Arch::Arm64 => &[
                "qemu-system-arm",
                "gcc-aarch64-linux-gnu",
                "libc6-dev-arm64-cross",
            ],
        }
    }

    /// The emulated machine, and the kernel's command line.
    ///
    /// `edd=off`: no disks are looked for. `mitigations=off`: the emulated processor has no caches,
    /// and the detours around their faults would be all that is measured.
    pub(crate) fn machine(self) -> &'static [&'static str] {
        match self {
            Arch::Amd64 => &[
                "-M",
                "q35",
                "-cpu",
                "qemu64",
                "-append",
                "console=ttyS0 quiet panic=1 edd=off mitigations=off",
            ],
            Arch::Arm64 => &[
                "-M",
                "virt,gic-version=3",
                "-cpu",
                "cortex-a72",
                "-append",
                "console=ttyAMA0 quiet panic=1",
            ],
        }
    }

    /// The machine in the head of its ELF files.
    pub(crate) fn elf_machine(self) -> elf::Machine {
        match self {
            Arch::Amd64 => elf::EM_X86_64,
            Arch::Arm64 => elf::EM_AARCH64,
        }
    }

    /// The name of its folders with libraries.
    pub(crate) fn triplet(self) -> &'static str {
        match self {
            Arch::Amd64 => "x86_64-linux-gnu",
            Arch::Arm64 => "aarch64-linux-gnu",
        }
    }
}
