//! Lets the tests of channels that are included here know that there is one CPU: those that need
//! threads are ignored. Places the sections of the example for a chip.

fn main() {
    println!("cargo::rustc-cfg=luna_one_cpu");
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=chip.x");
    let folder = std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets it");
    if std::env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("none") {
        println!("cargo::rustc-link-arg-examples=-T{folder}/chip.x");
    }
}
