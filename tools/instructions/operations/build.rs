//! Passes the compiler's version to the program, since its figures hold only for that compiler.

use std::env;
use std::process::Command;

fn main() {
    let compiler = env::var_os("RUSTC").expect("cargo names the compiler");
    let said = Command::new(compiler)
        .arg("--version")
        .output()
        .expect("the compiler that builds this runs");
    let version = String::from_utf8(said.stdout).expect("a version is text");
    println!("cargo::rustc-env=LUNA_COMPILER={}", version.trim());
    println!("cargo::rerun-if-changed=build.rs");
}
