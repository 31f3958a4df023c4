//! Lets the tests of channels that are included here know that there is one CPU: those that need
//! threads are ignored.

fn main() {
    println!("cargo::rustc-cfg=luna_one_cpu");
    println!("cargo::rerun-if-changed=build.rs");
}
