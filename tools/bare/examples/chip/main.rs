//! A program for a chip: LUNA on a Cortex-M4, with an interrupt that sends to a process and a loop.
//!
//! It runs on QEMU's board mps2-an386, and is to be read beside docs/no-std.md:
//!
//! ```console
//! $ chip=thumbv7em-none-eabihf
//! $ cargo build --release -p luna-bare --features bare --example chip --target $chip
//! $ qemu-system-arm -machine mps2-an386 -nographic -semihosting -icount shift=5 \
//!     -kernel target/$chip/release/examples/chip
//! ```

#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    println!("this is a program for a chip: see its source");
}

#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod program;
